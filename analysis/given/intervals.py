"""Intervals of indices that somebody else's program computes from any sample.

Either by halves: a sample is cut in two at random, again and again, and what an index of one half
differs from that of the other tells its error (Politis, Romano and Wolf 1999, Subsampling, chapter
2; cut in halves, McCarthy 1969, Pseudo-replication). No row stands in a half twice, which indices
made of pairs of rows or of ranks would take for agreement. Or, for distances of distributions,
which move less smoothly, by the bootstrap (Efron 1979).
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

Array = NDArray[np.float64]
#: An index of every factor, shape (factors,), from x (rows, factors) and y (rows,).
Index = Callable[[Array, Array], Array]

#: Cuts in two, and samples drawn with replacement: a standard error from so few is 18 % off.
CUTS = 16
RESAMPLES = 16


def by_halves(index: Index, x: Array, y: Array, level: float, rng: np.random.Generator) -> Array:
    """Return half the width of an interval of every factor (Politis et al. 1999).

    Half the difference of two halves has the variance of the index of the whole, whatever bias
    both halves have.
    """
    rows, squares = len(y) // 2, np.zeros(x.shape[1])
    for _ in range(CUTS):
        order = rng.permutation(len(y))
        one, other = order[:rows], order[rows : 2 * rows]
        squares += (0.5 * (index(x[one], y[one]) - index(x[other], y[other]))) ** 2
    return _student(level, CUTS) * np.sqrt(squares / CUTS)


def by_bootstrap(index: Index, x: Array, y: Array, level: float, rng: np.random.Generator) -> Array:
    """Return half the width of an interval of every factor (Efron 1979)."""
    drawn = (rng.integers(0, len(y), len(y)) for _ in range(RESAMPLES))
    replicates = np.stack([index(x[rows], y[rows]) for rows in drawn])
    spread: Array = replicates.std(axis=0, ddof=1)
    return _student(level, RESAMPLES - 1) * spread


def chance(index: Index, x: Array, y: Array, times: int, rng: np.random.Generator) -> Array:
    """Return what a factor that has nothing to do with the output gets from as many rows.

    The mean over permutations of the output (Khorashadi Zadeh et al. 2017, section 2.3).
    """
    mean: Array = np.mean([index(x, rng.permutation(y)) for _ in range(times)], axis=0)
    return mean


def _student(level: float, freedom: int) -> float:
    return float(-stdtrit(freedom, (1.0 - level) / 2.0))
