"""Means and variances of exact sums, in every way of weighting the rows.

The weightings are, in this order: every row once, which is the sample itself; all rows but those
of one block, for each block (`analysis.designs.blocks`), which is the jackknife of Tukey 1958; and
each replicate of the Poisson bootstrap (Hanley and MacGibbon 2006).
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.designs import BLOCKS, blocks_of
from analysis.estimators.bootstrap import REPLICATES, replicate_weights
from analysis.estimators.exact_sum import ExactSums, Integers, divide

#: The sample and what it is without each block; and how many weightings there are in all.
FIRST = 1 + BLOCKS
WEIGHTINGS = FIRST + REPLICATES

#: Sums of this ending add up the exact squares of their terms.
SQUARED = "_squared"


def weights(sampling: str, seed: int, rows: Sequence[int]) -> NDArray[np.float64]:
    """Return how often each row counts in what is summed, shape (WEIGHTINGS, rows).

    In the place of all rows but a block's the block itself is summed: fewer terms, as good.
    """
    once = np.ones((1, len(rows)))
    block = np.arange(BLOCKS)[:, None] == blocks_of(sampling, seed, rows)
    return np.concatenate([once, block, replicate_weights(seed, rows)])


class Weighted:
    """What named sums say in some of the weightings.

    Args:
        sums, counts: sums in all weightings, and how many terms they have.
        places: by name, the columns of a sum and the shape of one weighting of it.
        stop: how many of the weightings to take, the first ones.
    """

    def __init__(
        self,
        sums: ExactSums,
        counts: NDArray[np.int64],
        places: Mapping[str, tuple[slice, tuple[int, ...]]],
        stop: int,
    ) -> None:
        self._sums, self._counts, self._places, self._stop = sums, counts[:stop], places, stop
        self._totals: dict[str, Integers] = {}

    def count(self, name: str) -> NDArray[np.int64]:
        """Return how many terms a sum has, shape (weightings, ...)."""
        columns, shape = self._places[name]
        counts = self._counts[:, columns].copy()
        counts[1:FIRST] = counts[0] - counts[1:FIRST]
        return counts.reshape(-1, *shape)

    def mean(self, name: str) -> NDArray[np.float64]:
        """Return the mean of a sum, rounded once; nan of nothing. Shape (weightings, ...)."""
        total, shift = self._total(name)
        return divide(total, self.count(name).astype(object), shift)

    def variance(self, name: str, *, ddof: int) -> NDArray[np.float64]:
        """Return the variance, rounded once, so 0 exactly if nothing varies; as `mean`."""
        total, shift = self._total(name)
        squares, _ = self._total(name + SQUARED)
        n = self.count(name).astype(object)
        numerator = n * (squares << shift) - total * total
        return divide(numerator, np.where(n > ddof, n * (n - ddof), 0), 2 * shift)

    def _total(self, name: str) -> tuple[Integers, int]:
        columns, shape = self._places[name]
        if name not in self._totals:
            total = self._sums.integers(columns, self._stop)
            total[1:FIRST] = total[0] - total[1:FIRST]
            self._totals[name] = total.reshape(-1, *shape)
        return self._totals[name], self._sums.shift
