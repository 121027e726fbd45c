"""What a channel is taken for, and what its name alone says of that."""

import re
from collections.abc import Mapping
from dataclasses import dataclass

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
WANTED = ("ref", "reference", "des", "desired", "target", "cmd", "command", "setpoint", "goal")
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
    return re.findall(r"[^\W\d_]+|\d+", name.lower())


def by_name(channel: Channel) -> Belief:
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


def is_nameless(channel: Channel) -> bool:
    """Whether a name says nothing: `column 3`, `x1`, `signals[2]`."""
    words = [word for word in _tokens(channel.name) if not word.isdigit()]
    return all(len(word) <= 2 or word in ("column", "signal", "signals", "data") for word in words)


def _unit_in(name: str) -> str:
    """Return the unit at the end of a name such as `angle_deg` or `torque [Nm]`, or "?"."""
    found = re.search(r"[_\s(\[](deg[_/]s|rad[_/]s|m[_/]s|deg|rad|mm|m|Nm|N|mA|A)[)\]]?$", name)
    return found[1].replace("_", "/") if found else "?"
