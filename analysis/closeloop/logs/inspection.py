"""What a log most likely holds: clocks, rates, gaps, and which channel is which signal of a joint.

A belief comes from the log's own words where it has some, and from physics otherwise: the
derivative of a position is a velocity, and the factor between them tells degrees from radians. What
numbers cannot tell (a torque from a current, radians from degrees of a small motion) keeps a "?".
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
#: Words that name a quantity.
WORDS: Mapping[str, tuple[str, ...]] = {
    "time": ("time", "timestamp", "stamp", "t", "sec", "secs", "clock"),
    "position": ("position", "pos", "q", "angle", "theta"),
    "velocity": ("velocity", "vel", "qd", "dq", "v", "qdot", "speed", "omega"),
    "acceleration": ("acceleration", "acc", "qdd", "ddq", "qddot"),
    "effort": ("effort", "eff", "torque", "tau", "force", "trq", "moment"),
    "current": ("current", "curr", "i", "amp", "amps"),
}
#: Words of a name that say nothing of the joint.
UNITS = ("deg", "rad", "s", "mm", "m", "nm", "n", "ma", "a", "measured", "actual", "data")
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
#: Derivatives of a position, in order.
CHAIN = ("position", "velocity", "acceleration")
#: Least share of numbers among a channel's samples, to compare it with others.
MOSTLY = 0.5
#: More than that of an angle in rad is two turns either way; a joint seldom does it.
TURNS = 4 * pi


@dataclass(frozen=True, kw_only=True)
class Belief:
    """What a channel is taken for."""

    channel: Channel
    #: A key of `WORDS`, "constant" or "unknown".
    quantity: str
    #: As recorded; with a "?" where numbers cannot tell.
    unit: str = "?"
    #: Times this it is in SI units.
    scale: float = 1.0
    #: Number of the joint among the log's joints, from 0; None if it belongs to none.
    joint: int | None = None
    #: What is left of the channel's name without quantity and unit; empty if nothing is.
    stem: str = ""
    #: Place, in the log, of the channel whose derivative it is.
    source: int | None = None
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


def _tokens(name: str) -> list[str]:
    return re.findall(r"[^\W\d_]+|\d+", name.lower())


def _by_name(channel: Channel) -> Belief:
    words = _tokens(channel.name)
    finite = channel.values[np.isfinite(channel.values)]
    if len(finite) < 2:
        return Belief(channel=channel, quantity="unknown", why="holds hardly a number")
    if np.ptp(finite) == 0.0:
        return Belief(channel=channel, quantity="constant", why="never changes")
    wanted = any(word in WANTED for word in words)
    for quantity, names in WORDS.items():
        if any(word in names for word in words):
            spare = {*names, *WANTED, *UNITS}
            return Belief(
                channel=channel,
                quantity=quantity,
                unit=channel.unit or _unit_in(channel.name),
                wanted=wanted,
                stem="_".join(word for word in words if word not in spare),
                why="by its name",
            )
    return Belief(channel=channel, quantity="unknown", wanted=wanted)


def _is_nameless(channel: Channel) -> bool:
    """Whether a name says nothing: `column 3`, `x1`, `signals[2]`."""
    words = [word for word in _tokens(channel.name) if not word.isdigit()]
    return all(len(word) <= 2 or word in ("column", "signal", "signals", "data") for word in words)


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
        if belief.quantity == "unknown" and np.all(steps == 1.0):
            beliefs[at] = replace(belief, why="counts the samples, or milliseconds: say which")
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
    """Find positions, velocities and accelerations: each is the derivative of the one before."""
    moving = [
        at
        for at in group
        if beliefs[at].quantity in CHAIN
        or (beliefs[at].quantity == "unknown" and _is_nameless(beliefs[at].channel))
    ]
    moving = [at for at in moving if np.mean(np.isfinite(beliefs[at].channel.values)) > MOSTLY]
    time = beliefs[group[0]].channel.time
    if time is None or len(moving) < 2 or len(time) < 50:
        return
    alike, factor = _compared(time, [beliefs[at].channel.values for at in moving])
    has_derivative: set[int] = set()
    is_derivative: set[int] = set()
    # What was measured is closer to the derivative than what was wanted; of equals, the first.
    for flat in np.argsort(-np.round(alike, 3), axis=None, kind="stable"):
        i, j = divmod(int(flat), len(moving))
        if alike[i, j] < ALIKE:
            break
        if i in has_derivative or j in is_derivative:
            continue
        if not any(abs(factor[i, j] / u[0] - 1.0) <= FACTOR_TOLERANCE for u in FACTORS):
            continue
        first, second = beliefs[moving[i]].quantity, beliefs[moving[j]].quantity
        if "unknown" not in (first, second) and CHAIN.index(second) != CHAIN.index(first) + 1:
            name = beliefs[moving[i]].channel.name
            why = f"by its name, but it is the derivative of {name}"
            beliefs[moving[j]] = replace(beliefs[moving[j]], why=why)
            continue
        has_derivative.add(i)
        is_derivative.add(j)
        beliefs[moving[j]] = replace(
            beliefs[moving[j]],
            source=moving[i],
            why=f"{factor[i, j]:.3g} times the derivative of {beliefs[moving[i]].channel.name}",
        )
    for i in has_derivative - is_derivative:
        _name_chain(beliefs, moving[i])


def _compared(time: Numbers, values: Sequence[Numbers]) -> tuple[Numbers, Numbers]:
    """Return how alike the derivative of each signal and every other are, and their factor.

    Args:
        time: s, shape (n,).
        values: signals, (n,) each; NaN where a sample is missing.

    Returns:
        Correlations and factors, shape (signals, signals): row i has the derivative of signal i.
    """
    even = np.linspace(np.nanmin(time), np.nanmax(time), len(time))
    order = np.argsort(time, kind="stable")
    columns = []
    for signal in values:
        known = order[np.isfinite(signal[order]) & np.isfinite(time[order])]
        columns.append(np.interp(even, time[known], signal[known]))
    table = np.column_stack(columns)
    smooth = savgol_filter(table, 9, 2, axis=0)
    slopes = savgol_filter(table, 9, 2, deriv=1, delta=float(even[1] - even[0]), axis=0)
    smooth, slopes = smooth - smooth.mean(axis=0), slopes - slopes.mean(axis=0)
    both = slopes.T @ smooth
    norms = np.linalg.norm(slopes, axis=0)[:, None] * np.linalg.norm(smooth, axis=0)[None, :]
    with np.errstate(invalid="ignore", divide="ignore"):
        alike = np.nan_to_num(both / norms, posinf=0.0, neginf=0.0)
        factor = np.nan_to_num(both / np.sum(slopes**2, axis=0)[:, None])
    np.fill_diagonal(alike, 0.0)
    return alike, factor


def _name_chain(beliefs: list[Belief], start: int) -> None:
    """Name a signal, its derivative and the derivative of that, and settle their units."""
    chain = [start]
    while later := [at for at, b in enumerate(beliefs) if b.source == chain[-1]]:
        chain.append(later[0])
        if len(chain) == len(CHAIN):
            break
    known = next((k for k, at in enumerate(chain) if beliefs[at].quantity in CHAIN), None)
    first = 0 if known is None else CHAIN.index(beliefs[chain[known]].quantity) - known
    for number, at in enumerate(chain):
        belief = beliefs[at]
        if not 0 <= first + number < len(CHAIN):
            continue
        why = belief.why or f"{beliefs[chain[1]].channel.name} is its derivative"
        beliefs[at] = replace(belief, quantity=CHAIN[first + number], why=why)
    if first == 0:
        _settle_units(beliefs, chain)


def _settle_units(beliefs: list[Belief], chain: list[int]) -> None:
    """Tell degrees from radians by the factor between a position and its velocity."""
    position, velocity = beliefs[chain[0]], beliefs[chain[1]]
    assert position.channel.time is not None
    pair = [position.channel.values, velocity.channel.values]
    factor = _compared(position.channel.time, pair)[1][0, 1]
    unit = next(u for u in FACTORS if abs(factor / u[0] - 1.0) <= FACTOR_TOLERANCE)
    if unit[1]:
        beliefs[chain[0]] = replace(position, unit=unit[1])
        beliefs[chain[1]] = replace(velocity, unit=unit[2])
    elif position.unit != "?" and velocity.unit == "?":
        beliefs[chain[1]] = replace(velocity, unit=f"{position.unit}/s")
    elif velocity.unit.endswith("/s") and position.unit == "?":
        beliefs[chain[0]] = replace(position, unit=velocity.unit.removesuffix("/s"))


def _find_units(beliefs: list[Belief]) -> None:
    """Guess angles of unknown unit by their size, with a "?", and say what each unit is in SI."""
    unsure = [b for b in beliefs if b.quantity == "position" and b.unit == "?"]
    largest = max((float(np.nanmax(np.abs(b.channel.values))) for b in unsure), default=0.0)
    unit = "deg" if largest > TURNS else "rad"
    guesses = {"position": f"{unit}?", "velocity": f"{unit}/s?"}
    for at, belief in enumerate(beliefs):
        own = belief.unit
        if own == "?" and (belief.quantity == "position" or belief.source is not None):
            own = guesses.get(belief.quantity, own)
        beliefs[at] = replace(belief, unit=own, scale=SI.get(own.rstrip("?"), 1.0))


def _number_joints(beliefs: list[Belief]) -> None:
    """Give every signal its joint: by name, by whose derivative it is, else in the log's order."""
    joints: dict[str, int] = {}
    motion = ("position", "velocity", "acceleration", "effort", "current")
    own = [at for at, b in enumerate(beliefs) if b.quantity in motion]
    named = all(beliefs[at].stem for at in own)
    counts: dict[tuple[str, bool], int] = {}
    for at in sorted(own, key=lambda at: motion.index(beliefs[at].quantity)):
        belief = beliefs[at]
        key = belief.quantity, belief.wanted
        source = beliefs[belief.source] if belief.source is not None else None
        if named:
            joint = joints.setdefault(belief.stem, len(joints))
        elif source is not None and source.joint is not None:
            joint = source.joint
        else:
            joint = counts.get(key, 0)
        counts[key] = counts.get(key, 0) + 1
        beliefs[at] = replace(belief, joint=joint)


def _find_blocks(beliefs: list[Belief]) -> None:
    """In a log without words, read the joints that hardly move, and the efforts, off the layout.

    Such logs hold all positions, then all velocities, then torques or currents, joint by joint: the
    distance between a position and its velocity is the number of joints.
    """
    if any(b.why == "by its name" for b in beliefs):
        return
    position = [at for at, b in enumerate(beliefs) if b.quantity == "position"]
    velocity = [at for at, b in enumerate(beliefs) if b.quantity == "velocity"]
    distances = {at - (beliefs[at].source or 0) for at in velocity}
    if len(position) != len(velocity) or len(distances) != 1 or (joints := distances.pop()) < 1:
        return
    if any(b.quantity == "acceleration" for b in beliefs):
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
