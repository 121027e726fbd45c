"""What a sample of few rows does not show of the squares that it averages.

A total-order index is a mean of squared differences. If a few large squares make up that mean, a
sample often lacks them, and then its mean is too small and its spread looks small too. Lower
moments are seen much better, and say how heavy the tail is: for any distribution the logarithm of
the moment E|d|^p is convex in p (Lyapunov 1901), and it goes on bending. So the fourth moment is
taken to be no less than the second, first and half moments lead one to expect.

What is taken for granted of the bend is `BEND`: between p = 2 and p = 4 the slope of that curve
rises by at least this share of what it rose before. The share is 0.95 for the difference of two
uniform numbers, 1.1 for a normal one, 0.9 for products of many uniform numbers, 2 if d is
lognormal; a difference that is mostly 0 and else of one size has no bend at all, and nothing is
added to it. It was chosen on 1000 seeds of `benchmarks.sensitivity.coverage` that its figures do
not use.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BEND = 0.8

#: The share of the independent rows' error that intervals keep under a heavy tail
#: (`analysis.sensitivity.estimators.shares`).
FLOOR = 0.33

#: A larger difference has no fourth power, and tells nothing of the tail.
LARGEST_FOURTH = 1e75

#: The kurtosis from which an output counts as heavy-tailed. That of a normal one is 3, of a uniform
#: one 1.8, of an exponential one 9.
HEAVY_KURTOSIS = 7.0


@dataclass(frozen=True, kw_only=True)
class Tail:
    """How a mean of squares is made up; arrays of one shape, nan where nothing moves."""

    #: By what a standard error that was seen is to be multiplied, 1 or more.
    stretch: Array
    #: How many rows of equal squares would have this spread: the effective number of Kish 1965,
    #: with the fourth moment as above.
    rows: Array


def tail(*, half: Array, first: Array, second: Array, fourth: Array, n: NDArray[np.int64]) -> Tail:
    """Return the tail of squared differences d^2 from means of |d|^(1/2), |d|, d^2 and d^4.

    Lyapunov 1901 for the moments, Kish 1965 (Survey sampling, section 11.7) for the number.

    Args:
        half, first, second, fourth: the means, of one shape.
        n: of how many rows.
    """
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        of_half, of_first, of_second = np.log(half), np.log(first), np.log(second)
        before, after = 2.0 * (of_first - of_half), of_second - of_first
        slope = after + BEND * (after - before)
        seen = fourth / second**2
        expected = np.fmax(seen, np.exp(2.0 * slope - of_second))
        # A square that is the same in every row has no spread that could be too small.
        spread = np.where(seen - 1.0 > 1e-9, (expected - 1.0) / (seen - 1.0), 1.0)
        rows = np.where(second > 0.0, n / expected, np.nan)
    stretch = np.sqrt(np.where(np.isfinite(spread), spread, 1.0))
    return Tail(stretch=stretch, rows=np.where(np.isfinite(rows), rows, np.nan))


def heaviness(kurtosis: Array, heavy: float = HEAVY_KURTOSIS) -> Array:
    """Return how heavy a tail is, from 0 up to a kurtosis of `heavy` to 1 from twice that on.

    Kurtosis as in Kendall and Stuart 1977, chapter 3; 0 where it is unknown.
    """
    return np.clip(np.nan_to_num(kurtosis) / heavy - 1.0, 0.0, 1.0)


def lopsidedness(without: Array, present: NDArray[np.bool_]) -> Array:
    """Return how skewed the blocks of a mean of squares or magnitudes are, from 0 to 1.

    The skewness of what each block adds (Fisher 1930: without bias), up to 1. A tail too light for
    a kurtosis that tells it makes one block larger than the others, and Student's t of such blocks
    is skewed the other way (Johnson 1978, Modified t tests and confidence intervals for
    asymmetrical populations). (That it counts from 0 to 1 was chosen among ten ways to lengthen
    intervals, and checked on other seeds: `docs/notebook/sigma_of_moderate_tails.md`.)

    Args:
        without: the mean without each block, shape (blocks, ...).
        present: whether a block has a row, shape (blocks, ...).
    """
    count = present.sum(axis=0)
    blocks = np.maximum(count, 1)
    mean = np.where(present, without, 0.0).sum(axis=0) / blocks
    # Without a large block there is less.
    more = np.where(present, mean - without, 0.0)
    # Powers of what is far from 1 are no numbers.
    more = more / np.maximum(np.abs(more).max(axis=0, initial=0.0), np.finfo(np.float64).tiny)
    second, third = ((more**p).sum(axis=0) / blocks for p in (2, 3))
    with np.errstate(divide="ignore", invalid="ignore"):
        unbiased = np.sqrt(blocks * (blocks - 1.0)) / (blocks - 2.0)
        found = unbiased * third / second**1.5
    return np.where((count > 2) & (second > 0.0), np.clip(found, 0.0, 1.0), 0.0)


def raw_kurtosis(second: Array, fourth: Array) -> Array:
    """Return E d^4 / E(d^2)^2 (Kendall and Stuart 1977, chapter 3); nan where nothing moves.

    Infinite where a power is beyond the range of numbers: a tail as heavy as any.
    """
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        square = second**2
        ratio = np.where(np.isinf(square), np.inf, fourth / square)
    return np.where(np.isnan(ratio) | (second == 0.0), np.nan, ratio)


def of_draws(raw: Array) -> Array:
    """Return the kurtosis of what differences are of, from the `raw_kurtosis` of the latter.

    E (a - b)^4 = 2 m4 + 6 m2^2 for independent a and b of central moments m2 and m4 (Kendall and
    Stuart 1977, The advanced theory of statistics 1, chapter 3): no large mean to cancel.
    """
    return 2.0 * raw - 3.0


def of_leading(kurtosis: Array, moment: Array) -> Array:
    """Return the kurtosis of each output's leading factor, shape (outputs,).

    Args:
        kurtosis: of differences or effects (Kendall and Stuart 1977), shape (outputs, factors).
        moment: which of their moments is the largest of the leading factor's, of the same shape.
    """
    leading = np.argmax(np.nan_to_num(moment), axis=-1)
    found: Array = np.take_along_axis(kurtosis, leading[:, None], axis=-1)[:, 0]
    return found
