"""Which signals of a log are derivatives of which, and the units that this tells."""

from collections.abc import Sequence
from dataclasses import replace
from math import pi

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d
from scipy.signal import savgol_filter

from analysis.closeloop.logs.belief import BY_NAME, CHAIN, OF_A_TOOL, Belief, is_nameless
from analysis.closeloop.logs.clock import set_rate, stretches
from analysis.closeloop.logs.log import Channel, Numbers

#: A least correlation of a channel with the derivative of another.
ALIKE = 0.9
#: The same where no clock says what the factor should be.
SURELY_ALIKE = 0.98
#: How far a factor between derivative and velocity may be off.
FACTOR_TOLERANCE = 0.15
#: What a velocity times the factor is a derivative of: position unit, velocity unit.
FACTORS: Sequence[tuple[float, str, str]] = (
    (1.0, "", "/s"),
    (180 / pi, "rad", "deg/s"),
    (pi / 180, "deg", "rad/s"),
)
#: How far the rates that several pairs say may be apart, and from a usual one, over the rate.
RATES_TOLERANCE = 0.02
#: Usual rates of logs, over a power of ten, Hz.
USUAL = (1.0, 1.25, 2.0, 2.5, 4.0, 5.0, 8.0, 10.0)
#: Most signals that are compared, each with each: of more, names alone say what they are.
MOST = 500
#: Fewest samples that are compared.
FEWEST = 50
#: Samples over which a slope is taken, a straight line's, and the weights with which it thereby
#: averages the velocity: one smoothed otherwise is another share of it the faster the motion.
SPAN = 9
_STEPS = np.arange(SPAN) - SPAN // 2
_OF_STEPS = np.append(np.cumsum(_STEPS[::-1])[::-1], 0.0) / np.sum(_STEPS**2)
AVERAGE = (_OF_STEPS[:-1] + _OF_STEPS[1:]) / 2.0
#: Least share of numbers among a channel's samples, to compare it with others.
MOSTLY = 0.5


def find_derivatives(beliefs: list[Belief], group: list[int]) -> None:
    """Find positions, velocities and accelerations: each is the derivative of the one before."""
    time = beliefs[group[0]].channel.time
    if time is None:
        return
    part = _longest(time, beliefs[group[0]].channel)
    moving = _moving(beliefs, group, part)
    if not 2 <= len(moving) <= MOST:
        return
    alike, factor = _compared(time[part], [beliefs[at].channel.values[part] for at in moving])
    alike[_of_unlike_joints([beliefs[at] for at in moving])] = 0.0
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
            why = f"{BY_NAME}, but it is the derivative of {name}"
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


def _of_unlike_joints(beliefs: Sequence[Belief]) -> NDArray[np.bool_]:
    """Return which pairs of signals, (n, n), are of two joints by their names.

    What is wanted of two joints may be the same sine at other times. Only where the names of two
    quantities are those of the same joints: some count one from 0 and the other from 1.
    """
    named: dict[tuple[str, bool], set[str]] = {}
    for belief in beliefs:
        named.setdefault((belief.quantity, belief.wanted), set()).add(belief.stem)
    joints = [named[belief.quantity, belief.wanted] for belief in beliefs]
    return np.array(
        [
            [one.stem != other.stem and of_one == of_other and "" not in of_one]
            for one, of_one in zip(beliefs, joints, strict=True)
            for other, of_other in zip(beliefs, joints, strict=True)
        ]
    ).reshape(len(beliefs), len(beliefs))


def find_rate(beliefs: list[Belief], group: list[int]) -> None:
    """Give channels without a clock the one that makes signals the derivatives of others.

    Positions and velocities without a clock differ by its rate, Hz. One pair could be alike by
    chance, or be of other units; several that say the same rate are not.
    """
    first = beliefs[group[0]].channel
    if first.time is not None:
        return
    count = np.arange(float(len(first.values)))
    part = _longest(count, first)
    moving = _moving(beliefs, group, part)
    if not 4 <= len(moving) <= MOST:
        return
    alike, factor = _compared(count[part], [beliefs[at].channel.values[part] for at in moving])
    best = np.argmax(alike, axis=1)
    mutual = np.argmax(alike, axis=0)[best] == np.arange(len(best))
    sure = mutual & (alike.max(axis=1) >= SURELY_ALIKE)
    rates = factor[sure, best[sure]]
    rate = float(np.median(rates)) if len(rates) else 0.0
    agreed = int(np.sum(np.abs(rates - rate) <= RATES_TOLERANCE * rate))
    if agreed < 2 or 2 * agreed <= len(rates):
        return
    whole = 10.0 ** np.floor(np.log10(rate)) * np.array(USUAL)
    nearest = float(whole[np.argmin(np.abs(whole - rate))])
    rate = nearest if abs(nearest - rate) <= RATES_TOLERANCE * rate else rate
    set_rate(beliefs, group, rate)


def slopes_beside(one: Channel, other: Channel) -> tuple[float, float]:
    """Return how alike the slope of a signal and another are, and how many times it that is.

    Both 0 where too few samples are known of either.
    """
    if one.time is None or len(one.values) != len(other.values):
        return 0.0, 0.0
    part = _longest(one.time, one)
    pair = [one.values[part], other.values[part]]
    if min(np.sum(np.isfinite(values)) for values in pair) < FEWEST:
        return 0.0, 0.0
    alike, factor = _compared(one.time[part], pair)
    return float(alike[0, 1]), float(factor[0, 1])


def _longest(time: Numbers, channel: Channel) -> slice:
    """Return the samples that are compared: the longest trial, or part of one clock, of a log."""
    parts = stretches(time, [at for _, at in channel.trials])
    return max(parts, key=lambda part: part.stop - part.start)


def _moving(beliefs: list[Belief], group: list[int], part: slice) -> list[int]:
    """Return the channels that may be positions or their derivatives, and have such samples."""
    # Lines of a topic that has no position have no stamp of it either.
    time = beliefs[group[0]].channel.time
    timed = np.isfinite(time[part]) if time is not None else np.ones(part.stop - part.start, bool)
    if timed.sum() < FEWEST:
        return []
    return [
        at
        for at in group
        if (
            beliefs[at].quantity in CHAIN
            or (
                beliefs[at].quantity == "unknown"
                and beliefs[at].unit == "?"
                and beliefs[at].why != OF_A_TOOL
                and is_nameless(beliefs[at].channel)
            )
        )
        and np.mean(np.isfinite(beliefs[at].channel.values[part][timed])) > MOSTLY
    ]


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
    smooth = convolve1d(table, AVERAGE, axis=0, mode="nearest")
    slopes = savgol_filter(table, SPAN, 1, deriv=1, delta=float(even[1] - even[0]), axis=0)
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
    time = position.channel.time
    assert time is not None
    part = _longest(time, position.channel)
    pair = [position.channel.values[part], velocity.channel.values[part]]
    factor = _compared(time[part], pair)[1][0, 1]
    unit = next(u for u in FACTORS if abs(factor / u[0] - 1.0) <= FACTOR_TOLERANCE)
    if unit[1]:
        beliefs[chain[0]] = replace(position, unit=unit[1])
        beliefs[chain[1]] = replace(velocity, unit=unit[2])
    elif position.unit != "?" and velocity.unit == "?":
        beliefs[chain[1]] = replace(velocity, unit=f"{position.unit}/s")
    elif velocity.unit.endswith("/s") and position.unit == "?":
        beliefs[chain[0]] = replace(position, unit=velocity.unit.removesuffix("/s"))
