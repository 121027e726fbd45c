"""What a channel is taken for, and what its name alone says of that."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from analysis.closeloop.logs.log import Channel
from analysis.closeloop.unit_names import HERTZ, UNITS, split_other_unit, split_unit

#: Words that name a quantity.
WORDS: Mapping[str, tuple[str, ...]] = {
    "time": (
        *("time", "timestamp", "stamp", "t", "sec", "secs", "msec", "clock", "zeit"),
        *("seconds", "milliseconds"),
    ),
    "position": ("position", "positions", "pos", "q", "angle", "angles", "theta", "winkel"),
    "velocity": (
        *("velocity", "velocities", "vel", "qd", "dq", "v", "qdot", "speed", "speeds", "omega"),
    ),
    "acceleration": ("acceleration", "accelerations", "acc", "qdd", "ddq", "qddot"),
    "effort": (
        *("effort", "efforts", "eff", "torque", "torques", "tau", "force", "trq", "moment"),
        "drehmoment",
    ),
    "current": ("current", "currents", "curr", "i", "amp", "amps", "strom"),
}
#: Words that say how often a quantity was derived by time: `q1_dot`, `theta_ddot`.
DOTS: Mapping[str, int] = {"dot": 1, "ddot": 2, "dotdot": 2}
#: Words that may stand beside a position's for another thing: single letters, and `curr_q1`.
WEAK = ("i", "v", "curr", "amp", "amps")
#: Words of an effort that is not all of the joint's: something was taken off, or it was that.
COMPENSATED = ("compensate", "compensated", "compensation")
#: What is of now, where `current` stands before it.
OF_NOW = {
    *(word for quantity in ("position", "velocity", "acceleration") for word in WORDS[quantity]),
    *("pose", "orientation", "quaternion", "quat"),
}
#: What is written in one with such a word of three letters or more: `jpos0`, `qvel`.
OF_JOINTS = ("joint", "j", "q")
LONG_WORDS = frozenset(word for words in WORDS.values() for word in words if len(word) > 2)
#: Words of a name that say nothing of the joint.
SPARE = ("deg", "rad", "s", "mm", "m", "nm", "n", "ma", "measured", "actual", "applied", "data")
#: Words of what is no joint: a tool's force is no joint's effort.
TOOLS = ("tcp", "tool", "ee", "flange")
#: Words of what has six sides, as a tool has and no joint.
POSES = ("pose", "orientation", "quaternion", "quat", "wrench", "cartesian")
#: What may stand between `current`, where it means "of now", and the quantity: no motor's current.
BETWEEN = ("joint", "joints", "robot", "arm", *TOOLS, "cartesian")
#: Words of what a controller has left to do: it moves as its joint does, and is no place of it.
ERRORS = ("error", "errors", "err", "deviation", "deviations")
#: The same where it stands in a channel's own name, and not in that of its topic or group.
OWN_ERRORS = ("tracking",)
#: Words after a quantity for what it is times something else.
CONSTANTS = ("constant", "gain", "gains", "coefficient")
#: Words of a channel that was wanted and not measured.
WANTED = (
    *("ref", "reference", "des", "desired", "target", "setpoint", "goal"),
    *("cmd", "command", "commanded", "cmptd", "computed", "soll", "sollwert"),
)
#: `posa1` and `posd1`: a quantity, actual or desired, of joint 1.
ACTUAL_OR_DESIRED = {"a": "actual", "d": "desired"}
#: What a channel that a program took from a file of its own is called after.
SUFFIX = re.compile(r"\.(?:txt|csv|dat|log|tsv|asc)$", re.IGNORECASE)
#: Column of an array that a message has without names, below its topic: `robot.state.data[3]`.
UNNAMED_ARRAY = re.compile(r"(?:^|.+[./])data[\[.]\d+\]?$")
#: What a joint state's topic puts before its joints where a plotter writes it as a table.
JOINT_STATES = re.compile(r"^.*\bjoint_?states?[/.]", re.IGNORECASE)
#: Quantities of a joint state with their units (REP 103), those of a hinge; a slide's are m and N.
STATE_UNITS = {"position": "rad", "velocity": "rad/s", "effort": "Nm"}
#: Derivatives of a position, in order.
CHAIN = ("position", "velocity", "acceleration")
#: Signals of a joint that a session holds.
SIGNALS = (*CHAIN, "effort")
#: Why a channel is of a quantity: its name has a word for it, or a unit of it.
BY_NAME, BY_UNIT = "by its name", "by its unit"
#: Why a channel is of none.
OF_A_TOOL = "of a tool, not of a joint"
A_CONSTANT = "a constant of a motor or a controller, not a signal of a joint"
AN_ERROR = "what a controller has left to do, not what was measured"
NOT_ALL = "by its name, which says that something is compensated: it may be a part of the effort"


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


def words_of(name: str) -> list[str]:
    """Return the words of a name, also of one such as `TorqueCur1` or `jpos1`, and its numbers."""
    spaced = re.sub(r"(?<=[a-z]{2})(?=[A-Z][a-z]{2})", " ", SUFFIX.sub("", name))
    words = re.findall(r"[^\W\d_]+|\d+", spaced.lower())
    found = []
    for word, after in pairwise([*words, ""]):
        numbered = after.isdigit() and word[:-1] in LONG_WORDS and word not in LONG_WORDS
        if numbered and word[-1] in ACTUAL_OR_DESIRED:
            found += [word[:-1], ACTUAL_OR_DESIRED[word[-1]]]
        else:
            found.append(_of_joint(word))
    return _without_now(found)


def _without_now(words: list[str]) -> list[str]:
    """Return words without a `current` before a quantity of motion: `current_joint_position`."""
    after = iter(words)
    if "current" not in after:
        return words
    of_now = next((word for word in after if word not in BETWEEN), "") in OF_NOW
    at = words.index("current")
    return [*words[:at], *words[at + 1 :]] if of_now else words


def _is_tools(name: str) -> bool:
    """Whether a channel is of a tool; a Cartesian controller has joints, too."""
    parts = [part for part in re.split(r"[/.]", name) if "controller" not in part.lower()]
    words = {*words_of(name)}
    of_tool = words & {*TOOLS} or {word for part in parts for word in words_of(part)} & {*POSES}
    return bool(of_tool) and "joint" not in words


def _is_error(name: str) -> bool:
    """Whether a channel is the difference of what was wanted and what was measured."""
    own = words_of(re.split(r"[/.]", SUFFIX.sub("", name))[-1])
    return bool({*words_of(name)} & {*ERRORS} or {*own} & {*OWN_ERRORS})


def _of_joint(word: str) -> str:
    """Return a word without what says that it is a joint's, if a quantity is left."""
    left = (word.removeprefix(prefix) for prefix in OF_JOINTS)
    return next((rest for rest in left if rest in LONG_WORDS), word)


def _is_constant(words: Sequence[str], quantity: str) -> bool:
    """Whether words name a constant, as `torque constant` does, and not `constant torque`."""
    return any(word in WORDS[quantity] and after in CONSTANTS for word, after in pairwise(words))


def by_name(channel: Channel) -> Belief:
    """Return what the words and the unit of a channel's name say, the unit before a word."""
    words = words_of(channel.name)
    finite = channel.values[np.isfinite(channel.values)]
    if len(finite) < 2:
        return Belief(channel=channel, quantity="unknown", why="holds hardly a number")
    wanted = any(word in WANTED for word in words)
    if np.ptp(finite) == 0.0:
        return Belief(channel=channel, quantity="constant", wanted=wanted, why="never changes")
    quantity, unit, stem, why = _said(channel)
    return Belief(channel=channel, quantity=quantity, unit=unit, wanted=wanted, stem=stem, why=why)


def held(belief: Belief) -> Belief:
    """Return a constant as the position of a joint that is held, if that is what its name says."""
    quantity, unit, stem, why = _said(belief.channel)
    if belief.quantity != "constant" or belief.wanted or quantity != "position":
        return belief
    return replace(belief, quantity=quantity, unit=unit, stem=stem, why=f"{why}; never changes")


def desired(beliefs: Sequence[Belief]) -> list[Belief]:
    """Return beliefs in which `q_d` is wanted if there is a `q`, too."""
    names = {tuple(words_of(belief.channel.name)) for belief in beliefs}
    found = []
    for belief in beliefs:
        words = words_of(belief.channel.name)
        if "d" in words and tuple(word for word in words if word != "d") in names:
            belief = replace(_without(belief, "d"), wanted=True)
        found.append(belief)
    return found


def without_parts_of_efforts(beliefs: Sequence[Belief]) -> list[Belief]:
    """Return beliefs in which a compensated effort is none if its joint has another, too."""
    whole = {
        b.stem for b in beliefs if b.quantity == "effort" and not b.wanted and b.why != NOT_ALL
    }
    return [
        replace(belief, quantity="unknown", stem="")
        if belief.why == NOT_ALL and belief.stem in whole
        else belief
        for belief in beliefs
    ]


def without_words_of_quantities(beliefs: Sequence[Belief]) -> list[Belief]:
    """Return beliefs told by their unit with the word for the quantity left out of the stem.

    In any language that is a word that all signals of the quantity have, and none of another.
    """
    told = [belief for belief in beliefs if belief.why == BY_UNIT and belief.stem]
    own: dict[str, set[str]] = {}
    for quantity in {belief.quantity for belief in told}:
        alike = [{*belief.stem.split("_")} for belief in told if belief.quantity == quantity]
        others = {w for b in beliefs if b.quantity != quantity for w in b.stem.split("_")}
        own[quantity] = {w for w in set.intersection(*alike) - others if not w.isdigit()}
    return [
        _without(belief, own.get(belief.quantity, set())) if belief.why == BY_UNIT else belief
        for belief in beliefs
    ]


def _without(belief: Belief, words: Collection[str]) -> Belief:
    stem = "_".join(word for word in belief.stem.split("_") if word not in words)
    return replace(belief, stem=stem)


def _said(channel: Channel) -> tuple[str, str, str, str]:
    """Return quantity, unit, stem and why, by a channel's name; "unknown" and "?" if it has none.

    Where a unit in the name and a word in it are of two quantities, the unit is right: `u [V]`. But
    a single letter at the end is then no unit, but the name of a joint or a part: `q_A`.
    """
    whole = SUFFIX.sub("", channel.name)
    name = JOINT_STATES.sub("", whole)
    rest, unit, sure = split_unit(name)
    rest, other = split_other_unit(rest) if unit is None else (rest, None)
    words = words_of(rest)
    named, beside = _quantity(rest, words)
    of_unit = UNITS[unit].quantity if unit else ""
    why = BY_NAME
    # Many write `speed_deg` for deg/s.
    sloppy = of_unit == "position" and named in CHAIN
    if unit and named and named != of_unit and not sloppy:
        if sure:
            named, why = ("" if of_unit == "time" or unit == HERTZ else of_unit), BY_UNIT
        else:
            rest, unit = name, None
    elif unit and not named and sure and UNITS[unit].tells:
        named, why = of_unit, BY_UNIT
    if channel.unit is None and _is_tools(rest):
        return "unknown", channel.unit or unit or "?", "", OF_A_TOOL
    if named not in ("", None, "time") and _is_error(name):
        return "unknown", channel.unit or unit or "?", "", AN_ERROR
    if named and ((other and "/" in other) or _is_constant(words, named)):
        return "unknown", other or unit or "?", "", A_CONSTANT
    if not named:
        return "unknown", channel.unit or unit or "?", "", ""
    spare = {*WORDS[named], *WANTED, *SPARE, *beside}
    stem = "_".join(word for word in words_of(rest) if word not in spare)
    # What a torque was made of is no part of its joint's name.
    stem = stem.partition("_from_")[0]
    if why == BY_NAME and named == "effort" and {*words} & {*COMPENSATED}:
        why = NOT_ALL
    if not unit and name != whole:
        unit = STATE_UNITS.get(named)
    return named, channel.unit or unit or "?", stem, why


def _quantity(name: str, words: Sequence[str]) -> tuple[str | None, Collection[str]]:
    """Return the quantity that a name has a word for, None if none, and words that go with it.

    Those of a torque or a rate stand before the joint's own: `tau_q1` is no position.
    """
    found = next((q for q, names in WORDS.items() if any(w in names for w in words)), None)
    # A topic may be called after a controller, as of velocities, and have positions.
    own = words_of(re.split(r"[/.]", name)[-1])
    if found == "position":
        strong = [q for q in (*CHAIN[1:], "effort", "current") if _has(own, q)]
        if strong:
            return strong[0], {*WORDS["position"], "j", *DOTS, *COMPENSATED}
    dots = max((DOTS.get(word, 0) for word in own), default=0)
    if dots and found in CHAIN:
        place = CHAIN.index(found) + dots
        return (CHAIN[place] if place < len(CHAIN) else None), {*WORDS[found], *DOTS}
    return found, COMPENSATED if found == "effort" else ()


def _has(words: Collection[str], quantity: str) -> bool:
    return any(word in WORDS[quantity] and word not in WEAK for word in words)


def is_nameless(channel: Channel) -> bool:
    """Whether a name says nothing: `column 3`, `x1`, `signals[2]`; a topic names no columns."""
    name = UNNAMED_ARRAY.sub("data", channel.name)
    words = [word for word in words_of(name) if not word.isdigit()]
    return all(len(word) <= 2 or word in ("column", "signal", "signals", "data") for word in words)
