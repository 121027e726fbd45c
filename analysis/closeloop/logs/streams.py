"""Efforts that a log has at other stamps than positions, taken at the positions' stamps.

So does every topic of a bag, and a table to which a plotter has merged several.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.closeloop.logs.belief import Belief
from analysis.closeloop.logs.log import Numbers
from intake.xml import listed

#: Share of a position's samples at which another signal has a number, if they are of one stream.
TOGETHER = 0.02
#: Steps of an effort, over its median step, between which nothing is taken; and its median step
#: over the position's: of fewer samples the noise is lost, by which an effort is judged.
GAP, SLOWER = 5.0, 1.5


def on_one_clock(taken: Mapping[str, Belief]) -> tuple[dict[str, Belief], list[str]]:
    """Return signals at the stamps of the first position, and what became of the others.

    An effort with other stamps is interpolated, a line from sample to sample, if its joint has a
    position on that clock. Positions, and what is their derivative, would gain a false
    acceleration by that: they are left out.

    Args:
        taken: what the log has by its name in a session, a position with a clock among it.
    """
    position = next(b for name, b in taken.items() if name.endswith(".position"))
    time = position.channel.time
    assert time is not None
    own = np.isfinite(position.channel.values) & np.isfinite(time)
    found, remarks, moved, merged = {}, [], [], False
    for name, belief in taken.items():
        apart = _has_another_clock(belief, time)
        if not apart and not _is_of_another_stream(belief, position):
            found[name] = belief
            continue
        joint, _, signal = name.rpartition(".")
        beside = taken.get(f"{joint}.position")
        values = _at(time, own, belief) if signal == "effort" else None
        of_joint = beside is not None and not _has_another_clock(beside, time)
        if values is None or not of_joint:
            why = (
                f", too slow for {position.channel.name} or beginning anew,"
                if signal == "effort" and of_joint
                else ""
            )
            remarks.append(f"{belief.channel.name} has another clock{why} and was left out")
            continue
        merged |= not apart
        moved.append(belief.channel.name)
        found[name] = replace(belief, channel=replace(belief.channel, values=values, time=time))
    if moved:
        remarks.append(
            f"{listed(moved)} {'has' if len(moved) == 1 else 'have'} other stamps than "
            f"{position.channel.name}, and was interpolated between its samples at those"
        )
    if merged:
        found = {name: _only(belief, own) for name, belief in found.items()}
    return found, remarks


def _has_another_clock(belief: Belief, time: Numbers) -> bool:
    own = belief.channel.time
    return own is None or len(own) != len(time) or not np.array_equal(own, time, equal_nan=True)


def _is_of_another_stream(belief: Belief, position: Belief) -> bool:
    """Whether a signal on the clock of a position has hardly a number where that has one."""
    own, other = np.isfinite(belief.channel.values), np.isfinite(position.channel.values)
    return bool(np.sum(own & other) < TOGETHER * min(np.sum(own), np.sum(other)))


def _at(time: Numbers, there: NDArray[np.bool_], belief: Belief) -> Numbers | None:
    """Return a signal at a position's stamps, s, (n,); None if it cannot say enough.

    Args:
        time: the stamps; NaN is returned for those in a gap of the signal.
        there: which of them the position has, (n,).
        belief: what the signal is taken for, with its own clock.
    """
    own = belief.channel.time
    if own is None or belief.channel.trials:
        return None
    known = np.isfinite(own) & np.isfinite(belief.channel.values)
    stamps, steps = own[known], np.diff(own[known])
    wanted = np.diff(time[there])
    if not len(steps) or not len(wanted) or (steps < 0.0).any() or (wanted < 0.0).any():
        return None
    step = float(np.median(steps))
    if step > SLOWER * float(np.median(wanted)):
        return None
    found = np.interp(time, stamps, belief.channel.values[known], left=np.nan, right=np.nan)
    after = np.clip(np.searchsorted(stamps, time), 1, len(steps))
    found[steps[after - 1] > GAP * step] = np.nan
    return found


def _only(belief: Belief, rows: NDArray[np.bool_]) -> Belief:
    """Return a belief with some of its samples."""
    channel = belief.channel
    assert channel.time is not None
    return replace(
        belief, channel=replace(channel, values=channel.values[rows], time=channel.time[rows])
    )
