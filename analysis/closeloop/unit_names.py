"""Units as people write them in the names of channels: what they measure, and their size in SI."""

import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from math import pi


@dataclass(frozen=True)
class Unit:
    """What a unit measures."""

    #: A key of `belief.WORDS`; empty for what is no signal of a joint.
    quantity: str
    #: Times this it is in SI units.
    scale: float
    #: Whether it tells the quantity of a channel whose name has no word for one: markers are in mm,
    #: and scales in N, too.
    tells: bool = True


HERTZ = "Hz"
UNITS: Mapping[str, Unit] = {
    "rad": Unit("position", 1.0),
    "deg": Unit("position", pi / 180),
    "mdeg": Unit("position", pi / 180_000),
    "mrad": Unit("position", 1e-3),
    "turns": Unit("position", 2 * pi, tells=False),
    "m": Unit("position", 1.0, tells=False),
    "cm": Unit("position", 1e-2, tells=False),
    "mm": Unit("position", 1e-3, tells=False),
    "rad/s": Unit("velocity", 1.0),
    "deg/s": Unit("velocity", pi / 180),
    "rpm": Unit("velocity", pi / 30),
    "turns/s": Unit("velocity", 2 * pi, tells=False),
    # Turns a second, of what is called a velocity; else a rate of anything.
    HERTZ: Unit("velocity", 2 * pi, tells=False),
    "m/s": Unit("velocity", 1.0, tells=False),
    "mm/s": Unit("velocity", 1e-3, tells=False),
    "rad/s2": Unit("acceleration", 1.0),
    "deg/s2": Unit("acceleration", pi / 180),
    "m/s2": Unit("acceleration", 1.0, tells=False),
    "Nm": Unit("effort", 1.0),
    "mNm": Unit("effort", 1e-3),
    "Nmm": Unit("effort", 1e-3),
    "Ncm": Unit("effort", 1e-2),
    "kNm": Unit("effort", 1e3),
    "kgfm": Unit("effort", 9.80665),
    "kgfcm": Unit("effort", 0.0980665),
    "ftlb": Unit("effort", 1.3558179),
    "inlb": Unit("effort", 0.11298483),
    "inoz": Unit("effort", 0.0070615518),
    "N": Unit("effort", 1.0, tells=False),
    "kN": Unit("effort", 1e3, tells=False),
    "A": Unit("current", 1.0),
    "mA": Unit("current", 1e-3),
    "V": Unit("", 1.0),
    "mV": Unit("", 1e-3),
    "s": Unit("time", 1.0, tells=False),
    "ms": Unit("time", 1e-3, tells=False),
    "us": Unit("time", 1e-6, tells=False),
    "ns": Unit("time", 1e-9, tells=False),
}
#: Units, in lower case, that no signal of a joint is made SI from, but that are no joint's name.
OTHERS = (
    *("count", "counts", "inc", "incs", "increments", "tick", "ticks", "steps", "pulses", "lsb"),
    *("raw", "%", "kg", "degc", "°c"),
)
#: What stands between the two units of a torque.
_MARK = "[- _.·⋅*]?"
#: Other spellings of their parts, in lower case; those of a longer word come first.
SPELLINGS = (
    (r"°|\bdegrees?|\bdegr[eé]s?|\bgrad(os|i)?\b", "deg"),
    (r"\bradians?", "rad"),
    ("μ", "u"),
    (r"sec(ond)?s?\b|sek\b", "s"),
    (rf"ft{_MARK}lbf?s?|lbf?s?{_MARK}ft", "ftlb"),
    (rf"in{_MARK}lbf?s?|lbf?s?{_MARK}in", "inlb"),
    (rf"in{_MARK}ozf?|ozf?{_MARK}in", "inoz"),
    (rf"kgf?{_MARK}cm|kp{_MARK}cm", "kgfcm"),
    (rf"kgf{_MARK}m|kp{_MARK}m", "kgfm"),
    (r"u/min|1/min|min-1|min\^-1|rev/min", "rpm"),
    (r"\bturn\b|\brevs?\b|\brevolutions?|\bumdrehung(en)?", "turns"),
    (r"[ .·*]?s\^?-1", "/s"),
    (r"[ .·*]?s\^?-2", "/s2"),
    (r"_", "/"),
    (r"[ .·⋅*^]", ""),
)
_BY_PLAIN = {name.lower(): name for name in UNITS}
#: Names that are kept as they were read: those of a log are asked for again and again.
KEPT = 50_000
#: Most characters of a unit.
_LONGEST = 16
#: A unit in brackets, and whatever could be one at the end.
_BRACKETS = re.compile(rf"[\[({{]([^\[\](){{}}]{{1,{_LONGEST}}})[\])}}]")
_COLUMN = re.compile(r"/?\[\d+\]$")
_ENDS = re.compile(r"(?<=[\s_/,])(?=(.+)$)")


@lru_cache(KEPT)
def unit_of(text: str) -> str | None:
    """Return the key of `UNITS` that a text means; None if it is no unit.

    A single letter means a unit in its own case only: v is a velocity, V are volts.
    """
    text = text.strip()
    if text in UNITS or len(text) > _LONGEST:
        return text if text in UNITS else None
    # This writes ⁻¹, ² and µ as common letters.
    plain = unicodedata.normalize("NFKC", text).replace("\N{MINUS SIGN}", "-").lower()
    for written, meant in SPELLINGS:
        plain = re.sub(written, meant, plain)
    found = _BY_PLAIN.get(plain)
    return None if len(text) == 1 and text.isascii() else found


@lru_cache(KEPT)
def split_unit(name: str) -> tuple[str, str | None, bool]:
    """Return a channel's name without its unit, the unit, and whether it can be nothing else.

    The unit stands in brackets, or at the end after a mark, before the number of an array's column.
    There a single letter may be the name of a joint or a part.
    """
    for found in reversed([*_BRACKETS.finditer(name)]):
        if unit := unit_of(found[1]):
            return f"{name[: found.start()]} {name[found.end() :]}", unit, True
    number = _COLUMN.search(name)
    column = number[0] if number else ""
    name = name.removesuffix(column)
    # The first that fits is the longest: rad/s before s.
    for found in _ENDS.finditer(name, max(0, len(name) - _LONGEST)):
        if unit := unit_of(found[1]):
            sure = len(found[1]) > 1 or not found[1].isascii()
            return f"{name[: found.start()]}{column}", unit, sure
    return f"{name}{column}", None, False


def split_other_unit(name: str) -> tuple[str, str | None]:
    """Return a name without a unit in brackets of which `UNITS` has none, and that unit.

    As `Nm/A`, or `counts`; what else stands in brackets may name a joint.
    """
    for found in reversed([*_BRACKETS.finditer(name)]):
        parts = [part.strip() for part in found[1].split("/")]
        known = [unit_of(part) or part.lower() in OTHERS for part in parts]
        if all(known) and unit_of(found[1]) is None:
            return f"{name[: found.start()]} {name[found.end() :]}", found[1]
    return name, None
