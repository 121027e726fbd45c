"""Which channel is the clock of a log, and how regular it is."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from analysis.closeloop.logs.belief import Belief
from analysis.closeloop.logs.log import Numbers
from analysis.closeloop.unit_names import UNITS

#: What a clock's median step, s, may be for a recording of joints.
STEPS = (1e-5, 0.2)
#: Share of a clock's steps that increase without a gap, and of its samples that have a stamp.
MOSTLY = 0.98
#: Share of steps back of what is no clock: one that begins anew has few.
BACK = 0.1
#: Part of another clock's jitter that a more even one has at most. (Of a real bag: 0.06.)
EVENER = 0.75
#: A step back by more median steps is a restart; a smaller one, or none, a stamp that repeats.
RESTART = 10
#: The column of a stamp's whole seconds, and what that of the rest is called, in s.
WHOLE_SECONDS = re.compile(r"(?P<stem>.*?)secs?", re.IGNORECASE)
PARTS: Mapping[str, float] = {
    **dict.fromkeys(("nanosec", "nanosecs", "nsec", "nsecs"), 1e-9),
    **dict.fromkeys(("usec", "usecs"), 1e-6),
}
CLOCKS: Mapping[str, float] = {u: UNITS[u].scale for u in ("s", "ms", "us", "ns")}


@dataclass(frozen=True, kw_only=True)
class Clock:
    """How the samples of one time channel follow each other."""

    #: Median rate, Hz.
    rate: float
    #: Standard deviation of the steps that are no gaps over the median step.
    jitter: float
    #: Steps longer than five median steps, and the longest, s.
    gaps: int
    longest_gap: float
    #: Stamps that do not increase.
    repeated: int
    #: How often it begins anew.
    restarts: int


def clock_of(time: Numbers) -> Clock:
    """Return how regular a clock is; `time` in s, shape (n,), n >= 2."""
    steps = np.diff(time[np.isfinite(time)])
    forward = steps[steps > 0]
    median = float(np.median(forward)) if len(forward) else np.nan
    regular = forward[forward <= 5 * median]
    return Clock(
        rate=1.0 / median,
        jitter=float(np.std(regular) / median) if len(regular) else np.nan,
        gaps=int(np.sum(forward > 5 * median)),
        longest_gap=float(forward.max()) if len(forward) else np.nan,
        repeated=int(np.sum((steps <= 0) & ~_begins_anew(steps))),
        restarts=int(np.sum(_begins_anew(steps))),
    )


def stretches(time: Numbers, begins: Sequence[int] = ()) -> list[slice]:
    """Return the samples between the restarts of a clock, and between trials; none is empty.

    Args:
        time: s, shape (n,).
        begins: samples at which trials begin.
    """
    restarts = np.flatnonzero(_begins_anew(np.diff(time))) + 1
    cuts = {0, len(time), *begins, *restarts.tolist()}
    return [slice(a, b) for a, b in pairwise(sorted(cuts)) if b <= len(time)]


def _begins_anew(steps: Numbers) -> NDArray[np.bool_]:
    """Return at which steps between stamps, s, (n,), a clock begins anew."""
    forward = steps[steps > 0]
    return steps < -RESTART * (float(np.median(forward)) if len(forward) else 1.0)


def find_clock(beliefs: list[Belief], group: list[int]) -> None:
    """Find the clock of channels of one length; one that they came with may be of the recording.

    Of two that tell the same time the more even one is that by which samples were taken: a recorder
    stamps a message when it gets to it.
    """
    time = beliefs[group[0]].channel.time
    if time is None and _in_two_columns(beliefs, group):
        return
    likely = sorted(
        group, key=lambda at: (beliefs[at].quantity != "time", beliefs[at].unit not in CLOCKS)
    )
    chosen = None
    for at in likely:
        belief, values = beliefs[at], beliefs[at].channel.values
        unit, step = _ticks(belief)
        if unit is None or (belief.quantity != "time" and chosen is not None):
            continue
        stamped = _stamps_positions(beliefs, group, at)
        own: Numbers | None = CLOCKS[unit] * values
        if time is not None:
            own = _more_even(CLOCKS[unit] * values, time) if stamped else None
        elif belief.quantity != "time" and np.all(np.diff(values) == 1.0):
            beliefs[at] = replace(belief, why="counts the samples, or milliseconds: say which")
            continue
        elif not stamped and np.mean(np.isfinite(values)) <= MOSTLY:
            continue
        if own is not None:
            chosen, time = at, own
            why = f"increases by {step:.4g} {unit} a sample"
            beliefs[at] = replace(belief, quantity="time", unit=unit, scale=CLOCKS[unit], why=why)
    for other in group:
        if other != chosen and beliefs[other].quantity == "time" and _goes_back(beliefs[other]):
            why = "goes back again and again: no clock"
            beliefs[other] = replace(beliefs[other], quantity="unknown", why=why)
    if time is None and (uneven := _of_several(beliefs, likely)) is not None:
        chosen, unit = uneven, beliefs[uneven].unit
        time = CLOCKS[unit] * beliefs[chosen].channel.values
        why = "by its name, in uneven steps"
        beliefs[chosen] = replace(beliefs[chosen], scale=CLOCKS[unit], why=why)
    if chosen is None or time is None:
        return
    _set_time(beliefs, group, time)
    for other in group:
        if other != chosen and beliefs[other].quantity == "time":
            beliefs[other] = replace(beliefs[other], quantity="unknown", why="a second clock")


def _ticks(belief: Belief) -> tuple[str | None, float]:
    """Return the unit in which a channel may be a clock, None if it is none, and its step in it."""
    unnamed = belief.quantity == "unknown"
    if belief.quantity != "time" and not unnamed:
        return None, 0.0
    # From trial to trial is no step.
    values = belief.channel.values
    ends = [begin - 1 for _, begin in belief.channel.trials if begin]
    steps = np.delete(np.diff(values), ends) if ends else np.diff(values[np.isfinite(values)])
    median = float(np.median(steps)) if len(steps) else np.nan
    # What goes one way and stays for a while has no name of a clock, nor is it one.
    forward = steps > 0 if unnamed else steps >= 0
    regular = median > 0 and np.mean(forward & (steps < 5 * median)) > MOSTLY
    units = [u for u, scale in CLOCKS.items() if STEPS[0] <= median * scale <= STEPS[1]]
    if not regular or not units:
        return None, median
    return belief.unit if belief.unit in units else units[0], median


def _of_several(beliefs: Sequence[Belief], likely: Sequence[int]) -> int | None:
    """Return the channel that has a clock's name and unit and goes on, however uneven its steps.

    As of a table to which several streams were merged by time. None, and why, if none does.
    """
    for at in likely:
        belief = beliefs[at]
        if belief.quantity != "time":
            continue
        steps = np.diff(belief.channel.values)
        if belief.unit in CLOCKS and np.mean(steps >= 0.0) > MOSTLY and (steps > 0.0).any():
            return at
    return None


def how_to_say_the_clock(beliefs: Sequence[Belief]) -> str:
    """Return a sentence with what to type that a log has for a clock, of its own names and units.

    The channel that has a clock's name goes before one that only increases, and that before all.
    """

    def rank(belief: Belief) -> tuple[bool, float]:
        steps = np.diff(belief.channel.values[np.isfinite(belief.channel.values)])
        return belief.quantity != "time", -float(np.mean(steps > 0.0)) if len(steps) else 0.0

    if not beliefs:
        return "give --rate HZ, samples a second"
    best = min(beliefs, key=rank)
    name, scale = best.channel.name, CLOCKS.get(best.unit)
    factor = "*SECONDS_PER_UNIT" if scale is None else "" if scale == 1.0 else f"*{scale:g}"
    seems = (
        f"{name} has a clock's name, but its steps are too uneven, short or long for one that is "
        "taken unasked: "
        if best.quantity == "time"
        else ""
    )
    return (
        f"{seems}give --rate HZ, samples a second, or say which channel it is, as by --as "
        f"'{name}=time{factor}'"
    )


def _goes_back(belief: Belief) -> bool:
    """Whether a channel with a clock's name is none: `t` is a torque to some."""
    steps = np.diff(belief.channel.values[np.isfinite(belief.channel.values)])
    return len(steps) > 0 and float(np.mean(steps < 0.0)) > BACK


def _stamps_positions(beliefs: Sequence[Belief], group: Sequence[int], at: int) -> bool:
    """Whether a channel has a number wherever a position of its group has one, or any other."""
    there = [beliefs[n] for n in group if beliefs[n].quantity == "position"]
    own = np.isfinite(beliefs[at].channel.values)
    others = [np.isfinite(b.channel.values) for b in there or [beliefs[n] for n in group]]
    return not any((other & ~own).any() for other in others)


def _more_even(own: Numbers, time: Numbers) -> Numbers | None:
    """Return a clock on the epoch of another, s, (n,), if it tells the same time more evenly."""
    both = np.isfinite(own) & np.isfinite(time)
    if both.sum() < 3:
        return None
    even, uneven = clock_of(own[both]), clock_of(time[both])
    late = time[both] - own[both]
    begin, near = float(np.median(late)), 5.0 / even.rate
    same = np.mean(np.abs(late - begin) <= near) > MOSTLY
    if not same or even.gaps > uneven.gaps or even.jitter > EVENER * uneven.jitter:
        return None
    return own if abs(begin) <= near else own + begin


def _in_two_columns(beliefs: list[Belief], group: list[int]) -> bool:
    """Find a clock of whole seconds and what is beside them, as stamps of ROS are written out."""
    names = {beliefs[at].channel.name: at for at in group}
    for name, at in names.items():
        found = WHOLE_SECONDS.fullmatch(name)
        rests = (
            (names.get(f"{found['stem']}{part}"), scale)
            for part, scale in PARTS.items()
            if found is not None
        )
        for rest, scale in rests:
            if rest is None:
                continue
            whole, part = beliefs[at].channel.values, beliefs[rest].channel.values
            _set_time(beliefs, group, whole + scale * part)
            why = f"whole seconds, and {beliefs[rest].channel.name} beside them"
            beliefs[at] = replace(beliefs[at], quantity="time", unit="s", why=why)
            beliefs[rest] = replace(beliefs[rest], quantity="unknown", why=f"beside {name}")
            return True
    return False


def set_rate(beliefs: list[Belief], group: list[int], rate_hz: float) -> None:
    """Give channels of one length, which have no clock, samples that follow each other evenly."""
    samples = len(beliefs[group[0]].channel.values)
    _set_time(beliefs, group, np.arange(float(samples)) / rate_hz)


def _set_time(beliefs: list[Belief], group: list[int], time: Numbers) -> None:
    """Give channels of one length their time, s, (n,)."""
    for at in group:
        belief = beliefs[at]
        beliefs[at] = replace(belief, channel=replace(belief.channel, time=time))
