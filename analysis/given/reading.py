"""A CSV or Parquet file as columns of numbers, whatever its separator and its decimal sign."""

from __future__ import annotations

import csv
import re
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from analysis.given.refusals import GivenError, refuse_thousands, refuse_uneven

if TYPE_CHECKING:
    import pandas

#: Between columns, as programs write them; blanks where none of these is.
_SEPARATORS = (",", ";", "\t", "|")
_BLANKS = r"\s+"
#: 1.5, -2, 1e-3, .5; and with a comma.
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_COMMA_NUMBER = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
#: How a spreadsheet's CSV may begin: which separator it has.
_SAID = re.compile(r'"?sep=([,;|:\t])"?', re.IGNORECASE)
#: How a spreadsheet's "Unicode text" begins.
_UTF_16 = (b"\xff\xfe", b"\xfe\xff")
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


@dataclass(frozen=True, kw_only=True)
class Sheet:
    """The columns of a file."""

    #: What sentences call it.
    file: str
    #: Names of all columns, in order.
    columns: tuple[str, ...]
    #: Numbers, nan where a cell is empty or infinite, shape (lines,).
    numbers: Mapping[str, NDArray[np.float64]]
    #: Columns without numbers, each with a text that stands in it.
    texts: Mapping[str, str]
    #: The first lines were numbers already: columns are called column_1, column_2, ...
    unlabelled: bool = False


def read_sheet(path: Path) -> Sheet:
    """Read a table (CSV of any separator, or Parquet by its ending or its first bytes).

    Raises:
        GivenError: it is empty, has lines of different length, two columns of one name, or a column
            of numbers with a text in it.
        ModuleNotFoundError: a package of the extra `given` is missing.
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        start = file.read(1 << 16)
    if start.startswith(b"PAR1"):
        return _parquet(path)
    if not start.strip():
        raise GivenError("it is empty", file=path.name)
    if b"\0" in start and not start.startswith(_UTF_16):
        raise GivenError("it is neither CSV nor Parquet", file=path.name)
    return _csv(path, start)


def on_one_line(name: str) -> str:
    """Return a column's name as sentences have it: line breaks and blanks are one blank."""
    return " ".join(name.split())


def _parquet(path: Path) -> Sheet:
    import pyarrow as pa
    import pyarrow.parquet

    try:
        with pyarrow.parquet.ParquetFile(path) as file:
            columns = tuple(on_one_line(name) for name in file.schema_arrow.names)
            _check_names(path.name, columns, line=None)
            table = file.read()
    except (pa.ArrowException, OSError):
        raise GivenError("it cannot be read as Parquet", file=path.name) from None
    numbers: dict[str, NDArray[np.float64]] = {}
    texts: dict[str, str] = {}
    for name, column in zip(columns, table.columns, strict=True):
        kind = column.type
        if any(is_kind(kind) for is_kind in _number_kinds()):
            found = np.array(
                column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False), dtype=float
            )
            numbers[name] = _checked(path.name, name, np.where(np.isfinite(found), found, np.nan))
        else:
            texts[name] = next((str(cell) for cell in column.to_pylist() if cell is not None), "")
    return Sheet(file=path.name, columns=columns, numbers=numbers, texts=texts)


def _number_kinds() -> Sequence[Callable[[Any], bool]]:
    from pyarrow import types

    return types.is_floating, types.is_integer, types.is_boolean, types.is_decimal


def _csv(path: Path, start: bytes) -> Sheet:
    import pandas as pd

    encoding = "utf-16" if start.startswith(_UTF_16) else "utf-8-sig"
    try:
        text = start.decode(encoding, errors="strict" if len(start) < 1 << 16 else "ignore")
    except UnicodeDecodeError:
        encoding, text = "latin-1", start.decode("latin-1")
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
        raise GivenError("it has no table", file=path.name)
    lines = [line for line in every[above:] if line.strip()]
    separator = said[1] if said else _separator(lines)
    first, header_lines = lines[0].split(), 1
    if separator != _BLANKS:
        # A name in quotes may go on in the next line.
        ended = (f"{line}\n" for line in lines)
        reader = csv.reader(ended, delimiter=separator, skipinitialspace=True)
        first, header_lines = next(reader), reader.line_num
        second = next(reader, [])
        # Lines may all end in one separator more than their names.
        if len(second) == len(first) + 1 and not second[-1].strip():
            first.append("")
    # A name of a column may be a year, but not all of them.
    unlabelled = all(_is_number(cell) or cell.strip().lower() in _MISSING for cell in first)
    names = [on_one_line(cell) for cell in first]
    # Such as behind a separator at the end of every line.
    nameless = {f"column_{n}" for n, name in enumerate(names, 1) if not name}
    named = max((n for n, name in enumerate(names, 1) if name), default=0)
    if unlabelled:
        names = [f"column_{number}" for number in range(1, len(first) + 1)]
    names = [name or f"column_{number}" for number, name in enumerate(names, 1)]
    _check_names(path.name, names, line=above + 1)
    skipped = above + (0 if unlabelled else 1)
    before = above + (0 if unlabelled else header_lines)
    even = partial(
        refuse_uneven,
        path,
        encoding,
        separator=None if separator == _BLANKS else separator,
        above=before,
        names=len(names),
        named=len(names) if unlabelled else named,
    )
    try:
        # A line with more cells than the first one has is only warned of.
        with warnings.catch_warnings(action="error", category=pd.errors.ParserWarning):
            table = pd.read_csv(
                path,
                sep=separator,
                names=names,
                skiprows=skipped,
                dtype=str,
                keep_default_na=False,
                skipinitialspace=True,
                encoding=encoding,
                encoding_errors="replace",
                index_col=False,
                on_bad_lines="error",
                engine="c",
                low_memory=False,
            )
    except pd.errors.ParserWarning:
        even()
        raise GivenError(
            f"its first line has {len(names)} cells and a line below has more",
            file=path.name,
            line=above + 1,
        ) from None
    except pd.errors.ParserError as error:
        found = re.search(r"Expected (\d+) fields in line (\d+), saw (\d+)", str(error))
        if found is None:
            raise GivenError(f"it cannot be read as CSV: {error}", file=path.name) from None
        wanted, line, saw = map(int, found.groups())
        raise GivenError(
            f"line {line} has {saw} cells and not {wanted} as the lines before",
            file=path.name,
            line=line,
        ) from None
    even()
    refuse_thousands(path.name, {name: table[name].tolist() for name in names})
    numbers: dict[str, NDArray[np.float64]] = {}
    texts: dict[str, str] = {}
    for name in names:
        found_numbers = _numbers(path.name, name, table[name], before)
        if name in nameless and _is_empty(found_numbers):
            continue
        if isinstance(found_numbers, str):
            texts[name] = found_numbers
        else:
            numbers[name] = found_numbers
    return Sheet(
        file=path.name,
        columns=tuple(name for name in names if name in numbers or name in texts),
        numbers=numbers,
        texts=texts,
        unlabelled=unlabelled,
    )


def _is_empty(column: NDArray[np.float64] | str) -> bool:
    return not isinstance(column, str) and bool(np.isnan(column).all())


def _separator(lines: Sequence[str]) -> str:
    """Return what cuts the first lines into equally many cells, most of them; "," if nothing."""
    counted = {}
    for separator in _SEPARATORS:
        records = list(csv.reader(lines[:20], delimiter=separator))
        counts = [len(cells) for cells in records if len(cells) > 1]
        if len(counts) >= len(records):
            usual, often = Counter(counts).most_common(1)[0]
            # Decimal commas may cut as evenly as semicolons do: what cuts the header cuts more.
            counted[separator] = (often == len(counts), separator != ",", usual)
    if not counted:
        blank = [len(line.split()) for line in lines[:20]]
        return _BLANKS if Counter(blank).most_common(1)[0][0] == blank[0] > 1 else ","
    return max(counted, key=lambda separator: counted[separator])


def _is_number(cell: str) -> bool:
    cell = cell.strip()
    return bool(_NUMBER.fullmatch(cell) or _COMMA_NUMBER.fullmatch(cell))


def _numbers(
    file: str, name: str, cells: pandas.Series[Any], skipped: int
) -> NDArray[np.float64] | str:
    """Return a column's numbers; one of its texts if it has none but texts."""
    import pandas as pd

    stripped = cells.astype(str).str.strip()
    numbers: NDArray[np.float64]
    numbers = np.array(pd.to_numeric(stripped, errors="coerce"), dtype=np.float64)
    odd = np.flatnonzero(np.isnan(numbers))
    wrong: list[int] = []
    for at in odd.tolist():
        cell, part = _plain(stripped.iloc[at])
        if _is_number(cell):
            numbers[at] = part * float(cell.replace(",", "."))
        elif cell.lower() in _TRUTHS:
            numbers[at] = _TRUTHS[cell.lower()]
        elif cell.lower() not in _MISSING and not _INFINITE.fullmatch(cell):
            wrong.append(at)
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
    return _checked(file, name, numbers)


def _plain(cell: str) -> tuple[str, float]:
    """Return 1 234 and −5 as programs write them, and what a number is of one: 0.01 with %."""
    bare = _PERCENT.sub("", cell)
    return _GROUPED.sub("", _MINUS.sub("-", bare)), 1.0 if bare == cell else 0.01


def _checked(file: str, name: str, numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    if np.any(np.abs(numbers) > _LARGEST):
        raise GivenError(f"column {name} has numbers beyond ±{_LARGEST:g}", file=file, column=name)
    if 0.0 < np.max(np.abs(numbers), initial=0.0, where=~np.isnan(numbers)) < 1.0 / _LARGEST:
        raise GivenError(
            f"column {name} has no number beyond ±{1.0 / _LARGEST:g}: give it in a smaller unit",
            file=file,
            column=name,
        )
    return numbers


def _check_names(file: str, names: Sequence[str], line: int | None) -> None:
    twice = [name for name, often in Counter(names).items() if often > 1]
    if twice:
        raise GivenError(
            f"two columns are called {twice[0]!r}: give each a name of its own",
            file=file,
            column=twice[0],
            line=line,
        )
