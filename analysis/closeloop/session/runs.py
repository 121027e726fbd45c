"""Runs of samples: where a mask is true, an effort stays at its limit, a joint rests or turns."""

from collections.abc import Iterator

import numpy as np

#: Share of samples at a plateau, and its shortest run, that make a saturated effort.
SATURATED_SHARE = 0.01
SATURATED_RUN = 10
#: Over such a run a joint at rest moves less than this share of what it moves on average.
RESTING_SHARE = 0.1
#: Shortest rest, s: a reversal is none.
REST = 0.05
#: A joint that is pushed out of a hold is back within this time, s, but for this share of its way.
AWAY, BACK = 3.0, 0.2
#: Of a way that is short beside what its motor moves it, or of a joint that goes nowhere, friction
#: may keep half: as much as it is of what is left of a push of three times its size.
SHORT, KEPT = 0.1, 0.5
#: Least travel of a moving joint, rad or m: above what an encoder's last digits do.
MOVING = 5e-3
#: Least travel of a joint whose signs are judged, rad or m: what moves less may only be pushed
#: about, or feel what the joints beside it do.
TRAVEL = 0.2


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


def rests(velocity: np.ndarray, rest_speed: float, rate: float) -> np.ndarray:
    """Return where a joint stays below a speed for longer than a reversal takes, (n,).

    Args:
        velocity: rad/s or m/s, (n,).
        rest_speed: below which it counts as resting.
        rate: samples per second.
    """
    still = np.abs(velocity) < rest_speed
    found = np.zeros(len(still), dtype=bool)
    for run in runs(still):
        found[run] = (run.stop - run.start) / rate > REST
    return found


def since_reversal(velocity: np.ndarray, rest_speed: float, rate: float) -> np.ndarray:
    """Return the time since a joint last changed direction, s, with that direction's sign, (n,)."""
    sign = np.sign(velocity) * (np.abs(velocity) > rest_speed)
    known = np.maximum.accumulate(np.where(sign != 0, np.arange(len(sign)), 0))
    sign = sign[known]
    turned = np.concatenate([[True], np.diff(sign) != 0])
    last = np.maximum.accumulate(np.where(turned, np.arange(len(sign)), 0))
    return np.asarray(sign * (np.arange(len(sign)) - last) / rate)


def turning(velocity: np.ndarray, rest_speed: float) -> np.ndarray:
    """Return where a joint rests or changes direction, (n,)."""
    found = np.abs(velocity) < rest_speed
    found[1:] |= np.diff(np.sign(velocity)) != 0
    return np.asarray(found)


def holds(position: np.ndarray, resting: np.ndarray, rate: float) -> list[slice]:
    """Return where a joint rests, or comes back at once to where it rested.

    A push moves a joint that a controller holds; it rests before and after, in the same place.

    Args:
        position: rad or m, (n,).
        resting: where it rests, (n,).
        rate: samples per second.
    """
    found: list[tuple[slice, int, float]] = []
    travel = float(np.ptp(position))
    travel = travel if travel >= TRAVEL else np.inf
    for run in runs(resting):
        length, place = run.stop - run.start, float(np.median(position[run]))
        # It may rest on the way, where the push is strongest.
        recent = run.start - AWAY * rate
        for number in reversed(range(len(found))):
            hold, longest, home = found[number]
            if hold.stop < recent:
                found.append((run, length, place))
                break
            way = float(np.abs(position[hold.stop : run.start] - home).max())
            kept = KEPT if way < SHORT * travel else BACK
            if abs(position[run.start] - home) <= max(kept * way, MOVING):
                if longest > length:
                    length, place = longest, home
                found[number:] = [(slice(hold.start, run.stop), length, place)]
                break
        else:
            found.append((run, length, place))
    return [hold for hold, _, _ in found]
