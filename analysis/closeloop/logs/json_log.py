"""JSON: lists of numbers, and lists of objects that hold one sample each, as channels."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.logs.arrays import log_of
from analysis.closeloop.logs.hdf5 import MAX_NUMBERS
from analysis.closeloop.logs.log import Log

#: Longest file, bytes: a number takes some twenty.
MAX_BYTES = 20 * MAX_NUMBERS


def read(path: Path) -> Log:
    """Read a `.json` file; what is neither a number nor a list of them is left out.

    Raises:
        SessionError: the file is damaged, or too large.
    """
    if (size := path.stat().st_size) > MAX_BYTES:
        raise SessionError(f"has {size} bytes; at most {MAX_BYTES}", file=path.name)
    try:
        content = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise SessionError(f"is no JSON: {error}", file=path.name) from None
    return log_of("JSON", _arrays(content, ""))


def _arrays(content: Any, path: str) -> Iterator[tuple[str, np.ndarray]]:
    """Return every list of numbers below `content` with its path; trials are numbered from 1."""
    if isinstance(content, dict):
        fields = content
    elif not isinstance(content, list) or not content:
        return
    elif all(isinstance(entry, dict) for entry in content):
        fields = _samples(content) or {str(n): entry for n, entry in enumerate(content, start=1)}
    else:
        table = _numbers(content)
        if table is not None:
            yield path or "data", table
        return
    for key, value in fields.items():
        yield from _arrays(value, f"{path}/{key}" if path else key)


def _samples(entries: list[dict[str, Any]]) -> dict[str, list[Any]]:
    """Return the columns of objects that are samples: the numbers that any of them has."""
    names = dict.fromkeys(name for entry in entries for name in entry)
    columns = {name: [entry.get(name) for entry in entries] for name in names}
    return {name: own for name, own in columns.items() if _numbers(own) is not None}


def _numbers(values: list[Any]) -> np.ndarray | None:
    """Return a list of numbers, or of lists as long of them, (n,) or (n, m); None if it is none.

    What is missing (null) is NaN.
    """
    known = [value for value in values if value is not None]
    if known and all(isinstance(value, list) for value in known) and len(known) == len(values):
        rows = [_numbers(value) for value in known]
        kept = [row for row in rows if row is not None and row.ndim == 1]
        alike = len(kept) == len(rows) and len({len(row) for row in kept}) == 1
        return np.array(kept) if alike else None
    if not known or not all(isinstance(value, int | float) for value in known):
        return None
    return np.array([np.nan if value is None else value for value in values], dtype=float)
