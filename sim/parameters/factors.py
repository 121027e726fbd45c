"""Factors: the uncertain inputs of a model, as fields of the records that hold their values.

A record states each of its factors once, in `factor(...)`. `factors_of` makes the table from it
that studies sample, and `check_bounds` refuses values that mean nothing.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from math import inf
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Factor:
    """One uncertain input: its name, unit, range and nominal value."""

    name: str
    #: SI unit symbol; "1" if dimensionless.
    unit: str
    low: float
    high: float
    nominal: float
    description: str
    #: Closed interval outside which the value means nothing.
    bounds: tuple[float, float] = (-inf, inf)
    #: Whether a study samples it only if told to.
    optional: bool = False


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


def factors_of(record: type) -> tuple[Factor, ...]:
    """Return the factors among the fields of the dataclass `record`, in their order."""
    return tuple(
        Factor(name=entry.name, **entry.metadata) for entry in fields(record) if entry.metadata
    )


def check_bounds(factors: tuple[Factor, ...], values: Mapping[str, float]) -> None:
    """Raise ValueError if a value lies outside its factor's bounds."""
    for factor in factors:
        low, high = factor.bounds
        value = values.get(factor.name, factor.nominal)
        if not low <= value <= high:
            raise ValueError(f"{factor.name} must lie between {low:g} and {high:g}, not {value}")
