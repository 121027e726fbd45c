"""Why a table cannot be analysed, and what of a text file is refused before its numbers are read.

Lines of different length, of which a shorter one may lack any of its cells, and marks of thousands,
which would be read as decimal ones: 12.345 of 12345.
"""

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import NoReturn

#: A cell between blanks, or in quotes.
_CELL = re.compile(r'"[^"]*"|\S+')
#: What a mark of thousands may look like, and what a number without any is then.
_MARKED = re.compile(r"[+-]?[1-9]\d{0,2}[.,]\d{3}")
_SHORT = re.compile(r"[+-]?\d{1,3}")
#: A mark that can only be a decimal one: 0,123 or 1.5 or 12,34.
_DECIMAL = re.compile(
    r"[+-]?(?:0*([.,])\d+|\d+([.,])(?!\d{3}$)\d+|\d{4,}([.,])\d+|\d+([.,])\d+[eE][+-]?\d+)"
)


class GivenError(ValueError):
    """A table cannot be analysed; the message says what, where, and what would be right.

    Attributes:
        file: what the table is called.
        column, line: where the fault is, if it is in one place; the first line of a file is 1.
    """

    def __init__(
        self, sentence: str, *, file: str, column: str | None = None, line: int | None = None
    ) -> None:
        super().__init__(f"{file}: {sentence}")
        self.file = file
        self.column = column
        self.line = line


def refuse_uneven(
    path: Path, encoding: str, *, separator: str | None, above: int, names: int, named: int
) -> None:
    """Refuse lines with more or fewer cells than the line above them.

    They may all have as many fewer as the last cells of the first line are empty. Blank lines are
    no lines.

    Args:
        separator: between cells; None is blanks.
        above: lines of the file above those of the table, its names among them.
        names: cells of the first line.
        named: those of them up to the last with a name.

    Raises:
        GivenError: with the line.
    """
    wanted: int | None = None
    try:
        for line, cells in _records(path, encoding, separator, above):
            if wanted is None:
                wanted = len(cells) if named <= len(cells) <= names else names
            if len(cells) != wanted:
                hint = ": an empty cell needs its separator too" if len(cells) < wanted else ""
                raise GivenError(
                    f"line {line} has {len(cells)} cells and not {wanted} as the lines before"
                    + hint,
                    file=path.name,
                    line=line,
                )
    except csv.Error:
        refuse_quotes(path, encoding, separator=separator, above=above)


def refuse_quotes(path: Path, encoding: str, *, separator: str | None, above: int) -> NoReturn:
    """Refuse a file of which no program makes cells, by the quotation mark that is wrong.

    Args:
        separator, above: as of `refuse_uneven`.

    Raises:
        GivenError: with the line on which its cell begins.
    """
    with path.open(encoding=encoding, errors="replace") as file:
        reader = csv.reader(islice(file, above, None), delimiter=separator or " ", strict=True)
        begins = above + 1
        try:
            for _ in reader:
                begins = above + reader.line_num + 1
        except csv.Error as error:
            said = "has text behind a closing quotation mark: double marks within a cell"
            if "expected after" not in str(error):
                said = "opens a quotation mark that nothing closes: close it, or take it away"
            raise GivenError(f"line {begins} {said}", file=path.name, line=begins) from None
    raise GivenError("it cannot be read as CSV", file=path.name)


def _records(
    path: Path, encoding: str, separator: str | None, above: int
) -> Iterator[tuple[int, list[str]]]:
    """Return every line of the table that is not blank, with its number in the file."""
    with path.open(encoding=encoding, errors="replace") as file:
        for _ in range(above):
            next(file, None)
        if separator is None:
            for line, text in enumerate(file, above + 1):
                if cells := _CELL.findall(text):
                    yield line, cells
            return
        reader = csv.reader(file, delimiter=separator, skipinitialspace=True)
        begins = above + 1
        for cells in reader:
            if "".join(cells).strip() or len(cells) > 1:
                yield begins, cells
            begins = above + reader.line_num + 1


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
