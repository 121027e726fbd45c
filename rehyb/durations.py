"""Lengths of time as people write them."""

import re

from rehyb.errors import Invalid

#: Seconds of each unit.
UNITS = {"s": 1, "m": 60, "min": 60, "h": 3600, "d": 86400}
_NUMBER = r"(\d+(?:\.\d+)?)"
_PARTS = re.compile(rf"(?:{_NUMBER}\s*(?:{'|'.join(sorted(UNITS, key=len, reverse=True))})\s*)+")
_PART = re.compile(rf"{_NUMBER}\s*([a-z]+)")
_CLOCK = re.compile(r"(?:(\d+)-)?(\d{1,3}):(\d\d):(\d\d)")


def seconds(text: str, what: str) -> float:
    """Return the seconds of "90", "90s", "30m", "1h30m", "2h", "1d", "02:00:00" or "1-02:00:00".

    Raises:
        Invalid: it is none of these, or nothing; the message names `what`.
    """
    found, plain = 0.0, text.strip().lower()
    if clock := _CLOCK.fullmatch(plain):
        days, hours, minutes, rest = (int(part or 0) for part in clock.groups())
        if minutes < 60 and rest < 60:
            found = ((days * 24 + hours) * 60 + minutes) * 60.0 + rest
    elif re.fullmatch(_NUMBER, plain):
        found = float(plain)
    elif _PARTS.fullmatch(plain):
        found = sum(float(number) * UNITS[unit] for number, unit in _PART.findall(plain))
    if found <= 0.0:
        raise Invalid(f"{what} is a time like 90s, 30m, 2h or 02:00:00, not {text!r}")
    return found
