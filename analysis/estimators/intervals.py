"""Confidence intervals from what an index would be without each of eight blocks of rows.

The jackknife (Tukey 1958; for groups, Busing, Meijer and van der Leeden 1999) turns the spread of
those eight numbers into a standard error, whatever the index; and where blocks are independent, as
those of `sobol_blocks` are, it counts what a Sobol design gains, which resampling of rows cannot.
Student's t with seven degrees of freedom makes up for eight blocks being few.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainccinv, gammaincinv, ndtr, stdtrit

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A statistic of every column and its confidence interval; nan where it is undefined."""

    value: Array
    low: Array
    high: Array


def check_level(level: float) -> None:
    """Raise ValueError unless the level of a two-sided interval is between 0 and 1."""
    if not 0.0 < level < 1.0:
        raise ValueError(f"level of an interval must be between 0 and 1, not {level:g}")


def estimate(
    value: Array,
    without: Array,
    present: NDArray[np.bool_],
    level: float,
    power: int | None,
    stretch: Array | None = None,
) -> Estimate:
    """Return an index with the interval that suits it: Tukey 1958, or Satterthwaite 1946.

    Args:
        value, without, present, level: as `student`.
        power, stretch: as `satterthwaite`; power is None for an index that may have either sign.

    Raises:
        ValueError: as `student`.
    """
    if power is None:
        return student(value, without, present, level)
    return satterthwaite(value, without, present, level, power, stretch)


def student(value: Array, without: Array, present: NDArray[np.bool_], level: float) -> Estimate:
    """Return an index that may have either sign, with Student's interval (Tukey 1958).

    Args:
        value: of the index, shape (...).
        without: the index without each block, shape (blocks, ...).
        present: whether a block has a row, shape (blocks, ...).
        level: of the two-sided interval, between 0 and 1.

    Raises:
        ValueError: the level is not between 0 and 1.
    """
    half = _quantile(present, level) * _error(without, present)
    return Estimate(value=value, low=value - half, high=value + half)


def satterthwaite(
    value: Array,
    without: Array,
    present: NDArray[np.bool_],
    level: float,
    power: int = 1,
    stretch: Array | None = None,
) -> Estimate:
    """Return an index that is a mean of squares or magnitudes, with a skewed interval.

    Such a mean is taken for chi-square with as many degrees of freedom as its coefficient of
    variation says (Satterthwaite 1946, An approximate distribution of estimates of variance
    components), so the interval is that of a variance: never below 0, and longer above than below.
    The coefficient of variation is that of the reciprocal, which heavy tails enlarge: a sample that
    missed the rare large squares is too small and too even at once. It is 1 at most, which is what
    the jackknife finds if one block holds all there is.

    Args:
        value, without, present, level: as `student`; nothing negative.
        power: 2 for a root mean square, whose square is taken instead.
        stretch: by what the coefficient of variation is multiplied (`analysis.estimators.tails`).

    Raises:
        ValueError: as `student`.
    """
    mean, others = value**power, without**power
    with np.errstate(divide="ignore", invalid="ignore"):
        reciprocal = _error(mean / others, present)
        plain = _error(others, present) / mean
    nothing = np.any(present & (others == 0.0), axis=0)
    seen = np.where(nothing, plain, reciprocal)
    variation = np.minimum(seen if stretch is None else seen * stretch, 1.0)
    # Of an index that is 0 with and without each block, which is what an idle factor has.
    variation = np.where((mean == 0.0) & nothing, _error(others, present), variation)
    tail = ndtr(-_quantile(present, level))
    half_freedom = np.maximum(variation, 1e-9) ** -2.0
    low = mean * half_freedom / gammainccinv(half_freedom, tail)
    high = mean * half_freedom / gammaincinv(half_freedom, tail)
    moves = variation > 1e-9
    still = np.where(np.isnan(variation), np.nan, mean)
    ends = (np.where(moves, end, still) ** (1.0 / power) for end in (low, high))
    return Estimate(value=value, low=next(ends), high=next(ends))


def _error(without: Array, present: NDArray[np.bool_]) -> Array:
    """Return the jackknife's standard error; nan unless two blocks or more have a number."""
    blocks = present.sum(axis=0)
    count = np.maximum(blocks, 1)
    mean = np.where(present, without, 0.0).sum(axis=0) / count
    squares = np.where(present, (without - mean) ** 2, 0.0).sum(axis=0)
    error: Array = np.where(blocks > 1, np.sqrt((count - 1) / count * squares), np.nan)
    return error


def _quantile(present: NDArray[np.bool_], level: float) -> Array:
    """Return Student's quantile of the two-sided level for the blocks that are present."""
    check_level(level)
    freedom = np.maximum(present.sum(axis=0) - 1, 1).astype(np.float64)
    quantile: Array = -stdtrit(freedom, (1.0 - level) / 2.0)
    return quantile
