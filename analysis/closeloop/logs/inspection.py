"""What a log most likely holds: clocks, rates, gaps, and which channel is which signal of a joint.

A belief comes from the log's own words where it has some, and from physics otherwise: a channel
that another one is the derivative of is a velocity, and the factor between them tells degrees from
radians. A torque cannot be told from a current by its numbers, so nobody claims to.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import pi

import numpy as np
from scipy.signal import savgol_filter

from analysis.closeloop.logs.log import Channel, Log, Numbers

#: What a clock's median step, s, may be for a recording of joints.
STEPS = (1e-5, 0.2)
CLOCKS: Mapping[str, float] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
#: Words that name a quantity, as they stand between other characters than letters.
WORDS: Mapping[str, tuple[str, ...]] = {
    "time": ("time", "timestamp", "stamp", "t", "sec", "secs", "clock"),
    "position": ("position", "pos", "q", "angle", "theta", "theta1", "theta2", "qm"),
    "velocity": ("velocity", "vel", "qd", "dq", "qdot", "speed", "omega"),
    "acceleration": ("acceleration", "acc", "qdd", "ddq", "qddot"),
    "effort": ("effort", "eff", "torque", "tau", "force", "trq", "moment"),
    "current": ("current", "curr", "i", "amp", "amps"),
}
#: Words of a channel that was wanted and not measured.
WANTED = ("ref", "reference", "des", "desired", "target", "cmd", "command", "setpoint", "goal")
#: A least correlation of a channel with the derivative of another.
ALIKE = 0.9
#: How far a factor between derivative and velocity may be off.
FACTOR_TOLERANCE = 0.15
#: What a velocity times the factor is a derivative of: position unit, velocity unit.
FACTORS: Sequence[tuple[float, str, str]] = (
    (1.0, "", "/s"),
    (180 / pi, "rad", "deg/s"),
    (pi / 180, "deg", "rad/s"),
)
SI: Mapping[str, float] = {"deg": pi / 180, "deg/s": pi / 180, "mm": 1e-3, "mA": 1e-3}
#: More than that of an angle in rad is two turns either way; a joint seldom does it.
TURNS = 4 * pi


@dataclass(frozen=True, kw_only=True)
class Belief:
    """What a channel is taken for."""

    channel: Channel
    #: A key of `WORDS`, "constant" or "unknown".
    quantity: str
    #: As recorded; "?" where numbers cannot tell.
    unit: str = "?"
    #: Times this it is in SI units.
    scale: float = 1.0
    #: Position of the joint among the log's joints, from 0; None if it belongs to none.
    joint: int | None = None
    #: Wanted, not measured.
    wanted: bool = False
    why: str = ""


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
        repeated=int(np.sum(steps <= 0)),
    )


def believe(log: Log) -> list[Belief]:
    """Return what each channel of the log is taken for, in the log's order."""
    beliefs = [_by_name(channel) for channel in log.channels]
    groups: dict[object, list[int]] = {}
    for at, belief in enumerate(beliefs):
        time = belief.channel.time
        key = len(belief.channel.values) if time is None else time.tobytes()
        groups.setdefault(key, []).append(at)
    for group in groups.values():
        _find_clock(beliefs, group)
        _find_derivatives(beliefs, group)
    _find_blocks(beliefs)
    _find_units(beliefs)
    _number_joints(beliefs)
    return beliefs


def _by_name(channel: Channel) -> Belief:
    words = [word for word in re.split(r"[^A-Za-z]+", channel.name.lower()) if word]
    finite = channel.values[np.isfinite(channel.values)]
    if len(finite) == 0 or np.ptp(finite) == 0.0:
        return Belief(channel=channel, quantity="constant", why="never changes")
    wanted = any(word in WANTED for word in words)
    for quantity, names in WORDS.items():
        if any(word in names for word in words):
            return Belief(
                channel=channel,
                quantity=quantity,
                unit=channel.unit or _unit_in(channel.name),
                wanted=wanted,
                why="by its name",
            )
    return Belief(channel=channel, quantity="unknown", wanted=wanted)


def _unit_in(name: str) -> str:
    """Return the unit at the end of a name such as `angle_deg` or `torque [Nm]`, or "?"."""
    found = re.search(r"[_\s(\[](deg[_/]s|rad[_/]s|m[_/]s|deg|rad|mm|m|Nm|N|mA|A)[)\]]?$", name)
    return found[1].replace("_", "/") if found else "?"


def _find_clock(beliefs: list[Belief], group: list[int]) -> None:
    """Find the clock of channels of one length, unless they came with one."""
    if beliefs[group[0]].channel.time is not None:
        return
    for at in sorted(group, key=lambda at: beliefs[at].quantity != "time"):
        belief = beliefs[at]
        if belief.quantity not in ("time", "unknown"):
            continue
        steps = np.diff(belief.channel.values)
        median = float(np.median(steps))
        regular = median > 0 and np.mean((steps >= 0) & (steps < 5 * median)) > 0.98
        units = [u for u, scale in CLOCKS.items() if STEPS[0] <= median * scale <= STEPS[1]]
        if not regular or not units:
            continue
        unit = units[0]
        beliefs[at] = replace(
            belief,
            quantity="time",
            unit=unit,
            scale=CLOCKS[unit],
            why=f"increases by {median:.4g} {unit} a sample",
        )
        time = CLOCKS[unit] * belief.channel.values
        for other in group:
            beliefs[other] = replace(
                beliefs[other], channel=replace(beliefs[other].channel, time=time)
            )
            if other != at and beliefs[other].quantity == "time":
                beliefs[other] = replace(beliefs[other], quantity="unknown", why="a second clock")
        return


def _find_derivatives(beliefs: list[Belief], group: list[int]) -> None:
    """Pair positions and velocities: one is the derivative of the other."""
    moving = [
        at
        for at in group
        if beliefs[at].quantity in ("unknown", "position", "velocity")
        and beliefs[at].channel.time is not None
        and np.isfinite(beliefs[at].channel.values).all()
    ]
    if len(moving) < 2 or len(beliefs[moving[0]].channel.values) < 50:
        return
    time = beliefs[moving[0]].channel.time
    assert time is not None
    time, first_at = np.unique(time, return_index=True)
    even = np.linspace(time[0], time[-1], len(time))
    step = float(even[1] - even[0])
    values = np.column_stack(
        [np.interp(even, time, beliefs[at].channel.values[first_at]) for at in moving]
    )
    smooth = savgol_filter(values, 9, 2, axis=0)
    slopes = savgol_filter(values, 9, 2, deriv=1, delta=step, axis=0)
    smooth, slopes = smooth - smooth.mean(axis=0), slopes - slopes.mean(axis=0)
    norms = np.linalg.norm(slopes, axis=0)[:, None] * np.linalg.norm(smooth, axis=0)[None, :]
    with np.errstate(invalid="ignore", divide="ignore"):
        alike = np.nan_to_num((slopes.T @ smooth) / norms)
        factor = (slopes.T @ smooth) / np.sum(slopes**2, axis=0)[:, None]
    np.fill_diagonal(alike, 0.0)
    free_position, free_velocity = set(range(len(moving))), set(range(len(moving)))
    # A velocity that was wanted follows the derivative, too: what was measured does so closer.
    for flat in np.argsort(-alike, axis=None):
        i, j = divmod(int(flat), len(moving))
        if alike[i, j] < ALIKE:
            break
        if i not in free_position or j not in free_velocity or i == j:
            continue
        first, second = beliefs[moving[i]], beliefs[moving[j]]
        if first.quantity == "velocity" or second.quantity == "position":
            continue
        unit = next(
            (u for u in FACTORS if abs(factor[i, j] / u[0] - 1.0) <= FACTOR_TOLERANCE), None
        )
        if unit is None:
            continue
        own = unit[1] or first.unit
        beliefs[moving[i]] = replace(
            first,
            quantity="position",
            unit=own,
            why=first.why or f"{second.channel.name} is its derivative",
        )
        beliefs[moving[j]] = replace(
            second,
            quantity="velocity",
            unit=unit[2] if unit[1] else f"{own}/s",
            why=f"{factor[i, j]:.3g} times the derivative of {first.channel.name}",
        )
        free_position -= {i, j}
        free_velocity -= {i, j}


def _find_units(beliefs: list[Belief]) -> None:
    """Settle angles of unknown unit by their size, and what each unit is in SI."""
    angles = [b for b in beliefs if b.quantity == "position" and b.unit == "?"]
    largest = max((float(np.nanmax(np.abs(b.channel.values))) for b in angles), default=0.0)
    unit = "deg" if largest > TURNS else "rad"
    for at, belief in enumerate(beliefs):
        if belief.quantity not in ("position", "velocity"):
            continue
        own = belief.unit.replace("?", unit)
        why = belief.why
        if own != belief.unit and unit == "deg":
            why += f", reaches {largest:.3g}: degrees"
        beliefs[at] = replace(belief, unit=own, scale=SI.get(own, 1.0), why=why.lstrip(", "))


def _number_joints(beliefs: list[Belief]) -> None:
    """Give measured positions their joints in order, and velocities those of their positions."""
    counts: dict[tuple[str, bool], int] = {}
    for at, belief in enumerate(beliefs):
        if belief.quantity in ("position", "velocity", "acceleration", "effort", "current"):
            key = belief.quantity, belief.wanted
            beliefs[at] = replace(belief, joint=counts.get(key, 0))
            counts[key] = counts.get(key, 0) + 1


def _find_blocks(beliefs: list[Belief]) -> None:
    """In a log without words, read the joints that hardly move, and the efforts, off the layout.

    Such logs hold all positions, then all velocities, then torques or currents, joint by joint: the
    distance between a position and its velocity is the number of joints.
    """
    if any(b.why == "by its name" for b in beliefs):
        return
    position = [at for at, b in enumerate(beliefs) if b.quantity == "position"]
    velocity = [at for at, b in enumerate(beliefs) if b.quantity == "velocity"]
    distances = {v - p for p, v in zip(position, velocity, strict=False)}
    if len(position) != len(velocity) or len(distances) != 1 or (joints := distances.pop()) < 1:
        return
    clocks = [at for at, b in enumerate(beliefs) if b.quantity == "time" and at < position[0]]
    start = clocks[-1] + 1 if clocks else 0
    if position[-1] - start >= joints:
        start = position[0]
    unit = beliefs[position[0]].unit
    for quantity, offset, own in (
        ("position", 0, unit),
        ("velocity", joints, beliefs[velocity[0]].unit),
        ("effort", 2 * joints, "?"),
    ):
        for at in range(start + offset, min(start + offset + joints, len(beliefs))):
            if beliefs[at].quantity in ("unknown", "constant"):
                what = "torque or current" if quantity == "effort" else quantity
                beliefs[at] = replace(
                    beliefs[at],
                    quantity=quantity,
                    unit=own,
                    why=f"stands where the {what} of joint {at - start - offset + 1} should",
                )
