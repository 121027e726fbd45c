"""Runs of samples: where a mask is true, and where an effort stays at its limit."""

from collections.abc import Iterator

import numpy as np

#: Share of samples at a plateau, and its shortest run, that make a saturated effort.
SATURATED_SHARE = 0.01
SATURATED_RUN = 10
#: Over such a run a joint at rest moves less than this share of what it moves on average.
RESTING_SHARE = 0.1


def runs(marked: np.ndarray) -> Iterator[slice]:
    """Yield where a boolean array is true without a break."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], marked.astype(int), [0]])))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        yield slice(int(start), int(stop))


def saturated_line(effort: np.ndarray, position: np.ndarray) -> int | None:
    """Return the line where a saturated stretch of `effort` begins, or None.

    A clipped signal piles up at its largest or smallest value: many samples in unbroken runs at
    exactly that value and hardly any just below it, while the joint moves on. The top of a smooth
    quantised one takes as long over the next four steps as at its extreme one, and a joint that is
    held at rest needs the same effort all the time.
    """
    spread = float(np.ptp(effort))
    levels = np.unique(effort)
    if len(levels) < 20:
        return None
    near = max(0.005 * spread, 4.5 * float(np.diff(levels).min()))
    pace = float(np.ptp(position)) / len(position)
    for extreme, sign in ((effort.max(), 1.0), (effort.min(), -1.0)):
        at = effort == extreme
        below = (sign * (extreme - effort) < near) & ~at
        count = int(at.sum())
        if count < max(SATURATED_RUN, SATURATED_SHARE * len(effort)) or count < 2 * below.sum():
            continue
        longest = max(runs(at), key=lambda run: run.stop - run.start)
        length = longest.stop - longest.start
        moved = float(np.ptp(position[longest]))
        if length >= SATURATED_RUN and moved >= RESTING_SHARE * pace * length:
            return int(longest.start) + 2
    return None
