"""Logs as text: numbers in columns, with or without a header, separated by what the file uses."""

import csv
import io
import re
from collections import Counter
from pathlib import Path

import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.logs.log import Channel, Log

#: Of those in as many lines, the first: a decimal comma stands beside another separator.
SEPARATORS = (";", "\t", "|", ",")
DECIMAL_COMMA = re.compile(r"\s*[-+]?\d+,\d+\s*")
UNITS = re.compile(r"[\[(]?[A-Za-zµ°%/·^²0-9 ]{0,8}[\])]?")
MAX_BYTES = 400_000_000


def read(path: Path) -> Log:
    """Read a text file of columns; lines of another width are left out and counted.

    Raises:
        SessionError: the file is no text of columns.
    """
    if path.stat().st_size > MAX_BYTES:
        raise SessionError(f"is larger than {MAX_BYTES // 1_000_000} MB", file=path.name)
    log = Log(kind="CSV")
    lines = [line for line in _decoded(path, log).splitlines() if line.strip()]
    lines = _without_comments(lines, log)
    if len(lines) < 2:
        raise SessionError("has fewer than two lines", file=path.name)
    separator = max(SEPARATORS, key=lambda mark: sum(mark in line for line in lines[:50]))
    if separator not in lines[len(lines) // 2]:
        rows = [line.split() for line in lines]
    else:
        try:
            rows = list(csv.reader(io.StringIO("\n".join(lines)), delimiter=separator))
        except csv.Error as error:
            raise SessionError(f"is no CSV: {error}", file=path.name) from None
    width = Counter(map(len, rows)).most_common(1)[0][0]
    whole = [row for row in rows if len(row) == width]
    if len(whole) < len(rows):
        log.remarks.append(
            f"{len(rows) - len(whole)} of {len(rows)} lines have another number of columns than "
            f"{width} and were left out"
        )
    comma = separator != "," and any(DECIMAL_COMMA.fullmatch(cell) for cell in whole[-1])

    def parse(cell: str) -> float | None:
        return _number(cell.replace(",", ".") if comma else cell)

    names = [cell.strip() for cell in whole[0]]
    if all(parse(cell) is not None for cell in whole[0]):
        names = [f"column {number}" for number in range(1, width + 1)]
        log.remarks.append("the first line holds numbers: the file has no header")
    else:
        names = [name or f"column {at}" for at, name in enumerate(names, start=1)]
        whole = whole[1:]
        if not whole:
            raise SessionError("holds no signal: no line of numbers", file=path.name)
        if all(cell.strip() and parse(cell) is None for cell in whole[0]) and all(
            UNITS.fullmatch(cell.strip()) for cell in whole[0]
        ):
            units = [cell.strip(" []()") for cell in whole[0]]
            names = [f"{name} [{unit}]" for name, unit in zip(names, units, strict=True)]
            whole = whole[1:]
            log.remarks.append("the second line holds units")
    cells = np.array(whole, dtype=object).reshape(len(whole), width)
    for at, name in enumerate(names):
        numbers = [parse(cell) for cell in cells[:, at]]
        known = sum(number is not None for number in numbers)
        if known >= 2:
            values = np.array([np.nan if n is None else n for n in numbers], dtype=float)
            values[np.isinf(values)] = np.nan
            log.channels.append(Channel(name=name, values=values))
        else:
            log.remarks.append(f"{name} holds no numbers and was left out")
    return log


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


def _without_comments(lines: list[str], log: Log) -> list[str]:
    """Leave out lines that begin with #, but for a header in the last of those at the top."""
    top = next((at for at, line in enumerate(lines) if not line.startswith("#")), len(lines))
    kept = [line for line in lines[top:] if not line.startswith("#")]
    if len(kept) < len(lines):
        log.remarks.append(f"{len(lines) - len(kept)} lines begin with # and were left out")
    if top and kept:
        header = lines[top - 1].lstrip("# ")
        marks = [mark for mark in (*SEPARATORS, " ") if mark in kept[0]]
        if marks and header.count(marks[0]) == kept[0].count(marks[0]) and _is_row(kept[0]):
            kept.insert(0, header)
    return kept


def _is_row(line: str) -> bool:
    return all(_number(cell) is not None for cell in re.split(r"[;\t|, ]+", line.strip()))


def _number(cell: str) -> float | None:
    """Return the number in a cell, NaN for an empty one, None for text."""
    if not cell.strip():
        return np.nan
    try:
        return float(cell)
    except ValueError:
        return None
