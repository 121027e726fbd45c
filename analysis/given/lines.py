"""Whether all lines of a file have as many cells; a shorter one may lack any of them."""

import csv
import re
from collections.abc import Iterator
from pathlib import Path

from analysis.given.errors import GivenError

#: A cell between blanks, or in quotes.
_CELL = re.compile(r'"[^"]*"|\S+')


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
    except csv.Error as error:
        raise GivenError(f"it cannot be read as CSV: {error}", file=path.name) from None


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
