"""What the estimators of both methods share: sums over rows that survive any order of arrival."""

import io
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from analysis.designs import BLOCKS, blocks_of, row_width
from analysis.estimators.bootstrap import REPLICATES, weights
from analysis.estimators.exact_sum import ExactSums, Integers, divide, square
from analysis.estimators.intervals import Estimate, satterthwaite, student

#: An output of larger magnitude counts as failed: its square has no exact sum.
LARGEST_OUTPUT = 1e100

#: What rows add to the sums, by name: (points, rows, outputs, factors) or (points, rows, outputs);
#: nan marks what a sum leaves out.
Terms = Mapping[str, NDArray[np.float64]]

#: Sums of this ending add up the exact squares of their terms.
SQUARED = "_squared"

#: Ways to weight the rows: all alike, as each bootstrap replicate draws them, all but one block.
WEIGHTINGS = 1 + REPLICATES + BLOCKS


@dataclass(frozen=True, kw_only=True)
class Moments:
    """Mean, standard deviation (n - 1) and number of each output's values, shape (outputs,)."""

    mean: NDArray[np.float64]
    sd: NDArray[np.float64]
    n: NDArray[np.int64]


@dataclass(frozen=True, kw_only=True)
class Statistic:
    """A statistic in every weighting of the rows."""

    #: Shape (1 + REPLICATES, outputs, factors), or without factors; the first is the sample itself,
    #: the others are its bootstrap replicates; nan where a weighting leaves it undefined.
    weighted: NDArray[np.float64]
    #: From how many rows it was computed, shape (outputs, factors), or without factors.
    n: NDArray[np.int64]
    #: What it would be without each block of rows, shape (BLOCKS, ...).
    without: NDArray[np.float64]
    #: Which blocks it has rows of, shape (BLOCKS, ...).
    present: NDArray[np.bool_]
    #: 1 for a mean of squares or magnitudes, 2 for the root of one, None for what has either sign.
    power: int | None

    def estimate(self, level: float) -> Estimate:
        """Return it with its interval at `level`; ValueError if that is not between 0 and 1."""
        value = self.weighted[0]
        if self.power is None:
            return student(value, self.without, self.present, level)
        return satterthwaite(value, self.without, self.present, level, self.power)


class Estimator(ABC):
    """Indices of several outputs from rows that arrive in any order.

    It does not notice a row that is added twice: whoever feeds it must.

    Args:
        sampling, seed: of the design, one of `analysis.designs.SAMPLINGS`.
        factors, outputs: how many.
        indicators: how many of the outputs, the last ones, say something of every run, also of a
            failed one. They alone do not make a row count as used.
    """

    method: ClassVar[str]
    #: The sum of which a row must have a term to count as used.
    use: ClassVar[str]
    #: Sums kept per output and factor, and per output.
    factor_sums: ClassVar[tuple[str, ...]]
    output_sums: ClassVar[tuple[str, ...]] = ("value", "value" + SQUARED)

    def __init__(
        self, *, sampling: str, seed: int, factors: int, outputs: int, indicators: int = 0
    ) -> None:
        self.sampling = sampling
        self.seed = seed
        self.factors = factors
        self.outputs = outputs
        self.indicators = indicators
        self.width = row_width(self.method, factors)
        #: Rows of which at least one index could use a part.
        self.rows_used = 0
        self._columns: dict[str, slice] = {}
        stop = 0
        for name in self.factor_sums + self.output_sums:
            start, stop = stop, stop + outputs * (factors if name in self.factor_sums else 1)
            self._columns[name] = slice(start, stop)
        #: The last weightings are sums of one block each: what a block lacks, the others have.
        self._sums = ExactSums(WEIGHTINGS, stop)
        self._counts: NDArray[np.int64] = np.zeros(self._sums.shape, dtype=np.int64)

    def add_rows(self, rows: Sequence[int], values: NDArray[np.float64]) -> None:
        """Take in complete rows.

        Args:
            rows: their numbers in the design.
            values: shape (rows, width, outputs), nan where a run failed.

        Raises:
            ValueError: the shape of `values` is another.
        """
        if values.shape != (len(rows), self.width, self.outputs):
            wanted = (len(rows), self.width, self.outputs)
            raise ValueError(f"values must have shape {wanted}, not {values.shape}")
        if not rows:
            return
        usable = np.where(np.abs(values) <= LARGEST_OUTPUT, values, np.nan)
        block = np.arange(BLOCKS)[:, None] == blocks_of(self.sampling, self.seed, rows)
        weighting = np.concatenate([weights(self.seed, rows), block])
        for name, terms in self._terms(rows, usable).items():
            columns, flat = self._columns[name], terms.reshape(*terms.shape[:2], -1)
            valid = ~np.isnan(flat)
            addends = np.where(valid, flat, 0.0)
            if name.endswith(SQUARED):
                addends = np.concatenate(square(addends))
            self._sums.add(columns, weighting, addends)
            counts = weighting @ valid.sum(axis=0, dtype=np.float64)
            self._counts[:, columns] += counts.astype(np.int64)
            if name == self.use:
                of_output = valid.reshape(*valid.shape[:2], self.outputs, -1)
                measured = of_output[:, :, : self.outputs - self.indicators]
                self.rows_used += int(measured.any(axis=(0, 2, 3)).sum())

    def merge(self, other: Self) -> None:
        """Add what `other` has seen; ValueError if it belongs to another study."""
        if self._identity() != other._identity():
            raise ValueError("only estimators of one study can be merged")
        self._sums.merge(other._sums)
        self._counts += other._counts
        self.rows_used += other.rows_used

    @abstractmethod
    def statistics(self) -> dict[str, Statistic]:
        """Return each index in every weighting of the rows."""

    def indices(self, level: float = 0.9) -> dict[str, Estimate]:
        """Return each of `statistics` with its interval at `level`."""
        return {name: statistic.estimate(level) for name, statistic in self.statistics().items()}

    @property
    @abstractmethod
    def effects(self) -> NDArray[np.int64]:
        """From how many rows each index was computed, shape (outputs, factors)."""

    def moments(self) -> Moments:
        """Return mean and spread of the outputs over the factors' distributions."""
        with np.errstate(invalid="ignore"):
            sd = np.sqrt(self._variance("value", ddof=1)[0])
        return Moments(mean=self._mean("value")[0], sd=sd, n=self._first_count("value"))

    def weighted_mean(self, output: int) -> NDArray[np.float64]:
        """Return an output's mean in every weighting of the rows, shape (1 + replicates,)."""
        mean: NDArray[np.float64] = self._mean("value")[: 1 + REPLICATES, output]
        return mean

    def to_bytes(self) -> bytes:
        """Return all that was summed, as an NPZ file without pickles."""
        buffer = io.BytesIO()
        np.savez(
            buffer,
            low=np.int64(self._sums.low),
            limbs=self._sums.limbs,
            counts=self._counts,
            rows_used=np.int64(self.rows_used),
        )
        return buffer.getvalue()

    def load_bytes(self, data: bytes) -> None:
        """Replace what was summed by what `to_bytes` of an equal estimator returned.

        Raises:
            ValueError: the bytes are those of an estimator of other shape.
        """
        with np.load(io.BytesIO(data), allow_pickle=False) as saved:
            if saved["counts"].shape != self._counts.shape:
                raise ValueError("these bytes are the state of a study of other shape")
            self._sums.low = int(saved["low"])
            self._sums.limbs = saved["limbs"]
            self._counts = saved["counts"]
            self.rows_used = int(saved["rows_used"])

    @abstractmethod
    def _terms(self, rows: Sequence[int], values: NDArray[np.float64]) -> Terms:
        """Return what `rows` with these (rows, width, outputs) values add to every sum."""

    def _identity(self) -> tuple[object, ...]:
        shape = (self.factors, self.outputs, self.indicators)
        return (self.method, self.sampling, self.seed, *shape)

    def _shape(self, name: str) -> tuple[int, ...]:
        of_factor = name in self.factor_sums
        return (-1, self.outputs, self.factors) if of_factor else (-1, self.outputs)

    def _statistic(
        self, values: NDArray[np.float64], counts: NDArray[np.int64], power: int | None = None
    ) -> Statistic:
        """Return a statistic from its values and numbers of rows in every weighting."""
        end = 1 + REPLICATES
        return Statistic(
            weighted=values[:end],
            n=counts[0],
            without=values[end:],
            present=counts[end:] < counts[0],
            power=power,
        )

    def _count(self, name: str) -> NDArray[np.int64]:
        """Return how many terms a sum has in every weighting."""
        counts: NDArray[np.int64] = _without_blocks(self._counts[:, self._columns[name]])
        return counts.reshape(self._shape(name))

    def _first_count(self, name: str) -> NDArray[np.int64]:
        """Return how many terms a sum has, every row counted once."""
        counts: NDArray[np.int64] = self._count(name)[0]
        return counts

    def _total(self, name: str) -> tuple[Integers, int]:
        total, shift = self._sums.integers(self._columns[name])
        return _without_blocks(total).reshape(self._shape(name)), shift

    def _mean(self, name: str) -> NDArray[np.float64]:
        """Return the mean of a sum in every weighting, rounded once; nan of nothing."""
        total, shift = self._total(name)
        return divide(total, self._count(name).astype(object), shift)

    def _variance(self, name: str, *, ddof: int) -> NDArray[np.float64]:
        """Return the variance in every weighting, rounded once, so 0 exactly if nothing varies."""
        total, shift = self._total(name)
        squares, _ = self._total(name + SQUARED)
        n = self._count(name).astype(object)
        numerator = n * (squares << shift) - total * total
        return divide(numerator, np.where(n > ddof, n * (n - ddof), 0), 2 * shift)


def _without_blocks(sums: NDArray[Any]) -> NDArray[Any]:
    """Return sums of all rows but a block's where there were sums of the block, shape of `sums`."""
    end = 1 + REPLICATES
    return np.concatenate([sums[:end], sums[:1] - sums[end:]])
