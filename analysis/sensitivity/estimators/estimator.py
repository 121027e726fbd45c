"""What the estimators of all methods share: sums over rows that survive any order of arrival.

Why they do is docs/decisions/0004-sums-do-not-depend-on-order.md.
"""

import io
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from analysis.designs import row_width
from analysis.sensitivity.estimators.failure_association import (
    ROW_SUMS,
    Association,
    association,
    row_terms,
)
from analysis.sensitivity.estimators.intervals import Estimate, check_level
from analysis.sensitivity.estimators.statistic import Index, Statistic
from analysis.sensitivity.estimators.weightings import (
    FIRST,
    SQUARED,
    WEIGHTINGS,
    NamedSums,
    Weighted,
    weights,
)
from analysis.sensitivity.records import LARGEST_OUTPUT

#: Indices of pairs of factors, in the order of `numpy.triu_indices(factors, 1)`; all others are of
#: single factors or of whole outputs.
OF_PAIRS = ("second_order",)

#: What rows add to the sums, by name: (points, rows, outputs, factors), (points, rows, outputs,
#: pairs) or (points, rows, outputs); nan marks what a sum leaves out.
Terms = Mapping[str, NDArray[np.float64]]


@dataclass(frozen=True, kw_only=True)
class Moments:
    """Mean, standard deviation (n - 1) and number of each output's values, shape (outputs,)."""

    mean: NDArray[np.float64]
    sd: NDArray[np.float64]
    n: NDArray[np.int64]


class Estimator(ABC):
    """Indices of several outputs from rows that arrive in any order.

    It does not notice a row that is added twice: whoever feeds it must.

    Args:
        sampling, seed: of the design, one of `analysis.designs.samplings`.
        factors, outputs: how many.
        indicators: how many of the outputs, the last ones, say something of every run, also of a
            failed one. They alone do not make a row count as used.
        weightings: how many of `analysis.sensitivity.estimators.weightings` it keeps, the first
            ones; None: all that the class does. With 1 indices have no intervals, and with `FIRST`
            none where these keep a share of what independent rows err (`Statistic.apart`).
    """

    method: ClassVar[str]
    #: From which `kurtosis` on few rows may make up what is estimated.
    heavy_kurtosis: ClassVar[float] = 6.0
    #: The sum of which a row must have a term to count as used.
    use: ClassVar[str]
    #: The sum whose terms are counted as the rows of an index.
    counted: ClassVar[str]
    #: Sums kept per output and factor, per output and pair of factors, and per output.
    factor_sums: ClassVar[tuple[str, ...]]
    pair_sums: ClassVar[tuple[str, ...]] = ()
    output_sums: ClassVar[tuple[str, ...]] = ("value", "value" + SQUARED)
    #: Sums kept of the sample itself only, in no other weighting: per output and factor, and per
    #: output.
    sample_sums: ClassVar[tuple[str, ...]] = ()
    sample_output_sums: ClassVar[tuple[str, ...]] = ()
    #: How many of the weightings it keeps, the first ones.
    weightings: int = WEIGHTINGS

    def __init__(
        self,
        *,
        sampling: str,
        seed: int,
        factors: int,
        outputs: int,
        indicators: int = 0,
        weightings: int | None = None,
    ) -> None:
        self.sampling = sampling
        self.seed = seed
        self.factors = factors
        self.outputs = outputs
        self.indicators = indicators
        self.weightings = weightings or self.weightings
        self.width = row_width(self.method, factors)
        #: Rows, and those of which at least one index could use a part.
        self.rows = 0
        self.rows_used = 0
        #: The least and the largest value of each output.
        self.least = np.full(outputs, np.inf)
        self.most = np.full(outputs, -np.inf)
        shapes: dict[str, tuple[int, ...]] = {
            **dict.fromkeys(self.factor_sums, (outputs, factors)),
            **dict.fromkeys(self.pair_sums, (outputs, factors * (factors - 1) // 2)),
            **dict.fromkeys(self.output_sums, (outputs,)),
        }
        #: In every weighting of the rows, and in the sample itself.
        self._whole = NamedSums(self.weightings, shapes)
        of_sample: dict[str, tuple[int, ...]] = {
            **dict.fromkeys(self.sample_sums, (outputs, factors)),
            **dict.fromkeys((*self.sample_output_sums, *ROW_SUMS), (outputs,)),
        }
        self._sample = NamedSums(1, of_sample)

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
        weighting = weights(self.sampling, self.seed, rows, self.weightings)
        self.rows += len(rows)
        self.least = np.fmin(self.least, np.fmin.reduce(usable, axis=(0, 1)))
        self.most = np.fmax(self.most, np.fmax.reduce(usable, axis=(0, 1)))
        alike = usable[:, self._alike()]
        terms = {**self._terms(rows, usable), **row_terms(alike)}
        for kept in (self._whole, self._sample):
            valid = kept.add(weighting, {n: one for n, one in terms.items() if n in kept.places})
            if self.use in valid:
                used = valid[self.use]
                of_output = used.reshape(*used.shape[:2], self.outputs, -1)
                measured = of_output[:, :, : self.outputs - self.indicators]
                every = measured.size > 0 and measured.all()
                self.rows_used += len(rows) if every else int(measured.any(axis=(0, 2, 3)).sum())

    def merge(self, other: Self) -> None:
        """Add what `other` has seen; ValueError if it belongs to another study."""
        if self._identity() != other._identity():
            raise ValueError("only estimators of one study can be merged")
        self._whole.merge(other._whole)
        self._sample.merge(other._sample)
        self.rows += other.rows
        self.rows_used += other.rows_used
        self.least = np.fmin(self.least, other.least)
        self.most = np.fmax(self.most, other.most)

    def statistics(self) -> dict[str, Statistic]:
        """Return each index in every weighting of the rows."""
        return self._statistics(self.weightings)

    def indices(self, level: float = 0.9) -> dict[str, Estimate]:
        """Return each of `statistics` with its interval at `level`."""
        return {name: found.estimate(level) for name, found in self.statistics().items()}

    def compared(self, level: float) -> dict[str, dict[str, Estimate]]:
        """Return indices by other estimators of the same runs: by its name and the index's.

        Raises:
            ValueError: the level is not between 0 and 1.
        """
        check_level(level)
        return {}

    @property
    def effects(self) -> NDArray[np.int64]:
        """From how many rows each index was computed, shape (outputs, factors)."""
        effects: NDArray[np.int64] = self._weighted(1).count(self.counted)[0]
        return effects

    def moments(self) -> Moments:
        """Return mean and spread of the outputs over the factors' distributions."""
        sample = self._weighted(1)
        with np.errstate(invalid="ignore"):
            sd = np.sqrt(sample.variance("value", ddof=1)[0])
        return Moments(mean=sample.mean("value")[0], sd=sd, n=sample.count("value")[0])

    def independent_runs(self) -> NDArray[np.int64]:
        """Return how many runs are independent draws of the factors, shape (outputs,)."""
        most: NDArray[np.int64] = self.effects.max(axis=-1, initial=0)
        return most

    def kurtosis(self) -> NDArray[np.float64]:
        """Return the kurtosis of what is estimated of each output; nan where it is unknown."""
        return np.full(self.outputs, np.nan)

    def other_kurtosis(self) -> NDArray[np.float64]:
        """Return a kurtosis in which a tail that is none by chance shows too, shape (outputs,)."""
        return self.kurtosis()

    def weighted_mean(self, output: int) -> NDArray[np.float64]:
        """Return an output's mean in the sample and its replicates, shape (1 + replicates,)."""
        mean = self._weighted().mean("value")[:, output]
        return np.concatenate([mean[:1], mean[FIRST:]])

    def failing_with(self) -> Association:
        """Return how failing goes with each output (`analysis.sensitivity.estimators.rows`)."""
        return association(self._weighted_sample())

    def to_bytes(self) -> bytes:
        """Return all that was summed, as an NPZ file without pickles."""
        buffer = io.BytesIO()
        np.savez(
            buffer,
            rows=np.array([self.rows, self.rows_used], dtype=np.int64),
            extremes=np.stack([self.least, self.most]),
            **self._whole.arrays("whole"),
            **self._sample.arrays("sample"),
        )
        return buffer.getvalue()

    def load_bytes(self, data: bytes) -> None:
        """Replace what was summed by what `to_bytes` of an equal estimator returned.

        Raises:
            ValueError: the bytes are those of an estimator of other shape.
        """
        with np.load(io.BytesIO(data), allow_pickle=False) as saved:
            self._whole.load("whole", saved)
            self._sample.load("sample", saved)
            self.rows, self.rows_used = saved["rows"].tolist()
            self.least, self.most = saved["extremes"]

    def _alike(self) -> slice | list[int]:
        """Return the positions of a row that share all coordinates but one with another."""
        return slice(None)

    @abstractmethod
    def _terms(self, rows: Sequence[int], values: NDArray[np.float64]) -> Terms:
        """Return what `rows` with these (rows, width, outputs) values add to every sum."""

    @abstractmethod
    def _indices(self, sums: Weighted, sample: Weighted) -> dict[str, Index]:
        """Return each index, by name, in the weightings of `sums`; `sample` has `sample_sums`."""

    def _statistics(self, stop: int) -> dict[str, Statistic]:
        """Return `statistics` in the first `stop` weightings only, which takes less time."""
        found = self._indices(self._weighted(stop), self._weighted_sample())
        return {name: Statistic.of(index) for name, index in found.items()}

    def _identity(self) -> tuple[object, ...]:
        shape = (self.factors, self.outputs, self.indicators)
        return (self.method, self.sampling, self.seed, *shape)

    def _weighted(self, stop: int | None = None) -> Weighted:
        return self._whole.weighted(self.weightings if stop is None else stop)

    def _weighted_sample(self) -> Weighted:
        return self._sample.weighted(1)
