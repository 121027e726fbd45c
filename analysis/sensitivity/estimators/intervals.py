"""Confidence intervals from what an index would be without each of eight blocks of rows.

The jackknife (Tukey 1958; for groups, Busing, Meijer and van der Leeden 1999) turns the spread of
those eight numbers into a standard error, whatever the index; and where blocks are independent, as
those of `owen_blocks` are, it counts what a Sobol design gains, which resampling of rows cannot.
Student's t with seven degrees of freedom makes up for eight blocks being few. How often intervals
hold the truth, `benchmarks.sensitivity.coverage` prints; they were chosen on seeds that it does not
use.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainccinv, gammaincinv, ndtr, stdtrit

Array = NDArray[np.float64]

#: Degrees of freedom that a heavy tail leaves of Student's t at least: with two it has no variance.
#: A mean of squares has no interval from fewer: with one it would reach to a milliard of them.
LEAST_FREEDOM = 3.0


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
    *,
    power: int | None,
    stretch: Array | None = None,
    whole: Array | None = None,
) -> Estimate:
    """Return an index with the interval that suits it: Tukey 1958, Fieller 1954, or Satterthwaite.

    Args:
        value, without, present, level: as `student`.
        power, stretch: as `satterthwaite`; power is None for an index that may have either sign.
        whole: as `fieller`, for an index of either sign that is a share of something estimated.

    Raises:
        ValueError: as `student`.
    """
    if power is not None:
        return satterthwaite(value, without, present, level, power, stretch)
    if whole is not None:
        return fieller(value, without, present, level, whole)
    return student(value, without, present, level)


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
    half = students_quantile(present, level) * jackknife_error(without, present)
    return Estimate(value=value, low=value - half, high=value + half)


def fieller(
    value: Array, without: Array, present: NDArray[np.bool_], level: float, whole: Array
) -> Estimate:
    """Return a share of either sign, with Fieller's interval of the ratio of two estimates.

    The share may be s if what is left of the part without s times the whole differs from 0 by no
    more than Student's quantile of standard errors (Fieller 1954, Some problems in interval
    estimation), which holds the truth as often as it should if the blocks are normal, however much
    the whole errs. It is moved by what the blocks' skewness tells of the error (Johnson 1978,
    Modified t tests and confidence intervals for asymmetrical populations).

    Args:
        value, without, present, level: as `student`.
        whole: of what it is a share, and that without each block, (1 + blocks, ...) or a shape that
            broadcasts to it.

    Raises:
        ValueError: as `student`.
    """
    count = np.maximum(present.sum(axis=0), 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.broadcast_to(whole[1:] / whole[0], without.shape)
        left = _deviations((without - value) * relative, present)
        of_whole = _deviations(relative, present)
        squares = (left**2).sum(axis=0)
        skewed = np.where(squares > 0.0, (left**3).sum(axis=0) / squares, 0.0)
        # The third moment without bias (Fisher 1930).
        shift = -(count - 1) / np.maximum(count - 2, 1) * skewed / 6.0
        scale = students_quantile(present, level) ** 2 * (count - 1) / count
        # Fieller's interval has no end where the whole may be 0. That the whole errs may halve this
        # and no more, so that an interval has ends; it would do so of a few rows only.
        less = np.maximum(1.0 - scale * (of_whole**2).sum(axis=0), 0.5)
        middle = shift - scale * (left * of_whole).sum(axis=0)
        half = np.sqrt(np.maximum(middle**2 - less * (shift**2 - scale * squares), 0.0))
    known = ~np.isnan(jackknife_error(without, present))
    low, high = (
        np.where(known, value + (middle + sign * half) / less, np.nan) for sign in (-1.0, 1.0)
    )
    return Estimate(value=value, low=low, high=high)


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

    A sample that missed rare large squares is too small and too even at once. If `stretch` tells by
    how much, the coefficient of variation is that of the logarithm (Miller 1968, Jackknifing
    variances) times `stretch`; and since it rests on as many fewer rows as its square is larger,
    Student's quantile has as many fewer degrees of freedom. If not, it is that of the reciprocal,
    which heavy tails enlarge. It is 1 at most, which is what the jackknife finds if one block holds
    all there is.

    Args:
        value, without, present, level: as `student`; nothing negative.
        power: 2 for a root mean square, whose square is taken instead.
        stretch: by what the coefficient of variation is multiplied
            (`analysis.sensitivity.estimators.tails`).

    Raises:
        ValueError: as `student`.
    """
    mean, others = value**power, without**power
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = mean / others if stretch is None else np.log(others / mean)
        seen = jackknife_error(apart, present)
        plain = jackknife_error(others, present) / mean
    nothing = np.any(present & (others == 0.0), axis=0)
    stretched = np.ones_like(mean) if stretch is None else stretch
    variation = np.minimum(np.where(nothing, plain, seen) * stretched, 1.0)
    # Of an index that is 0 with and without each block, which is what an idle factor has.
    variation = np.where((mean == 0.0) & nothing, jackknife_error(others, present), variation)
    tail = ndtr(-students_quantile(present, level, stretched**2))
    half_freedom = np.maximum(variation, 1e-9) ** -2.0
    # From two blocks there is no end above, and none is told.
    with np.errstate(divide="ignore", invalid="ignore"):
        low = mean * half_freedom / gammainccinv(half_freedom, tail)
        high = mean * half_freedom / gammaincinv(half_freedom, tail)
    moves = variation > 1e-9
    told = ~np.isnan(variation) & (present.sum(axis=0) > LEAST_FREEDOM)
    low, high = (np.where(told, end, np.nan) for end in (low, high))
    still = np.where(told, mean, np.nan)
    ends = (np.where(moves, end, still) ** (1.0 / power) for end in (low, high))
    return Estimate(value=value, low=next(ends), high=next(ends))


def without_bias(found: Estimate, scale: Array | float) -> Estimate:
    """Return an interval around an unbiased value, as far as the value itself (Searle et al. 1992).

    (Variance components: a variance is what is found about the sample's mean and the
    square of that mean's own error. Balanced points have next to none, and n - 1 is too few.)

    Args:
        found: the value, which is biased, with its interval.
        scale: the unbiased value over the value, of a shape that broadcasts to it.
    """
    return Estimate(
        value=found.value,
        low=np.minimum(found.low * scale, found.value),
        high=np.maximum(found.high * scale, found.value),
    )


def _deviations(without: Array, present: NDArray[np.bool_]) -> Array:
    """Return how far each block's number is from their mean, 0 of a block that is not present."""
    mean = np.where(present, without, 0.0).sum(axis=0) / np.maximum(present.sum(axis=0), 1)
    deviations: Array = np.where(present, without - mean, 0.0)
    return deviations


def jackknife_error(without: Array, present: NDArray[np.bool_]) -> Array:
    """Return the standard error of Tukey 1958; nan unless two blocks or more have a number."""
    blocks = present.sum(axis=0)
    count = np.maximum(blocks, 1)
    with np.errstate(over="ignore"):
        squares = (_deviations(without, present) ** 2).sum(axis=0)
    error: Array = np.where(blocks > 1, np.sqrt((count - 1) / count * squares), np.nan)
    return error


def students_quantile(
    present: NDArray[np.bool_], level: float, fewer: Array | float = 1.0
) -> Array:
    """Return Student's quantile (Student 1908) of the two-sided level for the blocks present.

    Of `fewer` times less degrees of freedom, but not of fewer than `LEAST_FREEDOM` for that.
    """
    check_level(level)
    freedom = np.maximum(present.sum(axis=0) - 1, 1).astype(np.float64)
    freedom = np.maximum(freedom / fewer, np.minimum(freedom, LEAST_FREEDOM))
    quantile: Array = -stdtrit(freedom, (1.0 - level) / 2.0)
    return quantile
