"""Logs as text: numbers in columns, with or without a header, separated by what the file uses."""

import csv
import io
from collections import Counter
from pathlib import Path

import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.logs.log import Channel, Log

SEPARATORS = (",", ";", "\t")
MAX_BYTES = 400_000_000


def read(path: Path) -> Log:
    """Read a text file of columns; lines of another width are left out and counted.

    Raises:
        SessionError: the file is no text of columns.
    """
    if path.stat().st_size > MAX_BYTES:
        raise SessionError(f"is larger than {MAX_BYTES // 1_000_000} MB", file=path.name)
    try:
        content = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise SessionError("is not UTF-8 text", file=path.name) from None
    lines = [line for line in content.splitlines() if line.strip()]
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
    log = Log(kind="CSV")
    width = Counter(map(len, rows)).most_common(1)[0][0]
    whole = [row for row in rows if len(row) == width]
    if len(whole) < len(rows):
        log.remarks.append(
            f"{len(rows) - len(whole)} of {len(rows)} lines have another number of columns than "
            f"{width} and were left out"
        )
    names = [cell.strip().lstrip("#").strip() for cell in whole[0]]
    if all(_number(cell) is not None for cell in whole[0]):
        names = [f"column {number}" for number in range(1, width + 1)]
        log.remarks.append("the first line holds numbers: the file has no header")
    else:
        names = [name or f"column {at}" for at, name in enumerate(names, start=1)]
        whole = whole[1:]
    decimal_comma = separator == ";" and not any(
        _number(cell) is not None and "." in cell for row in whole[:50] for cell in row
    )
    cells = np.array(whole, dtype=object).reshape(len(whole), width)
    for at, name in enumerate(names):
        numbers = [
            _number(cell.replace(",", ".") if decimal_comma else cell) for cell in cells[:, at]
        ]
        known = sum(number is not None for number in numbers)
        if known >= 2:
            values = np.array([np.nan if n is None else n for n in numbers], dtype=float)
            log.channels.append(Channel(name=name, values=values))
        else:
            log.remarks.append(f"{name} holds no numbers and was left out")
    return log


def _number(cell: str) -> float | None:
    """Return the number in a cell, NaN for an empty one, None for text."""
    if not cell.strip():
        return np.nan
    try:
        return float(cell)
    except ValueError:
        return None
