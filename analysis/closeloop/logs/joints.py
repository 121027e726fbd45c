"""What the joints of a log are called, and which joints of a robot's model they are."""

import re
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

from analysis.closeloop.errors import SessionError
from analysis.closeloop.logs.belief import JOINT_STATES, SIGNALS, Belief, words_of
from intake.xml import listed

#: Kinds of joints, in URDF or MJCF, that turn about or slide along no single axis.
MANY_OR_NONE = ("fixed", "floating", "planar", "free", "ball")

#: Why a channel is a position.
OF_MODEL = "has the name of a joint of the model"
OF_NUMBER = "has a joint's number, and no position has a name"


def joint_name(belief: Belief) -> str | None:
    """Return the joint's name as the channel's has it; None if that is a number or nothing."""
    name = belief.channel.name
    if (below := JOINT_STATES.sub("", name)) != name:
        name = below.replace("/", ".")
    joint, dot, quantity = name.rpartition(".")
    if dot and quantity == belief.quantity and joint:
        return joint
    return belief.stem if belief.stem and not belief.stem.isdigit() else None


def as_positions(beliefs: Sequence[Belief], known: Collection[str]) -> list[Belief]:
    """Return beliefs in which what has the name of a joint of the model is that joint's position.

    As `theta` and `alpha` of a pendulum: no word says of the second what it is.
    """
    found = []
    for belief in beliefs:
        name, quantity = belief.channel.name.strip(), belief.quantity
        if name in known and quantity == "position" and not belief.stem:
            belief = replace(belief, stem=name)
        elif name in known and quantity == "unknown" and not (belief.why or belief.wanted):
            belief = replace(belief, quantity="position", stem=name, why=OF_MODEL)
        found.append(belief)
    return found


def numbered_as_positions(beliefs: Sequence[Belief]) -> list[Belief]:
    """Return beliefs in which `joint_1` is the position of that joint, if nothing else is one.

    `current_joint_1` is, too, where no other signal is a joint's: else it is a motor's current.
    """
    signals = {belief.quantity for belief in beliefs if not belief.wanted} & {*SIGNALS}
    if "position" in signals:
        return [*beliefs]
    found = []
    for belief in beliefs:
        *words, number = words_of(belief.channel.name.rpartition("/")[2]) or [""]
        free = belief.quantity in ("unknown", "constant") and belief.unit == "?"
        own = free and words in (["joint"], ["joints"])
        own |= not signals and words == ["current", "joint"] and belief.unit == "?"
        if own and number.isdigit() and not belief.wanted:
            why = f"{OF_NUMBER}; {belief.why}" if belief.why == "never changes" else OF_NUMBER
            belief = replace(belief, quantity="position", stem=number, why=why)
        found.append(belief)
    return found


def joint_names(beliefs: Sequence[Belief], known: Sequence[str] = ()) -> list[str]:
    """Return the names of the log's joints in order: the log's own, else `known`, else numbers.

    Where the names of `known` are numbered, a number of the log's is that joint.
    A name of the log's that ends as one of `known` alone does, but for marks, means that; where
    log and model have a single joint, it is the same.
    """
    count = 1 + max((b.joint for b in beliefs if b.joint is not None), default=-1)
    if count == len(known) == 1:
        return list(known)
    # A joint's position says its name before the others.
    positions_last = sorted(beliefs, key=lambda belief: belief.quantity == "position")
    own = {b.joint: name for b in positions_last if b.joint is not None and (name := joint_name(b))}
    spare = list(known) if len(known) == count else [f"joint_{n + 1}" for n in range(count)]
    own = _by_number(beliefs, known) | own
    names = [own.get(number, spare[number]) for number in range(count)]
    meant = [_meant(name, known) for name in names]
    return [m if m and meant.count(m) == 1 else n for n, m in zip(names, meant, strict=True)]


def _by_number(beliefs: Sequence[Belief], known: Sequence[str]) -> dict[int, str]:
    """Return the joints of `known` that bare numbers of the log's mean; none if any means none.

    A log that counts from 0 means the first by it where `known` counts from 1.
    """
    numbers = {
        b.joint: int(b.stem)
        for b in beliefs
        if b.quantity == "position" and not b.wanted and b.joint is not None and b.stem.isdigit()
    }
    ends = {name: re.search(r"(\d+)\D*$", name) for name in known}
    by_number = {int(end[1]): name for name, end in ends.items() if end}
    if not numbers or len(by_number) < len(known) or not known:
        return {}
    if 0 in numbers.values() and 0 not in by_number:
        numbers = {joint: number + 1 for joint, number in numbers.items()}
    if not by_number.keys() >= {*numbers.values()}:
        return {}
    return {joint: by_number[number] for joint, number in numbers.items()}


def _meant(name: str, known: Sequence[str]) -> str | None:
    """Return the one of `known` that a name means; None if it is none or several."""
    if name in known:
        return name
    plain = _plain(name)
    alike = [other for other in known if _plain(other) and plain.endswith(_plain(other))]
    longest = max((len(_plain(other)) for other in alike), default=0)
    alike = [other for other in alike if len(_plain(other)) == longest]
    # Or the one that stands in its middle as a word.
    words = re.split(r"[\W_]+", name.lower())
    alike = alike or [other for other in known if other.lower() in words]
    return alike[0] if len(alike) == 1 else None


def _plain(name: str) -> str:
    return re.sub(r"[\W_]", "", name).lower()


def of_only_joint(beliefs: Sequence[Belief], known: Sequence[str]) -> list[str]:
    """Say of a log's only joint that it is taken for the model's, if it has another name."""
    own = joint_names(beliefs)
    if len(own) != 1 or len(known) != 1 or not any(map(joint_name, beliefs)):
        return []
    if _meant(own[0], known):
        return []
    return [f"the log's only joint, {own[0]}, is taken for the model's, {known[0]}"]


def of_order(beliefs: Sequence[Belief], known: Sequence[str]) -> list[str]:
    """Say that joints without names are taken for the model's in its order, which may be wrong."""
    joints = {belief.joint: belief for belief in reversed(beliefs) if belief.joint is not None}
    if not len(joints) == len(known) > 1 or _by_number(beliefs, known):
        return []
    if any(map(joint_name, joints.values())):
        return []
    return [
        f"the log names no joint, and its joints are taken in the model's order, {listed(known)}: "
        "if that is wrong, say --as 'CHANNEL=JOINT.QUANTITY' of each channel"
    ]


def of_other_joints(names: Sequence[str], known: Sequence[str]) -> list[str]:
    """Say which joints of a log a model does not have."""
    unknown = [name for name in names if name not in known]
    if not known or not unknown:
        return []
    return [
        f"the model has no joint {listed(unknown)}, but {listed(known)}: say "
        "--as 'CHANNEL=JOINT.QUANTITY' of each channel"
    ]


def of_parted_joints(beliefs: Sequence[Belief], names: Sequence[str]) -> list[str]:
    """Say of efforts without a position beside positions without an effort how to join them."""
    having: dict[str, dict[int, str]] = {"position": {}, "effort": {}}
    for belief in beliefs:
        quantity = "effort" if belief.quantity == "current" else belief.quantity
        if quantity in having and belief.joint is not None and not belief.wanted:
            having[quantity].setdefault(belief.joint, belief.channel.name)
    position, effort = having["position"], having["effort"]
    spare = [names[joint] for joint in position if joint not in effort]
    parted = [joint for joint in effort if joint not in position]
    if not parted or not spare:
        return []
    has, one = ("has", "they are") if len(parted) == 1 else ("have", "two are")
    return [
        f"{listed(names[joint] for joint in parted)} {has} an effort and no position, "
        f"{listed(spare)} no effort: if {one} one joint, say "
        f"--as '{effort[parted[0]]}={spare[0]}.effort*FACTOR_TO_SI'"
    ]


def joints_in(model: Path) -> list[str]:
    """Return the names of the hinges and slides of an MJCF or URDF file, from base to tip.

    In the file's order but for joints of a URDF that stand before what carries them.

    Raises:
        SessionError: the file is no XML.
    """
    try:
        root = ElementTree.parse(model).getroot()
    except (ElementTree.ParseError, UnicodeDecodeError) as error:
        raise SessionError(f"is no XML: {error}", file=model.name) from None
    # A URDF names them again in what it says to drivers and simulators, and MJCF in constraints.
    if root.tag == "robot":
        joints = _from_base(root.findall("joint"))
    else:
        parents = [*root.iter("worldbody"), *root.iter("body")]
        joints = [joint for parent in parents for joint in parent.findall("joint")]
    return [
        joint.get("name", "")
        for joint in joints
        if joint.get("name") and joint.get("type", "hinge") not in MANY_OR_NONE
    ]


def _from_base(joints: Sequence[ElementTree.Element]) -> list[ElementTree.Element]:
    """Return the joints of a URDF, each after those that carry it, else in order.

    Some programs write them from the tip, and logs begin at the base.
    """

    def link(joint: ElementTree.Element, side: str) -> str:
        found = joint.find(side)
        return "" if found is None else found.get("link", "")

    carrier = {link(joint, "child"): joint for joint in joints}
    found: dict[int, ElementTree.Element] = {}
    for joint in joints:
        chain = [joint]
        # Longer than all joints is a circle, which the model's reader refuses.
        while (
            len(chain) <= len(joints)
            and (below := carrier.get(link(chain[-1], "parent"))) is not None
        ):
            chain.append(below)
        for own in reversed(chain):
            found.setdefault(id(own), own)
    return [*found.values()]
