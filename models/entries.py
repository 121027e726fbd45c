"""Entries of a model's description that somebody sent: of the right types, names and sizes."""

import re
from collections.abc import Mapping, Sequence
from math import inf, isfinite
from typing import Any

from models.factors import SEED, Factor

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]{0,63}")
_MAX_TEXT = 500

#: Columns that a table of results has besides factors and outputs, in their order.
RESULT_COLUMNS = ("row", "position", "outcome", "wall_seconds", "worker")


class DescriptionError(ValueError):
    """A model cannot be described so.

    Attributes:
        field: which entry, as "factors[2].low".
        problem: one sentence, which says what would be right.
    """

    def __init__(self, field: str, problem: str) -> None:
        self.field, self.problem = field, problem
        super().__init__(f"{field}: {problem}")


def factor_of(where: str, said: Any) -> Factor:
    """Read a factor; raise a DescriptionError that names the entry at fault, below `where`."""
    number = {"low": float, "high": float, "nominal": float}
    fields = fields_of(
        where,
        said,
        needed={"name": str, "unit": str, **number},
        optional={"description": str, "bounds": list, "optional": bool, "choices": list},
    )
    for name in number:
        if not isfinite(fields[name]):
            raise DescriptionError(f"{where}.{name}", f"must be finite, not {fields[name]}")
    if not fields["low"] < fields["high"] or not isfinite(fields["high"] - fields["low"]):
        raise DescriptionError(
            f"{where}.high", f"{fields['high']:g} must lie above low, {fields['low']:g}"
        )
    low, high = _bounds(f"{where}.bounds", fields.pop("bounds", [None, None]))
    for name in number:
        if not low <= fields[name] <= high:
            raise DescriptionError(
                f"{where}.{name}", f"{fields[name]:g} lies outside the bounds {low:g} to {high:g}"
            )
    if not fields.get("optional") and not fields["low"] <= fields["nominal"] <= fields["high"]:
        low, high = fields["low"], fields["high"]
        raise DescriptionError(
            f"{where}.nominal", f"{fields['nominal']:g} lies outside its range, {low:g} to {high:g}"
        )
    choices = tuple(fields.pop("choices", ()))
    if not all(isinstance(choice, str) and choice for choice in choices):
        raise DescriptionError(f"{where}.choices", "must be a list of names")
    if choices and (fields["low"], fields["high"]) != (0.0, len(choices) - 1):
        raise DescriptionError(
            f"{where}.high", f"of a choice is the number of its last name, {len(choices) - 1}"
        )
    return Factor(**{"description": "", **fields}, bounds=(low, high), choices=choices)


def _bounds(where: str, said: Sequence[Any]) -> tuple[float, float]:
    numbers = [b for b in said if isinstance(b, int | float) and not isinstance(b, bool)]
    if len(said) != 2 or len(numbers) + said.count(None) != 2:
        raise DescriptionError(where, "must be two numbers, or null where there is no bound")
    low = -inf if said[0] is None else float(said[0])
    high = inf if said[1] is None else float(said[1])
    return low, high


def fields_of(
    where: str, said: Any, *, needed: Mapping[str, type], optional: Mapping[str, type]
) -> dict[str, Any]:
    """Return the entries of a table; one that is null is left out.

    Raises:
        DescriptionError: an entry is missing, unknown, or not of the type asked for.
    """
    if not isinstance(said, Mapping):
        raise DescriptionError(where, f"must be a table, not {type(said).__name__}")
    kinds = {**needed, **optional}
    for name in said:
        if name not in kinds:
            raise DescriptionError(
                f"{where}.{str(name)[:80]}", f"is unknown: expected one of {', '.join(kinds)}"
            )
    found = {}
    for name, kind in kinds.items():
        value = said.get(name)
        if value is None:
            if name in needed:
                raise DescriptionError(f"{where}.{name}", "is missing")
            continue
        if kind is float and isinstance(value, int) and not isinstance(value, bool):
            value = _as_float(f"{where}.{name}", value)
        if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
            word = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}
            raise DescriptionError(
                f"{where}.{name}", f"must be {word.get(kind, 'a list')}, not {str(value)[:60]!r}"
            )
        if isinstance(value, str) and (len(value) > _MAX_TEXT or not value.isprintable()):
            raise DescriptionError(
                f"{where}.{name}", f"must be one line of at most {_MAX_TEXT} characters"
            )
        found[name] = value
    return found


def _as_float(where: str, value: int) -> float:
    try:
        return float(value)
    except OverflowError:
        raise DescriptionError(where, "is too large for a number") from None


def check_names(where: str, names: Sequence[str], what: str) -> None:
    """Raise a DescriptionError unless there are names, each is one, and no two are the same."""
    if not names:
        raise DescriptionError(where, f"a model has at least one {what}")
    seen: set[str] = set()
    for i, name in enumerate(names):
        if not _NAME.fullmatch(name):
            raise DescriptionError(
                f"{where}[{i}].name",
                f"{name[:80]!r} must be 1 to 64 letters, digits, _, . and -, "
                "and begin with a letter or _",
            )
        if name in seen:
            raise DescriptionError(f"{where}[{i}].name", f"{name} is listed twice")
        seen.add(name)
        if name == SEED.name and what == "factor":
            raise DescriptionError(
                f"{where}[{i}].name",
                "seed is what every evaluation gets besides its factors: choose another name",
            )


def check_columns(sources: Sequence[str], outputs: Sequence[str]) -> None:
    """Raise a DescriptionError unless factors and outputs can stand in one table of results.

    Args:
        sources: names of the factors, then the seed if that decides, too.
    """
    taken = dict.fromkeys(RESULT_COLUMNS, "what a column of every table of results is called")
    for where, names in (("factors", sources), ("outputs", outputs)):
        for i, name in enumerate(names):
            if name in taken:
                raise DescriptionError(
                    f"{where}[{i}].name", f"{name} is {taken[name]}: rename this {where[:-1]}"
                )
        taken |= dict.fromkeys(names, "a factor, too, and a table has one column of a name")
