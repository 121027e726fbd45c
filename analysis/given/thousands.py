"""Marks of thousands, which would be read as decimal ones: 12.345 of 12345."""

import re
from collections.abc import Mapping, Sequence

from analysis.given.errors import GivenError

#: What a mark of thousands may look like, and what a number without any is then.
_MARKED = re.compile(r"[+-]?[1-9]\d{0,2}[.,]\d{3}")
_SHORT = re.compile(r"[+-]?\d{1,3}")
#: A mark that can only be a decimal one: 0,123 or 1.5 or 12,34.
_DECIMAL = re.compile(
    r"[+-]?(?:0*([.,])\d+|\d+([.,])(?!\d{3}$)\d+|\d{4,}([.,])\d+|\d+([.,])\d+[eE][+-]?\d+)"
)


def refuse_thousands(file: str, cells: Mapping[str, Sequence[str]]) -> None:
    """Refuse columns of which nothing tells whether a mark is of thousands or a decimal one.

    In such a column three digits follow every mark, and what has no mark has three digits at most.
    Where another column has the mark as a decimal one and no column has the other mark so, it is.
    Columns in which every number has a mark are read as decimals if no other mark contradicts:
    programs that write three decimals write them always.

    Args:
        cells: the texts of every column.

    Raises:
        GivenError: there is such a column.
    """
    settled: set[str] = set()
    doubtful: dict[str, tuple[str, str | None]] = {}
    for name, column in cells.items():
        marked, bare = _looks(column)
        if marked is None:
            settled |= _decimal_marks(column)
        else:
            doubtful[name] = marked, bare
    for name, (marked, bare) in doubtful.items():
        mark, other = (",", ".") if "," in marked else (".", ",")
        if mark in settled and other not in settled:
            continue
        if bare is None and other not in settled:
            continue
        beside = f" beside {bare!r}" if bare is not None else ""
        raise GivenError(
            f"column {name} reads {marked!r}{beside}: the {'comma' if mark == ',' else 'point'} "
            f"may be of thousands or a decimal one; write {marked.replace(mark, '')} or {marked}0",
            file=file,
            column=name,
        )


def _looks(column: Sequence[str]) -> tuple[str | None, str | None]:
    """Return a number with a mark and one without of a column that may have marks of thousands."""
    marked = bare = None
    for cell in map(str.strip, column):
        if _MARKED.fullmatch(cell):
            marked = marked or cell
        elif _SHORT.fullmatch(cell):
            # 0 is written alike whatever the mark.
            bare = bare or (cell if cell.strip("+-0") else None)
        elif any(sign.isdigit() for sign in cell):
            return None, None
    return marked, bare


def _decimal_marks(column: Sequence[str]) -> set[str]:
    """Return the marks that are decimal ones in a column beyond doubt."""
    for cell in column:
        if found := _DECIMAL.fullmatch(cell.strip()):
            return {mark for mark in found.groups() if mark}
    return set()
