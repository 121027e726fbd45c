"""How the indices of a study came to be what they are: from its first 8, 16, 32, ... rows.

The paper's figure 11 recomputes indices from growing parts of the sample. Here a part is the first
2**m rows of the design, whatever the order in which their results arrived, so the series is a
function of the results alone. Rows of one block, from 2**(m - 1) to 2**m - 1, have an estimator of
their own until every row before 2**m is in; then the block is merged with those before it, and the
indices at that moment are a point of the series. For Sobol points these are also the answers that
count, since the sequence is balanced at powers of two (Owen 2020, On dropping the first Sobol'
point).
"""

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.sensitivity.estimators import Estimate, Estimator

#: Rows of the first point: intervals of fewer say nothing.
FIRST = 8


@dataclass(frozen=True, kw_only=True)
class Point:
    """The indices of the first `rows` rows, arrays of shape (outputs, factors or pairs)."""

    rows: int
    indices: dict[str, Estimate]


class GrowingEstimator:
    """An estimator that remembers what it said at powers of two.

    Args:
        new: makes an empty estimator of the study.
        level: of the intervals in the series.
    """

    def __init__(self, new: Callable[[], Estimator], level: float) -> None:
        self._new = new
        self._level = level
        self._closed = new()
        #: The block that is to be merged next, and estimators of blocks from there on.
        self._next = 0
        self._open: dict[int, Estimator] = {}
        self._counts: dict[int, int] = {}
        self.series: list[Point] = []

    @property
    def width(self) -> int:
        """Points in a row."""
        return self._closed.width

    def add_rows(self, rows: Sequence[int], values: NDArray[np.float64]) -> None:
        """Take in complete rows, each once, as `Estimator.add_rows` does."""
        blocks = [row.bit_length() for row in rows]
        for block in sorted(set(blocks)):
            places = [place for place, other in enumerate(blocks) if other == block]
            estimator = self._open.setdefault(block, self._new())
            estimator.add_rows([rows[place] for place in places], values[places])
            self._counts[block] = self._counts.get(block, 0) + len(places)
        while self._counts.get(self._next) == _size(self._next):
            self._close()

    def total(self) -> Estimator:
        """Return an estimator of all rows so far."""
        total = self._new()
        total.merge(self._closed)
        for block in sorted(self._open):
            total.merge(self._open[block])
        return total

    def to_bytes(self) -> bytes:
        """Return all of it as an NPZ file without pickles."""
        arrays = {
            "next": np.int64(self._next),
            "closed": _bytes(self._closed.to_bytes()),
            "blocks": np.array(sorted(self._open), dtype=np.int64),
            "counts": np.array([self._counts[block] for block in sorted(self._open)], np.int64),
            "rows": np.array([point.rows for point in self.series], dtype=np.int64),
        }
        for block, estimator in self._open.items():
            arrays[f"block{block}"] = _bytes(estimator.to_bytes())
        for p, point in enumerate(self.series):
            for name, index in point.indices.items():
                arrays[f"point{p}.{name}"] = np.stack([index.value, index.low, index.high])
        buffer = io.BytesIO()
        np.savez(buffer, **arrays)  # type: ignore[arg-type]
        return buffer.getvalue()

    def load_bytes(self, data: bytes) -> None:
        """Replace all by what `to_bytes` of an equal one returned; ValueError if it was not."""
        with np.load(io.BytesIO(data), allow_pickle=False) as saved:
            self._next = int(saved["next"])
            self._closed.load_bytes(saved["closed"].tobytes())
            self._open, self._counts = {}, {}
            for block, count in zip(
                saved["blocks"].tolist(), saved["counts"].tolist(), strict=True
            ):
                self._open[block] = self._new()
                self._open[block].load_bytes(saved[f"block{block}"].tobytes())
                self._counts[block] = count
            self.series = []
            for p, rows in enumerate(saved["rows"].tolist()):
                start = f"point{p}."
                names = [name.removeprefix(start) for name in saved if name.startswith(start)]
                indices = {
                    name: Estimate(value=value, low=low, high=high)
                    for name in names
                    for value, low, high in [saved[start + name]]
                }
                self.series.append(Point(rows=rows, indices=indices))

    def _close(self) -> None:
        """Merge the next block with those before it; its rows are all in."""
        self._closed.merge(self._open.pop(self._next))
        del self._counts[self._next]
        rows = 1 << self._next
        self._next += 1
        if rows >= FIRST:
            indices = self._closed.indices(self._level)
            single = {name: index for name, index in indices.items() if index.value.ndim == 2}
            self.series.append(Point(rows=rows, indices=single))


def _size(block: int) -> int:
    """Return how many rows have numbers of `block` binary digits."""
    return 1 << max(block - 1, 0)


def _bytes(data: bytes) -> NDArray[np.uint8]:
    return np.frombuffer(data, dtype=np.uint8)
