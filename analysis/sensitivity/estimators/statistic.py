"""An index in every weighting of the rows, and the interval that they tell.

Why rows are weighted is docs/decisions/0004-sums-do-not-depend-on-order.md.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from analysis.sensitivity.estimators.intervals import Estimate, estimate, without_bias
from analysis.sensitivity.estimators.shares import (
    LOW,
    allowing_for_tails,
    kept_apart,
    lacking_a_tail,
    share_of_squares,
)
from analysis.sensitivity.estimators.tails import Tail
from analysis.sensitivity.estimators.weightings import FIRST


@dataclass(frozen=True, kw_only=True)
class Index:
    """What a method makes of its sums."""

    #: In every weighting of `analysis.sensitivity.estimators.weightings`, shape (weightings,
    #: outputs, ...).
    weighted: NDArray[np.float64]
    #: From how many rows, of the same shape.
    count: NDArray[np.int64]
    #: `Statistic.power`, `Statistic.tail`, and `Statistic.whole` in every weighting.
    power: int | None = None
    tail: Tail | None = None
    whole: NDArray[np.float64] | None = None
    #: `Statistic.apart`, `Statistic.scale`, `Statistic.longer`.
    apart: NDArray[np.float64] | None = None
    scale: NDArray[np.float64] | None = None
    longer: NDArray[np.float64] | None = None


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
    #: How its mean of squares is made up, where that is known; shape (outputs, factors).
    tail: Tail | None = None
    #: What it is a share of, in the sample and without each block; of a shape that broadcasts to
    #: (1 + BLOCKS, ...). And the same in the sample and its replicates, as `weighted`.
    whole: NDArray[np.float64] | None = None
    weighted_whole: NDArray[np.float64] | None = None
    #: What share of the independent rows' error its ends keep; broadcasts to (outputs, ...).
    apart: NDArray[np.float64] | None = None
    #: By what it must be multiplied to be unbiased, which its ends are.
    scale: NDArray[np.float64] | None = None
    #: How much longer a side is where the whole, or the mean of squares that has none, may lack its
    #: tail; broadcasts to (outputs, ...).
    longer: NDArray[np.float64] | None = None

    @classmethod
    def of(cls, index: Index) -> Self:
        """Return the statistic that an index in all its weightings is."""
        return cls(
            weighted=_weighted(index.weighted),
            n=index.count[0],
            without=index.weighted[1:FIRST],
            present=index.count[1:FIRST] < index.count[0],
            power=index.power,
            tail=index.tail,
            whole=None if index.whole is None else index.whole[:FIRST],
            weighted_whole=None if index.whole is None else _weighted(index.whole),
            apart=index.apart,
            scale=index.scale,
            longer=index.longer,
        )

    def estimate(self, level: float) -> Estimate:
        """Return it with its interval at `level`; ValueError if that is not between 0 and 1."""
        found = without_bias(self._estimate(level), 1.0 if self.scale is None else self.scale)
        if self.apart is None:
            return found
        found = kept_apart(found, self.weighted, self.apart, level)
        # A mean of squares is never below 0.
        return found if self.power is None else replace(found, low=np.maximum(found.low, 0.0))

    def _estimate(self, level: float) -> Estimate:
        if self.power == 1 and self.whole is not None:
            return share_of_squares(
                *(self.weighted[0], self.without, self.present, level),
                whole=self.whole,
                stretch=1.0 if self.tail is None else self.tail.stretch,
                times=LOW if self.longer is None else self.longer,
            )
        found = estimate(
            self.weighted[0],
            self.without,
            self.present,
            level,
            power=self.power,
            stretch=None if self.tail is None else self.tail.stretch,
            whole=self.whole,
        )
        if self.longer is None:
            return found
        blocks = (self.without, self.present, level)
        if self.power is not None:
            return lacking_a_tail(found, *blocks, power=self.power, times=self.longer)
        if self.whole is not None:
            return allowing_for_tails(found, *blocks, whole=self.whole, times=self.longer)
        return found


def interaction(first: Statistic, total: Statistic) -> Statistic:
    """Return by how much total-order indices exceed first-order ones (Homma and Saltelli 1996).

    The share of the variance that a factor has in company only: the sum of all its interactions.
    """
    return replace(
        first,
        weighted=total.weighted - first.weighted,
        without=total.without - first.without,
        apart=None,
        longer=None,
    )


def _weighted(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return what all weightings say in the sample and its replicates only."""
    return np.concatenate([values[:1], values[FIRST:]])
