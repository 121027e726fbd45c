"""What may be kept of the JSON and the text that workers send."""

from collections.abc import Mapping
from math import inf, isfinite
from typing import Any, Literal


def flaw_in(
    value: Any, most_levels: int, most_values: float = inf
) -> Literal["nested", "infinite", "long", "half"] | None:
    """Say why a parsed value cannot be stored as JSON and read by anybody; None if it can.

    Args:
        value: what was parsed.
        most_levels: how deep it may be nested.
        most_values: how many values and characters of text it may hold.
    """
    left, held = [(value, 0)], 0
    while left:
        value, depth = left.pop()
        if depth > most_levels:
            return "nested"
        if isinstance(value, Mapping | list | str):
            held += len(value)
        if isinstance(value, Mapping):
            held += sum(map(len, value))
            if not all(map(is_unicode, value)):
                return "half"
        elif isinstance(value, str) and not is_unicode(value):
            return "half"
        # Before it is taken apart, which takes longer than it took to send.
        if held > most_values:
            return "long"
        if isinstance(value, Mapping):
            left.extend((item, depth + 1) for item in value.values())
        elif isinstance(value, list):
            left.extend((item, depth + 1) for item in value)
        elif isinstance(value, float) and not isfinite(value):
            return "infinite"
    return None


def is_unicode(text: str) -> bool:
    """Say whether a text has no half of a character, which no database stores."""
    if text.isascii():
        return True
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def cut(text: str, length: int) -> str:
    """Return a worker's text as it is kept: PostgreSQL cannot store the character NUL."""
    # Most say nothing.
    return text and text.encode(errors="replace").decode().replace("\0", "")[:length]
