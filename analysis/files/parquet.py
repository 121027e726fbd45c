"""A study's results as Apache Parquet: one line per instance, as in `results.csv`.

pyarrow is imported when a file is written, so that a coordinator without it can run.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from analysis.files.results_csv import columns
from analysis.sensitivity.records import curves_of
from models.curves import columns_of

if TYPE_CHECKING:
    import pyarrow

#: Lines of one row group: few enough to keep in memory, enough to compress well.
GROUP = 20_000

#: Key of the file's metadata under which the study's description is found, as JSON.
STUDY_KEY = b"rehyb.study"

Line = Sequence[object]


def parquet(
    study: Mapping[str, Any], lines: Iterable[Line], units: Mapping[str, str]
) -> Iterator[bytes]:
    """Yield a Parquet file piece by piece; memory does not grow with the number of lines.

    Columns are `row`, `position`, the factors, `outcome`, the outputs, `wall_seconds` and `worker`;
    an output of a failed run is null. A curve is one column of lists.

    Args:
        study: as `GET /v1/studies/{id}` describes it; goes into the file's metadata.
        lines: results in the order of the columns, None for what there is not.
        units: of factors and outputs by name; each goes into its column's metadata.

    Raises:
        ModuleNotFoundError: pyarrow is not installed (extra `files`).
    """
    import pyarrow as pa
    from pyarrow.parquet import ParquetWriter

    schema = _schema(study, units)
    pieces = _Pieces()
    # Numbers of a study hardly repeat; names of workers and outcomes always do.
    with ParquetWriter(
        pieces, schema, compression="zstd", use_dictionary=["outcome", "worker"]
    ) as writer:
        remaining = iter(lines)
        while group := list(islice(remaining, GROUP)):
            columns = zip(*group, strict=True)
            writer.write_table(
                pa.Table.from_arrays(
                    [_array(field.type, columns) for field in schema], schema=schema
                )
            )
            yield pieces.take()
    yield pieces.take()


def write_parquet(
    path: Path, study: Mapping[str, Any], results: Path, units: Mapping[str, str]
) -> None:
    """Write a study's `results.csv` as Parquet.

    Raises:
        ValueError: the table is not one of this study.
        ModuleNotFoundError: pyarrow is not installed (extra `files`).
    """
    with path.open("wb") as file:
        for piece in parquet(study, _lines(study, results), units):
            file.write(piece)


def _array(kind: pyarrow.DataType, columns: Iterator[Sequence[Any]]) -> pyarrow.Array:
    """Return the next column, or the next ones as lists, which a failed run has none of."""
    import pyarrow as pa

    if not pa.types.is_fixed_size_list(kind):
        return pa.array(next(columns), kind)
    points = zip(*(next(columns) for _ in range(kind.list_size)), strict=True)
    return pa.array([None if point[0] is None else list(point) for point in points], kind)


def _columns(study: Mapping[str, Any]) -> list[str]:
    """Return the columns of the study's `results.csv`."""
    outputs = columns_of(study["outputs"], curves_of(study))
    return columns((factor["name"] for factor in study["factors"]), outputs)


def _lines(study: Mapping[str, Any], results: Path) -> Iterator[Line]:
    wanted = _columns(study)
    texts, whole = {"outcome", "worker"}, {"row", "position"}
    read = [str if name in texts else int if name in whole else _number for name in wanted]
    with results.open(newline="") as file:
        table = csv.reader(file)
        if (header := next(table, [])) != wanted:
            raise ValueError(
                f"{results} is no table of study {study['id']}: its columns are "
                f"{', '.join(header)}, not {', '.join(wanted)}"
            )
        for line in table:
            yield [kind(cell) for kind, cell in zip(read, line, strict=True)]


def _number(cell: str) -> float | None:
    return float(cell) if cell else None


def _schema(study: Mapping[str, Any], units: Mapping[str, str]) -> pyarrow.Schema:
    import pyarrow as pa

    text = pa.dictionary(pa.int32(), pa.string())
    kinds = {"row": pa.int64(), "position": pa.int32(), "outcome": text, "worker": text}
    for name, curve in curves_of(study).items():
        kinds[name] = pa.list_(pa.float64(), curve.points)
    fields = [
        pa.field(
            name,
            kinds.get(name, pa.float64()),
            metadata={"unit": units[name]} if name in units else None,
        )
        for name in columns((factor["name"] for factor in study["factors"]), study["outputs"])
    ]
    return pa.schema(fields, metadata={STUDY_KEY: json.dumps(study, sort_keys=True).encode()})


class _Pieces(io.RawIOBase):
    """A file that is written to, and taken from the front at any time, also when it is closed."""

    def __init__(self) -> None:
        self._waiting: list[bytes] = []
        self._written = 0

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> int:
        """Keep `data` until it is taken."""
        piece = bytes(data)
        self._waiting.append(piece)
        self._written += len(piece)
        return len(piece)

    def tell(self) -> int:
        """Return how many bytes were ever written."""
        return self._written

    def take(self) -> bytes:
        """Return what was written since the last time."""
        data = b"".join(self._waiting)
        self._waiting = []
        return data
