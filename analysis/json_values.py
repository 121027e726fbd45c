"""What a number may be that comes or goes as JSON (Bray 2017, RFC 8259, section 6)."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from math import isfinite
from typing import Any


def is_finite_number(value: object) -> bool:
    """Say whether a JSON value is a number that a float can hold."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return isfinite(value)
    except OverflowError:
        return False


def key_twice(pairs: Sequence[tuple[str, Any]]) -> str | None:
    """Return a key that comes twice in an object, as `json.loads` gives its pairs; None if none."""
    key, times = Counter(key for key, _ in pairs).most_common(1)[0] if pairs else ("", 0)
    return key if times > 1 else None


def number(value: float) -> float | None:
    """Return a number that JSON has; None for one that is not finite."""
    return float(value) if isfinite(value) else None


def plain(record: Any) -> dict[str, Any]:
    """Return the fields of a dataclass, tuples as the lists that JSON has."""
    found = asdict(record)
    return {name: list(v) if isinstance(v, tuple) else v for name, v in found.items()}
