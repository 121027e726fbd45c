"""What a user says of a log's channels, which goes before what they seem to be."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

from analysis.closeloop.logs.belief import SIGNALS, Belief
from analysis.closeloop.logs.inspection import is_in_degrees
from analysis.closeloop.logs.joints import joint_name, joint_names
from analysis.closeloop.unit_names import UNITS
from intake.xml import all_listed

#: What a line that assigns a channel looks like: "column 14=elbow.effort*11.976", "u_V=-".
ASSIGNMENT = re.compile(
    r"(?P<channel>.+)=(?:(?P<joint>[^=*]+)\.(?P<quantity>\w+)|(?P<time>time)|-)(?:\*(?P<scale>.+))?"
)
#: Why a channel is what a user says.
AS_SAID = "as you said"


def assigned(
    beliefs: Sequence[Belief], lines: Sequence[str], known: Sequence[str] = ()
) -> tuple[list[Belief], list[str]]:
    """Return beliefs after what the user knows better, and the names of the joints.

    Channels of which nothing is said keep the joints that they seem to be of.

    Args:
        beliefs: what each channel seems to be.
        lines: CHANNEL=JOINT.QUANTITY[*SCALE], CHANNEL=time[*SCALE] or CHANNEL=-, which leaves the
            channel out.
        known: the joints of the model.

    Raises:
        ValueError: a line is wrong.
    """
    chosen = list(beliefs)
    called: dict[int, str] = {}
    for line in lines:
        match = ASSIGNMENT.fullmatch(line)
        at = {b.channel.name: i for i, b in enumerate(chosen)}.get(
            match["channel"] if match else ""
        )
        if match is None:
            raise ValueError(
                f"{line!r} is no assignment of a channel: write NAME=JOINT.QUANTITY*SCALE, with "
                f"one of {', '.join(SIGNALS)}, or NAME=time*SCALE, or NAME=-"
            )
        if at is None:
            has = all_listed(belief.channel.name for belief in beliefs)
            raise ValueError(
                f"{line!r} is no assignment of a channel: the log has no {match['channel']!r}, "
                f"but {has}"
            )
        if match["quantity"] and match["quantity"] not in SIGNALS:
            raise ValueError(f"{line!r}: take {', '.join(SIGNALS)}, not {match['quantity']!r}")
        try:
            scale = float(match["scale"] or 1.0)
        except ValueError:
            raise ValueError(f"{line!r}: {match['scale']!r} is no number") from None
        called.pop(at, None)
        if match["joint"]:
            called[at] = match["joint"]
        chosen[at] = replace(
            chosen[at],
            quantity=match["quantity"] or match["time"] or "unknown",
            unit="SI",
            scale=scale,
            joint=None,
            wanted=False,
            why=AS_SAID,
        )
        if match["time"]:
            _set_clock(chosen, at)
    # What is left out counts for no joint.
    seen = [beliefs[at] if at in called else belief for at, belief in enumerate(chosen)]
    names = joint_names(seen, known)
    numbers = _numbered(seen, called, names, known)
    for at, name in called.items():
        chosen[at] = replace(chosen[at], joint=numbers[name])
    return chosen, names


def _numbered(
    beliefs: Sequence[Belief], called: Mapping[int, str], names: list[str], known: Sequence[str]
) -> dict[str, int]:
    """Return the numbers of the joints that channels are said to be of, and name them in place.

    A name that neither log nor model has is a better one for the joint that all its channels seem
    to be of, if the model has none for that; else it is that of a new joint.

    Args:
        beliefs: before what was said.
        called: for places in `beliefs` the joint that was said.
        names: of the joints that the log seems to have.
        known: the joints of the model.
    """
    in_log = {
        name: belief.joint
        for belief in beliefs
        if belief.joint is not None and (name := joint_name(belief))
    }
    numbers = in_log | {name: number for number, name in enumerate(names)}
    new: dict[str, set[int]] = {name: set() for name in called.values() if name not in numbers}
    for at, name in called.items():
        joint = beliefs[at].joint
        if name in new and joint is not None:
            new[name].add(joint)
    claims = Counter(joint for joints in new.values() for joint in joints)
    for name, joints in new.items():
        free = [n for n in joints if claims[n] == len(joints) == 1 and names[n] not in known]
        if free:
            names[free[0]] = name
        else:
            names.append(name)
        numbers[name] = free[0] if free else len(names) - 1
    return numbers


def of_factors(beliefs: Sequence[Belief], lines: Sequence[str]) -> list[str]:
    """Say of channels that were assigned without a factor that they seem to be in no SI unit.

    Args:
        beliefs: before what the user knows better.
        lines: as `assigned` takes them.
    """
    by_name = {belief.channel.name: belief for belief in beliefs}
    said = []
    for match in filter(None, map(ASSIGNMENT.fullmatch, lines)):
        belief, quantity = by_name[match["channel"]], match["quantity"] or match["time"]
        unit, factor = belief.unit.rstrip("?"), f"{belief.scale:.6g}"
        of_unit = UNITS[unit].quantity if unit in UNITS else ""
        if (quantity, of_unit) == ("effort", "current"):
            factor = f"NM_PER_{unit}"
        elif quantity == "position" != of_unit and is_in_degrees(belief.channel.values):
            unit, factor = "deg", f"{UNITS['deg'].scale:.6g}"
        elif quantity not in (belief.quantity, of_unit):
            continue
        if match["scale"] is None and factor != "1":
            said.append(
                f"{belief.channel.name} seems to be in {unit}, and without a factor was taken for "
                f"SI units: if it is in {unit}, say --as '{match[0]}*{factor}'"
            )
    return said


def _set_clock(beliefs: list[Belief], at: int) -> None:
    """Give every channel as long as the clock number `at` its time."""
    clock = beliefs[at]
    time = clock.scale * clock.channel.values
    for number, belief in enumerate(beliefs):
        if len(belief.channel.values) == len(time):
            beliefs[number] = replace(belief, channel=replace(belief.channel, time=time))
