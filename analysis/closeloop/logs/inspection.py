"""What a log most likely holds: clocks, rates, gaps, and which channel is which signal of a joint.

A belief comes from the log's own words where it has some, and from physics otherwise: the
derivative of a position is a velocity, and the factor between them tells degrees from radians. What
numbers cannot tell (a torque from a current, radians from degrees of a small motion) keeps a "?".
"""

from collections.abc import Collection, Sequence
from dataclasses import replace
from math import pi

import numpy as np

from analysis.closeloop.logs.belief import (
    SIGNALS,
    Belief,
    by_name,
    desired,
    held,
    without_parts_of_efforts,
    without_words_of_quantities,
)
from analysis.closeloop.logs.blocks import find_blocks
from analysis.closeloop.logs.clock import find_clock, set_rate
from analysis.closeloop.logs.derivatives import FEWEST, find_derivatives, find_rate
from analysis.closeloop.logs.joints import as_positions, numbered_as_positions
from analysis.closeloop.logs.log import Log, Numbers
from analysis.closeloop.logs.tools import without_tools
from analysis.closeloop.logs.variants import without_dead, without_forms
from analysis.closeloop.unit_names import HERTZ, UNITS
from intake.xml import listed

#: More than that of an angle in rad is two turns either way; a joint seldom does it.
TURNS = 4 * pi
#: Arrays with fewer numbers than this share of the longest, and than are compared, are no signals.
SHORT = 0.1
#: Share of a position's samples that are compared with it.
MOSTLY = 0.99


@np.errstate(over="ignore", invalid="ignore")
def believe(log: Log, rate_hz: float | None = None, known: Collection[str] = ()) -> list[Belief]:
    """Return what each channel of the log is taken for, in the log's order.

    Args:
        log: what a file holds.
        rate_hz: at which channels without a clock were recorded, if that is known.
        known: names of the model's joints.
    """
    named = without_parts_of_efforts(desired([by_name(channel) for channel in log.channels]))
    beliefs = as_positions(without_words_of_quantities(without_tools(named)), known)
    beliefs = numbered_as_positions(beliefs)
    groups: dict[object, list[int]] = {}
    for at, belief in enumerate(beliefs):
        time = belief.channel.time
        key = len(belief.channel.values) if time is None else time.tobytes()
        groups.setdefault(key, []).append(at)
    most = max((len(belief.channel.values) for belief in beliefs), default=0)
    for group in groups.values():
        if len(beliefs[group[0]].channel.values) < min(FEWEST, SHORT * most):
            _set_apart(beliefs, group)
            continue
        find_clock(beliefs, group)
        if rate_hz is None:
            find_rate(beliefs, group)
        elif beliefs[group[0]].channel.time is None:
            set_rate(beliefs, group, rate_hz)
        find_derivatives(beliefs, group)
    find_blocks(beliefs)
    beliefs = [held(belief) for belief in beliefs]
    _find_units(beliefs)
    without_forms(beliefs)
    _number_joints(beliefs)
    without_dead(beliefs)
    return beliefs


def _set_apart(beliefs: list[Belief], group: list[int]) -> None:
    """Take arrays for no signal that are too short to be one of the log: a model's parameters."""
    for at in group:
        channel = beliefs[at].channel
        why = f"holds {len(channel.values)} numbers, too few for a signal of this log"
        beliefs[at] = Belief(channel=channel, quantity="unknown", why=why)


def of_rates(log: Log, beliefs: Sequence[Belief]) -> list[str]:
    """Say of a log without a clock at which rate it seems to be, and how to say another, Hz."""
    times = [
        belief.channel.time
        for channel, belief in zip(log.channels, beliefs, strict=True)
        if channel.time is None
    ]
    if any(belief.quantity == "time" for belief in beliefs) or not times:
        return []
    if all(time is None for time in times):
        return ["no channel is a clock, and none tells a rate: give --rate HZ, samples a second"]
    rates = sorted({1.0 / float(time[1]) for time in times if time is not None})
    return [
        f"no channel is a clock; velocities over the differences of positions say "
        f"{', '.join(f'{rate:.4g} Hz' for rate in rates)}: if that is wrong, give --rate"
    ]


def of_hertz(beliefs: Sequence[Belief]) -> list[str]:
    """Say what is done with velocities in Hz."""
    names = [b.channel.name for b in beliefs if b.quantity == "velocity" and b.unit == HERTZ]
    if not names:
        return []
    return [
        f"{listed(names)} {'is' if len(names) == 1 else 'are'} taken for turns a second, and made "
        "rad/s by 2 pi: for another factor say --as 'CHANNEL=JOINT.velocity*FACTOR_TO_SI'"
    ]


def of_turns(beliefs: Sequence[Belief]) -> list[str]:
    """Ask of positions that are as likely in radians as in degrees: of what turns on and on."""
    found = []
    for belief in beliefs:
        values = belief.channel.values[np.isfinite(belief.channel.values)]
        if belief.quantity != "position" or belief.unit != "deg?" or belief.joint is None:
            continue
        if np.ptp(values) * pi / 180 > TURNS:
            way, name = float(np.ptp(values)), belief.channel.name
            found.append(
                f"{name} goes through {way:.4g}: a motor that turns on and on does so in degrees "
                f"({way / 360:.3g} turns) and in radians ({way / 2 / pi:.3g}), a joint with a "
                f"range in neither; which is it? If in radians, say --as "
                f"'{name}=JOINT.position*1', and of its velocity, too"
            )
    return found


def of_no_joint(beliefs: Sequence[Belief]) -> list[str]:
    """Say of a log that none of its channels seems to be a joint's."""
    if any(belief.joint is not None for belief in beliefs):
        return []
    return [
        "no channel seems to be the position, velocity, acceleration or effort of a joint: say "
        "--as 'CHANNEL=JOINT.QUANTITY' of each that is"
    ]


def is_in_degrees(angles: Numbers) -> bool:
    """Whether angles, (n,), are too large for rad; one glitch makes no degrees."""
    whole = np.abs(angles[np.isfinite(angles)])
    return len(whole) > 0 and bool(np.quantile(whole, MOSTLY) > TURNS)


def _find_units(beliefs: list[Belief]) -> None:
    """Guess angles of unknown unit by their size, with a "?", and say what each unit is in SI."""
    unsure = [b for b in beliefs if b.quantity == "position" and b.unit == "?"]
    unit = "deg" if any(is_in_degrees(b.channel.values) for b in unsure) else "rad"
    guesses = {"position": f"{unit}?", "velocity": f"{unit}/s?"}
    for at, belief in enumerate(beliefs):
        own = belief.unit
        if own == "?" and (belief.quantity == "position" or belief.source is not None):
            own = guesses.get(belief.quantity, own)
        known = UNITS.get(own.rstrip("?"))
        beliefs[at] = replace(belief, unit=own, scale=known.scale if known else 1.0)


def _number_joints(beliefs: list[Belief]) -> None:
    """Give every signal its joint: by name, by whose derivative it is, else in the log's order.

    Where all positions are numbered, whatever ends in such a number is of that joint.
    """
    _count_alike(beliefs)
    numbers = {b.stem for b in beliefs if b.quantity == "position" and not b.wanted}
    numbered = bool(numbers) and all(stem.isdigit() for stem in numbers)
    joints = {n: rank for rank, n in enumerate(sorted(numbers, key=int))} if numbered else {}
    motion = ("position", "velocity", "acceleration", "effort", "current")
    own = [at for at, b in enumerate(beliefs) if b.quantity in motion]
    # A motor's current beside efforts may go without a joint's name, and so may a command.
    spare = "current" if any(b.quantity == "effort" for b in beliefs) else ""
    named = all(
        beliefs[at].stem for at in own if beliefs[at].quantity != spare and not beliefs[at].wanted
    )
    counts: dict[tuple[str, bool], int] = {}
    for at in sorted(own, key=lambda at: motion.index(beliefs[at].quantity)):
        belief = beliefs[at]
        key = belief.quantity, belief.wanted
        source = beliefs[belief.source] if belief.source is not None else None
        if named and belief.stem:
            number = belief.stem.rpartition("_")[2]
            belief = replace(belief, stem=number) if numbered and number in joints else belief
            joint = joints.setdefault(belief.stem, len(joints))
        elif source is not None and source.joint is not None:
            joint = source.joint
        else:
            joint = counts.get(key, 0)
        counts[key] = counts.get(key, 0) + 1
        beliefs[at] = replace(belief, joint=joint)


def _count_alike(beliefs: list[Belief]) -> None:
    """Number what counts the joints from 0 as the positions do that count from 1, or the other way.

    Only as many signals of a quantity as there are positions are those of the same joints.
    """
    groups: dict[tuple[str, bool, str], dict[int, int]] = {}
    for at, belief in enumerate(beliefs):
        before, _, number = belief.stem.rpartition("_")
        if belief.quantity in (*SIGNALS, "current") and number.isdigit():
            groups.setdefault((belief.quantity, belief.wanted, before), {})[at] = int(number)
    having = [key for key in groups if key[:2] == ("position", False)]
    for (_, _, before), group in groups.items():
        same = [key for key in having if key[2] == before] or having
        if len(same) != 1 or len(group) < 2:
            continue
        first, own = min(groups[same[0]].values()), min(group.values())
        numbers = [*range(first, first + len(group))]
        alike = sorted(groups[same[0]].values()) == numbers
        alike &= sorted(number + first - own for number in group.values()) == numbers
        if not alike or {first, own} != {0, 1}:
            continue
        for at in group:
            stem = f"{before}_{group[at] + first - own}".lstrip("_")
            why = f"{beliefs[at].why}; counts from {own}, positions from {first}"
            beliefs[at] = replace(beliefs[at], stem=stem, why=why)
