"""Factors as fields of the records that hold their values.

A record states each of its factors once, in `factor(...)` or `choice(...)`, and `factors_of` makes
the table from it that studies sample.
"""

from dataclasses import field, fields
from math import inf
from typing import Any

from models.factors import Factor


def factor(
    unit: str,
    nominal: float,
    study: tuple[float, float],
    description: str,
    *,
    bounds: tuple[float, float] = (-inf, inf),
    optional: bool = False,
) -> Any:
    """Return a field of a dataclass that is a factor; `study` is the range that studies sample."""
    low, high = study
    told = {"unit": unit, "low": low, "high": high, "nominal": nominal, "description": description}
    return field(default=nominal, metadata=told | {"bounds": bounds, "optional": optional})


def choice(names: tuple[str, ...], nominal: str, description: str) -> Any:
    """Return a field of a dataclass that is a choice; it holds the number of one of `names`."""
    number, last = float(names.index(nominal)), float(len(names) - 1)
    told = {"unit": "1", "low": 0.0, "high": last, "nominal": number, "description": description}
    own = {"bounds": (0.0, last), "optional": True, "choices": names}
    return field(default=number, metadata=told | own)


def factors_of(record: type) -> tuple[Factor, ...]:
    """Return the factors among the fields of the dataclass `record`, in their order."""
    return tuple(
        Factor(name=entry.name, **entry.metadata) for entry in fields(record) if entry.metadata
    )
