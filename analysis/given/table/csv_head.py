"""How a CSV file begins: its encoding, what cuts its cells, and what its columns are called."""

import csv
import re
from codecs import getincrementaldecoder
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import BinaryIO

from analysis.given.table.cells import is_missing, is_number, on_one_line
from analysis.given.table.refusals import GivenError

#: So many bytes are enough to tell, or so many lines of the table if they are longer than that.
START_BYTES = 1 << 16
_LINES = 20
#: No header is longer.
_MOST_BYTES = 1 << 24
#: Between columns, as programs write them; blanks where none of these is.
_SEPARATORS = (",", ";", "\t", "|")
BLANKS = r"\s+"
#: How a spreadsheet's CSV may begin: which separator it has.
_SAID = re.compile(r'"?sep=([,;|:\t])"?', re.IGNORECASE)
#: Columns that are numbered, at least, for their numbers to be names and no run.
_FEWEST_NUMBERED = 3
#: How a spreadsheet's "Unicode text" begins.
UTF_16 = (b"\xff\xfe", b"\xfe\xff")


@dataclass(frozen=True, kw_only=True)
class CsvHead:
    """How a CSV file begins."""

    encoding: str
    #: A character, or `BLANKS`.
    separator: str
    #: Of all columns, in order; column_N where there is none.
    names: list[str]
    #: Those of them that stand in no file, such as behind a separator at the end of every line.
    nameless: frozenset[str]
    #: How many columns there are up to the last one that has a name.
    named: int
    #: The first lines were numbers already.
    unlabelled: bool
    #: Its names are 0, 1, 2, ... or 1, 2, 3, ..., as programs number columns without names.
    numbered: bool
    #: Lines above the table, which say what it is; and above its first numbers.
    above: int
    before: int
    #: Lines of the table's own that its names take, as programs count them: one, or none.
    header: int


def whole_lines(name: str, start: bytes, file: BinaryIO) -> bytes:
    """Return the start of a file, and more of it where its lines are long.

    Args:
        name: what sentences call the file.
        start: its first `START_BYTES`.
        file: what follows them.

    Raises:
        GivenError: its header is longer than any.
    """
    while len(start) < _MOST_BYTES and _lines_of_table(start) <= _LINES:
        more = file.read(len(start))
        if not more:
            return start
        start += more
    if _lines_of_table(start) < 2:
        raise GivenError(
            f"its header is longer than {_MOST_BYTES >> 20} MB: keep fewer columns", file=name
        )
    return start


def _lines_of_table(start: bytes) -> int:
    return sum(bool(line.strip()) and not line.startswith(b"#") for line in start.splitlines())


def read_head(file: str, start: bytes) -> CsvHead:
    """Return how a file begins.

    Args:
        file: what sentences call it.
        start: its first lines, from `whole_lines`.

    Raises:
        GivenError: it has no table.
    """
    encoding, text = _decoded(start)
    every = text.splitlines()
    said = _SAID.fullmatch(every[0]) if every else None
    # Some programs say above a table what it is.
    above = next(
        (
            n
            for n, line in enumerate(every)
            if line.strip() and not line.startswith("#") and not (said and n == 0)
        ),
        None,
    )
    if above is None:
        raise GivenError("it has no table", file=file)
    lines = [line for line in every[above:] if line.strip()]
    most = csv.field_size_limit()
    if long := next((n for n, line in enumerate(every, 1) if len(line) > most), 0):
        _refuse_cell(file, every[long - 1], long, most)
    separator = said[1] if said else _separator(lines)
    first, header_lines = _first_record(lines, separator)
    # A name of a column may be a year, but not all of them.
    unlabelled = all(is_number(cell) or is_missing(cell) for cell in first)
    numbered = unlabelled and _numbered(first)
    if unlabelled and not numbered and (said_above := _commented(every[:above], separator, first)):
        first, unlabelled, header_lines = said_above, False, 0
    unlabelled = unlabelled and not numbered
    names = [on_one_line(cell) for cell in first]
    named = max((n for n, name in enumerate(names, 1) if name), default=0)
    return CsvHead(
        encoding=encoding,
        separator=separator,
        names=[
            f"column_{number}" if unlabelled or not name else name
            for number, name in enumerate(names, 1)
        ],
        nameless=frozenset(f"column_{n}" for n, name in enumerate(names, 1) if not name),
        named=len(names) if unlabelled else named,
        unlabelled=unlabelled,
        numbered=numbered,
        above=above,
        header=int(not unlabelled and header_lines > 0),
        before=above + (0 if unlabelled else header_lines),
    )


def _numbered(cells: Sequence[str]) -> bool:
    """Say whether cells count from 0 or 1 on, behind an empty one for the index, if any.

    Two numbers may be a run.
    """
    numbers = cells[1:] if cells and not cells[0].strip() else cells
    counted = [str(number) for number in range(len(numbers) + 1)]
    bare = [cell.strip() for cell in numbers]
    return len(bare) >= _FEWEST_NUMBERED and bare in (counted[:-1], counted[1:])


def _commented(above: Sequence[str], separator: str, first: Sequence[str]) -> list[str] | None:
    """Return the names that stand behind a # right above numbers, as numpy writes them, or None.

    There are as many as numbers, and none is a number itself.
    """
    line = above[-1] if above else ""
    if not line.startswith("#"):
        return None
    text = line.lstrip("# ")
    cells = text.split() if separator == BLANKS else next(csv.reader([text], delimiter=separator))
    bare = [cell.strip() for cell in cells]
    named = len(bare) == len(first) > 1 and all(bare)
    return bare if named and not any(map(is_number, bare)) else None


def _refuse_cell(file: str, line: str, number: int, most: int) -> None:
    """Raise a GivenError of a line with a cell of which no reader makes one."""
    if max(map(len, re.split(r"[,;|\t]", line))) > most:
        raise GivenError(
            f"line {number} has a cell of more than {most} characters: a number has fewer",
            file=file,
            line=number,
        )


def _decoded(start: bytes) -> tuple[str, str]:
    """Return the encoding, and the text as far as it goes."""
    encoding = "utf-16" if start.startswith(UTF_16) else "utf-8-sig"
    try:
        # The last character may be cut in two.
        decoder = getincrementaldecoder(encoding)()
        return encoding, decoder.decode(start, final=len(start) < START_BYTES)
    except UnicodeDecodeError:
        return "latin-1", start.decode("latin-1")


def _first_record(lines: Sequence[str], separator: str) -> tuple[list[str], int]:
    """Return the first line's cells, and over how many lines they go."""
    if separator == BLANKS:
        return lines[0].split(), 1
    # A name in quotes may go on in the next line.
    ended = (f"{line}\n" for line in lines)
    reader = csv.reader(ended, delimiter=separator, skipinitialspace=True)
    first, header_lines = next(reader), reader.line_num
    second = next(reader, [])
    # Lines may all end in one separator more than their names.
    if len(second) == len(first) + 1 and not second[-1].strip():
        first.append("")
    return first, header_lines


def _separator(lines: Sequence[str]) -> str:
    """Return what cuts the first lines into equally many cells, most of them; "," if nothing."""
    counted = {}
    for separator in _SEPARATORS:
        records = list(csv.reader(lines[:_LINES], delimiter=separator))
        counts = [len(cells) for cells in records if len(cells) > 1]
        if len(counts) >= len(records):
            usual, often = Counter(counts).most_common(1)[0]
            # Decimal commas may cut as evenly as semicolons do: what cuts the header cuts more.
            counted[separator] = (often == len(counts), separator != ",", usual)
    if not counted:
        blank = [len(line.split()) for line in lines[:_LINES]]
        return BLANKS if Counter(blank).most_common(1)[0][0] == blank[0] > 1 else ","
    return max(counted, key=lambda separator: counted[separator])
