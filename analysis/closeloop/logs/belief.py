"""What a channel is taken for, and what its name alone says of that."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from analysis.closeloop.logs.log import Channel

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
WANTED = (
    *("ref", "reference", "des", "desired", "target", "setpoint", "goal"),
    *("cmd", "command", "commanded", "cmptd", "computed"),
)
#: Derivatives of a position, in order.
CHAIN = ("position", "velocity", "acceleration")


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


def _tokens(name: str) -> list[str]:
    """Return the words of a name, also of one such as `TorqueCur1`, and its numbers."""
    parted = re.sub(r"(?<=[a-z]{2})(?=[A-Z][a-z]{2})", " ", name)
    return re.findall(r"[^\W\d_]+|\d+", parted.lower())


def by_name(channel: Channel) -> Belief:
    words = _tokens(channel.name)
    finite = channel.values[np.isfinite(channel.values)]
    if len(finite) < 2:
        return Belief(channel=channel, quantity="unknown", why="holds hardly a number")
    wanted = any(word in WANTED for word in words)
    named = next((q for q, names in WORDS.items() if any(w in names for w in words)), None)
    still = np.ptp(finite) == 0.0
    if named is None or still:
        quantity, why = ("constant", "never changes") if still else ("unknown", "")
        return Belief(channel=channel, quantity=quantity, wanted=wanted, why=why)
    return Belief(
        channel=channel,
        quantity=named,
        unit=channel.unit or _unit_in(channel.name),
        wanted=wanted,
        stem=stem_of(channel.name, named),
        why="by its name",
    )


def held(belief: Belief) -> Belief:
    """Return a constant as the position of a joint that is held, if that is what its name says."""
    words, name = _tokens(belief.channel.name), belief.channel.name
    if belief.quantity != "constant" or belief.wanted or not {*words} & {*WORDS["position"]}:
        return belief
    return replace(
        belief,
        quantity="position",
        unit=belief.channel.unit or _unit_in(name),
        stem=stem_of(name, "position"),
        why="by its name; never changes",
    )


def stem_of(name: str, quantity: str) -> str:
    """Return a channel's name without its quantity and unit."""
    spare = {*WORDS[quantity], *WANTED, *UNITS}
    return "_".join(word for word in _tokens(name) if word not in spare)


def is_nameless(channel: Channel) -> bool:
    """Whether a name says nothing: `column 3`, `x1`, `signals[2]`."""
    words = [word for word in _tokens(channel.name) if not word.isdigit()]
    return all(len(word) <= 2 or word in ("column", "signal", "signals", "data") for word in words)


def _unit_in(name: str) -> str:
    """Return the unit at the end of a name such as `angle_deg` or `torque [Nm]`, or "?"."""
    found = re.search(r"[_\s(\[](deg[_/]s|rad[_/]s|m[_/]s|deg|rad|mm|m|Nm|N|mA|A)[)\]]?$", name)
    return found[1].replace("_", "/") if found else "?"
