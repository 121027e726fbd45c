"""What may be kept of the JSON and the text that workers send."""

from collections.abc import Mapping
from math import isfinite
from typing import Any, Literal


def flaw_in(value: Any, most_levels: int) -> Literal["nested", "infinite"] | None:
    """Say why a parsed value cannot be stored as JSON and read by anybody; None if it can."""
    left = [(value, 0)]
    while left:
        value, depth = left.pop()
        if depth > most_levels:
            return "nested"
        if isinstance(value, Mapping):
            left.extend((item, depth + 1) for item in value.values())
        elif isinstance(value, list):
            left.extend((item, depth + 1) for item in value)
        elif isinstance(value, float) and not isfinite(value):
            return "infinite"
    return None


def cut(text: str, length: int) -> str:
    """Return a worker's text as it is kept: PostgreSQL cannot store the character NUL."""
    # Most say nothing.
    return text and text.encode(errors="replace").decode().replace("\0", "")[:length]
