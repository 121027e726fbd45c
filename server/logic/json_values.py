"""What may be kept of the JSON and the text that workers send."""

import json
from collections.abc import Mapping
from math import inf, isfinite
from typing import Any, Literal

from analysis.json_values import key_twice


class _Twice(dict[str, Any]):
    """An object in which a key comes twice."""

    key: str


def _marked(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    if (key := key_twice(pairs)) is None:
        return dict(pairs)
    found = _Twice(pairs)
    found.key = key
    return found


def place_of_key_twice(text: bytes) -> list[str | int]:
    """Return the keys and numbers that lead to an outermost key which comes twice, from outside in.

    `text` is JSON in which there is one.
    """
    left: list[tuple[list[str | int], Any]] = [([], json.loads(text, object_pairs_hook=_marked))]
    for place, value in left:
        if isinstance(value, _Twice):
            return [*place, value.key]
        if isinstance(value, Mapping):
            left += [([*place, key], item) for key, item in value.items()]
        elif isinstance(value, list):
            left += [([*place, at], item) for at, item in enumerate(value)]
    return []


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
