"""Intervals of indices of any sample, however the index is made.

Either by halves: a sample is cut in two at random, again and again, and what an index of one half
differs from that of the other tells its error (Politis, Romano and Wolf 1999, Subsampling, chapter
2; cut in halves, McCarthy 1969, Pseudo-replication). No row stands in a half twice, which indices
made of pairs of rows or of ranks would take for agreement. Or, for distances of distributions,
which move less smoothly, by the bootstrap (Efron 1979).

Of an index to which chance adds squares, both see too much: in half the rows chance is twice as
large, and a row that is drawn twice agrees with itself. Halves count the variance of that part
twice, as the jackknife does (Efron and Stein 1981, The jackknife estimate of variance), and more
often if more is taken off for the bias of half the rows than of all; the bootstrap counts it two or
three times. Permuting the output says how large the part is, in all rows and in half of them.

How much of a weak factor's index is chance depends on how large the index is. An index that came
out small seems to be all chance, and its interval is too short, where that is told at its value;
so it is told at the ends, each of which is what the index would be (Wilson 1927).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

Array = NDArray[np.float64]
#: An index of every factor, shape (factors,), from x (rows, factors) and y (rows,).
Index = Callable[[Array, Array], Array]

#: Cuts in two, samples drawn with replacement, and permutations of the output: a standard error
#: from so few is 18 % off.
CUTS = RESAMPLES = PERMUTATIONS = 16
#: Of the width in which an end lies, until it is known to nine digits.
_HALVINGS = 30


@dataclass(frozen=True, kw_only=True)
class Spread:
    """How an index of every factor varies from sample to sample."""

    #: Shape (factors,).
    variance: Array
    #: Degrees of freedom of that variance: one for each cut or resample, or by factor.
    freedom: Array | float


@dataclass(frozen=True, kw_only=True)
class Chance:
    """What a factor that has nothing to do with the output gets from as many rows, (factors,)."""

    mean: Array
    variance: Array


def by_halves(index: Index, x: Array, y: Array, rng: np.random.Generator) -> Spread:
    """Return the spread of an index of every factor (Politis et al. 1999).

    Half the difference of two halves has the variance of the index of the whole, whatever bias
    both halves have.
    """
    rows, squares = len(y) // 2, np.zeros(x.shape[1])
    for _ in range(CUTS):
        order = rng.permutation(len(y))
        one, other = order[:rows], order[rows : 2 * rows]
        squares += (0.5 * (index(x[one], y[one]) - index(x[other], y[other]))) ** 2
    return Spread(variance=squares / CUTS, freedom=CUTS)


def by_bootstrap(index: Index, x: Array, y: Array, rng: np.random.Generator) -> Spread:
    """Return the spread of an index of every factor (Efron 1979)."""
    drawn = (rng.integers(0, len(y), len(y)) for _ in range(RESAMPLES))
    replicates = np.stack([index(x[rows], y[rows]) for rows in drawn])
    return Spread(variance=replicates.var(axis=0, ddof=1), freedom=RESAMPLES)


def by_chance(
    index: Callable[[Array], Array],
    y: Array,
    rng: np.random.Generator,
    permutations: int = PERMUTATIONS,
) -> Chance:
    """Return mean and variance over permutations (Khorashadi Zadeh et al. 2017, section 2.3).

    Args:
        index: of any output of the factors there are.
    """
    found = np.stack([index(rng.permutation(y)) for _ in range(permutations)])
    return Chance(mean=found.mean(axis=0), variance=found.var(axis=0, ddof=1))


def half_width(
    spread: Spread,
    by_chance: Array,
    level: float,
    seen: float = 2.0,
    least: Array | float = 0.0,
) -> Array:
    """Return half the width of an interval (Efron and Stein 1981).

    Args:
        spread: of the index.
        by_chance: how much of an index's variance is of what chance adds.
        level: between 0 and 1.
        seen: how many times that is in the variance, which is taken off but for once, as far as all
            of the variance may be such.
        least: the variance that it has at least. Two halves of which an index is the square of one
            number agree where that number is 0 in all of them together.
    """
    variance = spread.variance
    left = np.maximum(variance - (seen - 1.0) * by_chance, np.maximum(variance / seen, least))
    half: Array = -stdtrit(spread.freedom, (1.0 - level) / 2.0) * np.sqrt(left)
    return half


def by_score(half: Callable[[Array], Array], value: Array, widest: Array) -> tuple[Array, Array]:
    """Return the ends from which a value is half the width that they have away (Wilson 1927).

    Args:
        half: half the width of an interval around what the index would be.
        value: of the index, shape (factors,).
        widest: what `half` is at most, and stands for it where that is nan.
    """
    ends = []
    for sign in (-1.0, 1.0):
        near, far = np.zeros_like(value), widest
        for _ in range(_HALVINGS):
            middle = 0.5 * (near + far)
            within = ~(middle > half(value + sign * middle))
            near, far = np.where(within, middle, near), np.where(within, far, middle)
        ends.append(value + sign * far)
    return ends[0], ends[1]
