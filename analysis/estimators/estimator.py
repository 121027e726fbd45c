"""What the estimators of both methods share: sums over rows that survive any order of arrival.

Why they do is docs/adr/0004-sums-do-not-depend-on-order.md.
"""

import io
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from analysis.designs import row_width
from analysis.estimators.exact_sum import ExactSums, square
from analysis.estimators.intervals import Estimate, estimate
from analysis.estimators.weightings import FIRST, SQUARED, WEIGHTINGS, Weighted, weights

#: An output of larger magnitude counts as failed: its square has no exact sum.
LARGEST_OUTPUT = 1e100

#: Indices of pairs of factors, in the order of `numpy.triu_indices(factors, 1)`; all others are of
#: single factors or of whole outputs.
OF_PAIRS = ("second_order",)

#: What rows add to the sums, by name: (points, rows, outputs, factors), (points, rows, outputs,
#: pairs) or (points, rows, outputs); nan marks what a sum leaves out.
Terms = Mapping[str, NDArray[np.float64]]

#: An index in every weighting, from how many rows it is, and `Statistic.power`.
Index = tuple[NDArray[np.float64], NDArray[np.int64], int | None]


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
        return estimate(self.weighted[0], self.without, self.present, level, self.power)


class Estimator(ABC):
    """Indices of several outputs from rows that arrive in any order.

    It does not notice a row that is added twice: whoever feeds it must.

    Args:
        sampling, seed: of the design, one of `analysis.designs.samplings`.
        factors, outputs: how many.
        indicators: how many of the outputs, the last ones, say something of every run, also of a
            failed one. They alone do not make a row count as used.
    """

    method: ClassVar[str]
    #: The sum of which a row must have a term to count as used.
    use: ClassVar[str]
    #: Sums kept per output and factor, per output and pair of factors, and per output.
    factor_sums: ClassVar[tuple[str, ...]]
    pair_sums: ClassVar[tuple[str, ...]] = ()
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
        #: Where each sum is, and the shape of one weighting of it.
        self._places: dict[str, tuple[slice, tuple[int, ...]]] = {}
        stop = 0
        shapes: dict[str, tuple[int, ...]] = {
            **dict.fromkeys(self.factor_sums, (outputs, factors)),
            **dict.fromkeys(self.pair_sums, (outputs, factors * (factors - 1) // 2)),
            **dict.fromkeys(self.output_sums, (outputs,)),
        }
        for name, shape in shapes.items():
            start, stop = stop, stop + prod(shape)
            self._places[name] = slice(start, stop), shape
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
        weighting = weights(self.sampling, self.seed, rows)
        for name, terms in self._terms(rows, usable).items():
            columns, flat = self._places[name][0], terms.reshape(*terms.shape[:2], -1)
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

    def statistics(self) -> dict[str, Statistic]:
        """Return each index in every weighting of the rows."""
        return {
            name: Statistic(
                weighted=np.concatenate([values[:1], values[FIRST:]]),
                n=counts[0],
                without=values[1:FIRST],
                present=counts[1:FIRST] < counts[0],
                power=power,
            )
            for name, (values, counts, power) in self._indices(self._weighted()).items()
        }

    def indices(self, level: float = 0.9) -> dict[str, Estimate]:
        """Return each of `statistics` with its interval at `level`."""
        found: dict[str, Estimate] = {}
        for name, (values, counts, power) in self._indices(self._weighted(FIRST)).items():
            without, present = values[1:], counts[1:] < counts[0]
            found[name] = estimate(values[0], without, present, level, power)
        return found

    @property
    @abstractmethod
    def effects(self) -> NDArray[np.int64]:
        """From how many rows each index was computed, shape (outputs, factors)."""

    def moments(self) -> Moments:
        """Return mean and spread of the outputs over the factors' distributions."""
        sample = self._weighted(1)
        with np.errstate(invalid="ignore"):
            sd = np.sqrt(sample.variance("value", ddof=1)[0])
        return Moments(mean=sample.mean("value")[0], sd=sd, n=sample.count("value")[0])

    def weighted_mean(self, output: int) -> NDArray[np.float64]:
        """Return an output's mean in the sample and its replicates, shape (1 + replicates,)."""
        mean = self._weighted().mean("value")[:, output]
        return np.concatenate([mean[:1], mean[FIRST:]])

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

    @abstractmethod
    def _indices(self, sums: Weighted) -> dict[str, Index]:
        """Return each index, by name, in the weightings of `sums`."""

    def _identity(self) -> tuple[object, ...]:
        shape = (self.factors, self.outputs, self.indicators)
        return (self.method, self.sampling, self.seed, *shape)

    def _weighted(self, stop: int = WEIGHTINGS) -> Weighted:
        return Weighted(self._sums, self._counts, self._places, stop)
