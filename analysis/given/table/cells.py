"""What the cells of a table say, as programs and people write numbers."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from analysis.given.table.refusals import GivenError

if TYPE_CHECKING:
    import pandas

#: 1.5, -2, 1e-3, .5; and with a comma.
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_COMMA_NUMBER = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
#: Programs write them for 1 and 0.
_TRUTHS = {"true": 1.0, "false": 0.0}
#: No number may be larger, nor all of a column's smaller than its inverse: their squares are none.
_LARGEST = 1e100
#: What programs write where there is no number, besides nothing.
_MISSING = (
    "",
    "na",
    "n/a",
    "nan",
    "-nan",
    "null",
    "none",
    "-",
    "–",
    "—",
    "?",
    "#n/a",
    "#na",
    "<na>",
)
#: Marks of thousands that no decimal sign looks like, minus signs that are none, and percent.
_GROUPED = re.compile(r"(?<=\d)['\u2019 \u00a0\u202f\u2009](?=\d{3}(?!\d))")
_MINUS = re.compile(r"^[\u2212\u2013](?=[\d.,])")
_PERCENT = re.compile(r"(?<=\d)\s?%$")
_INFINITE = re.compile(r"[+-]?inf(inity)?", re.IGNORECASE)
#: Of a column with more than this share of text, all of it is text, and not a number gone wrong.
_TEXT = 0.5
#: Characters quoted of a cell.
_QUOTED = 40


def on_one_line(name: str) -> str:
    """Return a column's name as sentences have it: line breaks and blanks are one blank."""
    return " ".join(name.split())


def is_number(cell: str) -> bool:
    """Say whether a cell reads as a number, with a point or a comma."""
    cell = cell.strip()
    return bool(_NUMBER.fullmatch(cell) or _COMMA_NUMBER.fullmatch(cell))


def is_missing(cell: str) -> bool:
    """Say whether a cell is what programs write where there is no number."""
    return cell.strip().lower() in _MISSING


def column_numbers(
    file: str, name: str, cells: pandas.Series[Any], skipped: int
) -> NDArray[np.float64] | str:
    """Return a column's numbers, nan where none is; one of its texts if it has little but texts.

    Args:
        file, name: of file and column, for sentences.
        cells: as they are written.
        skipped: lines of the file before the first of them.

    Raises:
        GivenError: one of its cells is a text among numbers, or a number is too large or too small.
    """
    import pandas as pd

    stripped = cells.astype(str).str.strip()
    numbers: NDArray[np.float64]
    numbers = np.array(pd.to_numeric(stripped, errors="coerce"), dtype=np.float64)
    odd = np.flatnonzero(np.isnan(numbers))
    wrong: list[int] = []
    truths: list[int] = []
    for at in odd.tolist():
        cell, part = _plain(stripped.iloc[at])
        if is_number(cell):
            numbers[at] = part * float(cell.replace(",", "."))
        elif cell.lower() in _TRUTHS:
            numbers[at] = _TRUTHS[cell.lower()]
            truths.append(at)
        elif not is_missing(cell) and not _INFINITE.fullmatch(cell):
            wrong.append(at)
    if truths and not np.isin(numbers[np.isfinite(numbers)], (0.0, 1.0)).all():
        # Among other numbers it is none.
        wrong = sorted(wrong + truths)
    if wrong and len(wrong) > _TEXT * (len(numbers) - (len(odd) - len(wrong))):
        return str(stripped.iloc[wrong[0]])
    if wrong:
        cell, line = str(stripped.iloc[wrong[0]])[:_QUOTED], wrong[0] + 1 + skipped
        raise GivenError(
            f"line {line} of column {name} reads {cell!r}, which is no number: correct it, or "
            "leave it empty",
            file=file,
            column=name,
            line=line,
        )
    numbers[~np.isfinite(numbers)] = np.nan
    return checked(file, name, numbers)


def checked(file: str, name: str, numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return numbers whose squares are numbers.

    Raises:
        GivenError: one is too large, or all are too small.
    """
    if np.any(np.abs(numbers) > _LARGEST):
        raise GivenError(f"column {name} has numbers beyond ±{_LARGEST:g}", file=file, column=name)
    if 0.0 < np.max(np.abs(numbers), initial=0.0, where=~np.isnan(numbers)) < 1.0 / _LARGEST:
        raise GivenError(
            f"column {name} has no number beyond ±{1.0 / _LARGEST:g}: give it in a smaller unit",
            file=file,
            column=name,
        )
    return numbers


def _plain(cell: str) -> tuple[str, float]:
    """Return 1 234 and −5 as programs write them, and what a number is of one: 0.01 with %."""
    bare = _PERCENT.sub("", cell)
    return _GROUPED.sub("", _MINUS.sub("-", bare)), 1.0 if bare == cell else 0.01
