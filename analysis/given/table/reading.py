"""A CSV or Parquet file as columns of numbers, whatever its separator and its decimal sign."""

from __future__ import annotations

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

from analysis.given.table.cells import checked, column_numbers, on_one_line
from analysis.given.table.csv_head import (
    BLANKS,
    START_BYTES,
    UTF_16,
    CsvHead,
    read_head,
    whole_lines,
)
from analysis.given.table.refusals import GivenError, refuse_quotes, refuse_thousands, refuse_uneven

if TYPE_CHECKING:
    import pandas


#: How JSON of a table begins: {"a": ..., [{"a": ... or [[1, ...; a name may begin with a bracket.
_JSON = re.compile(rb'(\xef\xbb\xbf)?\s*(\{\s*"|\[\s*[\[{])')


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
    #: The first line counts the columns, and is taken for their names.
    numbered: bool = False


def read_sheet(path: Path) -> Sheet:
    """Read a table (CSV of any separator, or Parquet by its ending or its first bytes).

    Raises:
        GivenError: it is empty, has lines of different length, two columns of one name, or a column
            of numbers with a text in it.
        ModuleNotFoundError: a package of the extra `given` is missing.
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        start = file.read(START_BYTES)
        if start.startswith(b"PAR1"):
            return _parquet(path)
        if not start.strip():
            raise GivenError("it is empty", file=path.name)
        if _JSON.match(start):
            raise GivenError(
                "it is JSON or the like, and tables are read as CSV or Parquet: write it as one",
                file=path.name,
            )
        if b"\0" in start and not start.startswith(UTF_16):
            raise GivenError("it is neither CSV nor Parquet", file=path.name)
        start = whole_lines(path.name, start, file)
    return _csv(path, start)


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
            numbers[name] = checked(path.name, name, np.where(np.isfinite(found), found, np.nan))
        else:
            texts[name] = next((str(cell) for cell in column.to_pylist() if cell is not None), "")
    return Sheet(file=path.name, columns=columns, numbers=numbers, texts=texts)


def _number_kinds() -> Sequence[Callable[[Any], bool]]:
    from pyarrow import types

    return types.is_floating, types.is_integer, types.is_boolean, types.is_decimal


def _csv(path: Path, start: bytes) -> Sheet:
    head = read_head(path.name, start)
    _check_names(path.name, head.names, line=head.above + 1)
    table = _table(path, head)
    refuse_thousands(path.name, {name: table[name].tolist() for name in head.names})
    numbers: dict[str, NDArray[np.float64]] = {}
    texts: dict[str, str] = {}
    for name in head.names:
        found = column_numbers(path.name, name, table[name], head.before)
        if name in head.nameless and _is_empty(found):
            continue
        if isinstance(found, str):
            texts[name] = found
        else:
            numbers[name] = found
    return Sheet(
        file=path.name,
        columns=tuple(name for name in head.names if name in numbers or name in texts),
        numbers=numbers,
        texts=texts,
        unlabelled=head.unlabelled,
        numbered=head.numbered,
    )


def _table(path: Path, head: CsvHead) -> pandas.DataFrame:
    """Return the cells below a head as they are written.

    Raises:
        GivenError: a line has more or fewer cells than the others.
    """
    import pandas as pd

    even = partial(
        refuse_uneven,
        path,
        head.encoding,
        separator=None if head.separator == BLANKS else head.separator,
        above=head.before,
        names=len(head.names),
        named=head.named,
    )
    try:
        # A line with more cells than the first one has is only warned of.
        with warnings.catch_warnings(action="error", category=pd.errors.ParserWarning):
            table = pd.read_csv(
                path,
                sep=head.separator,
                names=head.names,
                # A name that goes on in the next line is one line to it.
                skiprows=head.above + head.header,
                dtype=str,
                keep_default_na=False,
                skipinitialspace=True,
                encoding=head.encoding,
                encoding_errors="replace",
                index_col=False,
                on_bad_lines="error",
                engine="c",
                low_memory=False,
            )
    except pd.errors.ParserWarning:
        even()
        raise GivenError(
            f"its first line has {len(head.names)} cells and a line below has more",
            file=path.name,
            line=head.above + 1,
        ) from None
    except pd.errors.ParserError as error:
        found = re.search(r"Expected (\d+) fields in line (\d+), saw (\d+)", str(error))
        if found is None:
            refuse_quotes(
                path,
                head.encoding,
                separator=None if head.separator == BLANKS else head.separator,
                above=head.before,
            )
        wanted, line, saw = map(int, found.groups())
        raise GivenError(
            f"line {line} has {saw} cells and not {wanted} as the lines before",
            file=path.name,
            line=line,
        ) from None
    even()
    return table


def _is_empty(column: NDArray[np.float64] | str) -> bool:
    return not isinstance(column, str) and bool(np.isnan(column).all())


def _check_names(file: str, names: Sequence[str], line: int | None) -> None:
    twice = [name for name, often in Counter(names).items() if often > 1]
    if twice:
        raise GivenError(
            f"two columns are called {twice[0]!r}: give each a name of its own",
            file=file,
            column=twice[0],
            line=line,
        )
