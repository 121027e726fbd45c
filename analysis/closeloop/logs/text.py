"""Logs as text: numbers in columns, with or without a header, separated by what the file uses."""

import csv
import io
import re
from collections import Counter
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.logs.labels import without_labels
from analysis.closeloop.logs.log import Channel, Log
from analysis.closeloop.logs.trials import join_trials
from analysis.closeloop.unit_names import unit_of
from intake.words import counted

#: Of those in as many lines, the first: a decimal comma stands beside another separator.
SEPARATORS = (";", "\t", "|", ",")
COMMENTS = ("#", "%", "//")
#: Characters of a cell without a number that are told.
TOLD = 30
DECIMAL_COMMA = re.compile(r"\s*[-+]?\d+,\d+\s*")
#: What a cell with a unit looks like.
UNIT_CELL = re.compile(r"[\[(]?[A-Za-zµ°%/·^²0-9 .-]{0,10}[\])]?")
#: What stands where a sample is missing.
MISSING = ("", "-", "--", "n/a", "na", "#n/a", "null", "none")
#: What MATLAB ends a duration in.
DURATION = " sec"
#: The time of a day, which may stand after a date.
STAMP = re.compile(r"(?P<date>[\d./-]{8,10}[ T])?(?P<time>\d{1,2}:\d\d:\d\d.*)")
#: Lines from the middle of a file by which its columns are told, and those that may be a header.
LINES = 50
MAX_BYTES = 400_000_000
#: A cell that holds the numbers of several joints, as programs print arrays, and its most numbers.
ARRAY = re.compile(r"\s*[\[(]([-+\d.eE,;\s]+)[\])]\s*")
MOST_IN_A_CELL = 40


def read(path: Path) -> Log:
    """Read a text file of columns; lines of another width are left out and counted.

    Raises:
        SessionError: the file is no text of columns.
    """
    if path.stat().st_size > MAX_BYTES:
        raise SessionError(f"is larger than {MAX_BYTES // 1_000_000} MB", file=path.name)
    log = Log(kind="CSV")
    lines = [line for line in _decoded(path, log).splitlines() if line.strip()]
    lines, comments = _without_comments(lines, log)
    if len(lines) < 2:
        raise SessionError("has fewer than two lines", file=path.name)
    lines, others = without_labels(lines)
    if others:
        log.remarks.append(
            counted(
                others,
                "line has other labels than most and was",
                "lines have other labels than most and were",
            )
            + " left out"
        )
    split = _splitting(lines)
    try:
        rows = split(lines)
    except csv.Error as error:
        raise SessionError(f"is no CSV: {error}", file=path.name) from None
    width = Counter(map(len, rows)).most_common(1)[0][0]
    # Some programs end each line of samples in a separator.
    if width > 1 and all(not row[-1].strip() for row in rows if len(row) == width):
        rows = [row[:-1] if len(row) == width and not row[-1].strip() else row for row in rows]
        width -= 1
    whole = [row for row in rows if len(row) == width]
    if len(whole) < len(rows):
        log.remarks.append(
            f"{len(rows) - len(whole)} of {len(rows)} lines left out: another number of columns "
            f"than {width}"
        )
    first = rows.index(whole[0])
    width, whole = _spread(whole)
    comma = any(DECIMAL_COMMA.fullmatch(cell) for row in _middle(whole) for cell in row)

    def parse(cell: str) -> float | None:
        return _number(cell.replace(",", ".") if comma else cell)

    begin = _begin(whole, parse)
    head = whole[:begin]
    if not head:
        # A header among comments, or one whose names hold spaces.
        above = lines[:first][-2:]
        head = [row for line in [*comments, *above] if (row := _cells(line, split, width))]
    names = _names(head, width, log)
    if begin == len(whole):
        raise SessionError("holds no signal: no line of numbers", file=path.name)
    for name, column in zip(names, zip(*whole[begin:], strict=True), strict=True):
        numbers = [parse(cell) for cell in column]
        if sum(number is not None for number in numbers) >= 2:
            values = np.array([np.nan if n is None else n for n in numbers], dtype=float)
            values[np.isinf(values)] = np.nan
            stamps = any(":" in cell or cell.endswith(DURATION) for cell in column[:LINES])
            log.channels.append(Channel(name=name, values=values, unit="s" if stamps else None))
        else:
            text = next((cell.strip() for cell in column if cell.strip()), "")[:TOLD]
            log.remarks.append(f"{name} holds no numbers, but {text!r}, and was left out")
    join_trials(log)
    return log


def _splitting(lines: Sequence[str]) -> Callable[[Sequence[str]], list[list[str]]]:
    """Return what makes cells of lines, by the lines in the middle."""
    middle = _middle(lines)
    separator = max(SEPARATORS, key=lambda mark: sum(mark in line for line in middle))
    words = lines[len(lines) // 2].split()
    # Columns between spaces, with decimal commas.
    spaced = separator == "," and len(words) > 1 and all(map(DECIMAL_COMMA.fullmatch, words))
    if spaced or separator not in lines[len(lines) // 2]:
        return lambda some: [line.split() for line in some]
    return lambda some: list(csv.reader(io.StringIO("\n".join(some)), delimiter=separator))


def _middle(items: Sequence[Any]) -> Sequence[Any]:
    return items[max(0, len(items) // 2 - LINES // 2) : len(items) // 2 + LINES // 2]


def _spread(rows: list[list[str]]) -> tuple[int, list[list[str]]]:
    """Return the width of rows, and them, with the arrays in a cell a column for each number.

    A header's `q` becomes `q[0]`, `q[1]`, ...; what is no array of so many numbers, missing.
    """
    lengths = {}
    for at in range(len(rows[0])):
        arrays = [len(_array(row[at])) for row in _middle(rows)]
        most = Counter(arrays).most_common(1)[0][0]
        if 0 < most <= MOST_IN_A_CELL and arrays.count(most) > len(arrays) / 2:
            lengths[at] = most
    if not lengths:
        return len(rows[0]), rows
    found = [
        [
            cell
            for at, whole in enumerate(row)
            for cell in (_parted(whole, lengths[at], top=n < LINES) if at in lengths else [whole])
        ]
        for n, row in enumerate(rows)
    ]
    return len(found[0]), found


def _parted(cell: str, count: int, *, top: bool) -> list[str]:
    """Return the numbers in a cell, (count,); above the samples, with `top`, names of columns."""
    numbers = _array(cell)
    if len(numbers) == count:
        return numbers
    named = top and not numbers and any(mark.isalpha() for mark in cell)
    return [f"{cell.strip()}[{n}]" for n in range(count)] if named else [""] * count


def _array(cell: str) -> list[str]:
    """Return what numbers an array in a cell holds; none if it is none."""
    found = ARRAY.fullmatch(cell)
    parts = re.split(r"[,;\s]+", found[1].strip(" ,;\t")) if found else []
    return parts if all(_number(part) is not None for part in parts) else []


def _begin(rows: Sequence[Sequence[str]], parse: Callable[[str], float | None]) -> int:
    """Return the first row of samples: after the last at the top that has names or units.

    Above them may stand rows that have as many cells.
    """
    numeric = sorted(
        {
            at
            for row in _middle(rows)
            for at, cell in enumerate(row)
            if cell.strip() and parse(cell) is not None
        }
    )
    if not numeric:
        return len(rows)

    def words(row: Sequence[str]) -> int:
        return sum(parse(row[at]) is None for at in numeric)

    begin = 0
    for at, row in enumerate(rows[:LINES]):
        if 2 * words(row) >= len(numeric) or (begin == at > 0 and words(row) and _is_units(row)):
            begin = at + 1
    return begin


def _cells(
    line: str, split: Callable[[Sequence[str]], list[list[str]]], width: int
) -> list[str] | None:
    """Return the cells of a line above the samples if it has as many as they, else None."""
    line = line.lstrip("#%/ ").rstrip()
    ways = (split([line])[0] if line else [], line.split(), re.split(r"\s{2,}|\t", line))
    return next(
        (row for row in ways if len(row) == width and any(_number(c) is None for c in row)), None
    )


def _names(head: list[list[str]], width: int, log: Log) -> list[str]:
    """Return the names of columns from the rows above them, each another."""
    if not head:
        log.remarks.append("the first line holds numbers: the file has no header")
        return [f"column {number}" for number in range(1, width + 1)]
    *above, last = [[cell.strip() for cell in row] for row in head]
    units = [""] * width
    if above and _is_units(last):
        units = [cell.strip(" []()") for cell in last]
        *above, last = above
        log.remarks.append("the line below the header holds units")
    names = [name or f"column {at}" for at, name in enumerate(last, start=1)]
    if above and len({*names}) < width:
        group = ""
        for at, cell in enumerate(above.pop()):
            group = cell or group
            names[at] = f"{group} {names[at]}".strip()
    if above:
        said = counted(len(above), "line above the header was", "lines above the header were")
        log.remarks.append(f"{said} left out")
    names = [f"{name} [{unit}]" if unit else name for name, unit in zip(names, units, strict=True)]
    seen: Counter[str] = Counter()
    for at, name in enumerate(names):
        seen[name] += 1
        names[at] = name if seen[name] == 1 else f"{name} ({seen[name]})"
    return names


def _is_units(row: Sequence[str]) -> bool:
    """Whether a row's cells are units: all short, and one of them known."""
    cells = [cell.strip() for cell in row if cell.strip()]
    known = any(unit_of(cell.strip("[]()")) for cell in cells)
    return known and all(UNIT_CELL.fullmatch(cell) for cell in cells)


def _decoded(path: Path, log: Log) -> str:
    """Return a file's text: UTF-8, UTF-16 with its mark, else Latin-1, as Excel writes."""
    raw = path.read_bytes()
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        return raw.decode("utf-16", errors="replace")
    if b"\0" in raw[:4096]:
        raise SessionError("holds zero bytes: it is no text", file=path.name)
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        log.remarks.append("the text is not UTF-8, and was read as Latin-1")
        return raw.decode("latin-1")


def _without_comments(lines: list[str], log: Log) -> tuple[list[str], list[str]]:
    """Return the lines without comments, and the last two comments above them all."""
    top = next(
        (at for at, line in enumerate(lines) if not line.lstrip().startswith(COMMENTS)), len(lines)
    )
    kept = [line for line in lines[top:] if not line.lstrip().startswith(COMMENTS)]
    if len(kept) < len(lines):
        said = counted(
            len(lines) - len(kept), "line is a comment and was", "lines are comments and were"
        )
        log.remarks.append(f"{said} left out")
    return kept, lines[max(0, top - 2) : top]


def _number(cell: str) -> float | None:
    """Return the number in a cell, a stamp's in s, NaN for a missing one, None for text."""
    cell = cell.strip()
    try:
        return float(cell)
    except ValueError:
        pass
    if cell.lower() in MISSING:
        return np.nan
    if stamp := STAMP.fullmatch(cell):
        date = re.sub(r"(\d\d)\.(\d\d)\.(\d{4})", r"\3-\2-\1", stamp["date"] or "1970-01-01 ")
        hour, rest = stamp["time"].split(":", 1)
        try:
            time = datetime.fromisoformat(f"{date.replace('/', '-')}{hour:0>2}:{rest}")
        except ValueError:
            return None
        return (time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp()
    return _number(cell.removesuffix(DURATION)) if cell.endswith(DURATION) else None
