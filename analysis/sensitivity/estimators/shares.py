"""Intervals of total-order indices, which are a mean of squares over a variance that errs too.

The error of a share has two parts. What the part and the whole err in common cancels, more or
less: beta, the slope of log part on log whole over the blocks left out, says how much. (In the
bootstrap's replicates, which take rows as independent, both err together more than in balanced
blocks: of a leading additive factor beside an interaction the part hardly errs, and the whole
does.) What is left, log part - beta log whole, has Satterthwaite's interval, with what the part's
own tail hides (`analysis.sensitivity.estimators.tails`). The rest, (1 - beta) log whole, is the
error of a variance, which under a heavy tail is too small far more often than it is too large: of
squares without a variance of their own, Student's t of eight blocks of log variance has a 5 %
quantile of -3.5 instead of -1.9, whatever the number of rows. So on that side it is taken up to
`LOW` times as long (`longer`: not at all of an output whose tail is no heavier than a normal
one's). (Over the blocks the parts do not go together, so their lengths add as the sides of a right
angle: Zou and Donner 2008, Construction of confidence limits about effect measures.)

A variance that lacks its tail makes the shares of other factors too large, whose beta is below 1,
and that of the tail's own factor too small, whose beta is above 1: the longer side is the lower of
the former and the upper of the latter. For first-order indices, which are differences of means and
no means of squares, Fieller's interval is made longer on that side by as much
(`allowing_for_tails`).

Of a rare event balanced blocks have equal counts, and look free of error. So where the output has a
heavy tail neither end of a share is nearer than `tails.FLOOR` of what rows drawn independently
would err (the Poisson bootstrap). `LOW` and `FLOOR` were set on a Pareto tail of 0.3 and on a rare
event, on seeds that `benchmarks.sensitivity` does not report.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from analysis.sensitivity.estimators.intervals import (
    Estimate,
    jackknife_error,
    satterthwaite,
    students_quantile,
)

Array = NDArray[np.float64]

#: How much longer than Student's the lower side is for the error of the whole, at most.
LOW = 3.5 / 1.895

#: Kurtosis of a normal output.
_NORMAL = 3.0


def longer(kurtosis: Array) -> Array:
    """Return how much longer a side is for a variance that lacks its tail, from 1 to `LOW`.

    In proportion to the excess kurtosis of the output (Kendall and Stuart 1977, chapter 3) up to 1;
    `LOW` where it is unknown.
    """
    excess = np.where(np.isnan(kurtosis), 1.0, kurtosis - _NORMAL)
    return 1.0 + (LOW - 1.0) * np.clip(excess, 0.0, 1.0)


def share_of_squares(
    value: Array,
    without: Array,
    present: NDArray[np.bool_],
    level: float,
    *,
    whole: Array,
    stretch: Array | float,
    times: Array | float = LOW,
) -> Estimate:
    """Return a share that is a mean of squares over a variance, with its interval (Zou 2008).

    Args:
        value, without, present, level: as `analysis.sensitivity.estimators.intervals.student`.
        whole: the variance, in the sample and without each block; broadcasts to (1 + blocks, ...).
        stretch: as `analysis.sensitivity.estimators.intervals.satterthwaite`.
        times: how much longer the side is on which the share is if the whole lacks its tail
            (`longer`): the lower one, of a part that grows more than the whole the upper one.

    Raises:
        ValueError: the level is not between 0 and 1.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.broadcast_to(whole[1:] / whole[0], without.shape)
        of_whole = np.log(relative)
        steep = _slope(np.log(without) + of_whole, of_whole, np.maximum(1.0 / value, 1.0))
        # part / whole^beta is the share times whole^(1 - beta), relative to the sample's own.
        left = relative ** np.maximum(1.0 - steep, 0.0)
        stretched = np.broadcast_to(np.asarray(stretch, dtype=np.float64), value.shape)
        own = satterthwaite(value, without * left, present, level, 1, stretched)
        error = jackknife_error(of_whole, present)
        common = (1.0 - steep) * error * students_quantile(present, level)
        down = np.hypot(np.log(value / own.low), times * np.maximum(common, 0.0))
        above = np.where(common < 0.0, times, 1.0) * common * np.minimum(1.0 / error, 1.0)
        up = np.hypot(np.log(own.high / value), above)
        moves = (value > 0.0) & ~np.isnan(common) & (whole[0] > 0.0)
        low = np.where(moves, value * np.exp(-down), own.low)
        high = np.where(moves, value * np.exp(up), own.high)
    return Estimate(value=value, low=low, high=high)


def allowing_for_tails(
    found: Estimate,
    without: Array,
    present: NDArray[np.bool_],
    level: float,
    *,
    whole: Array,
    times: Array,
) -> Estimate:
    """Return a share of either sign whose interval allows for a whole that lacks its tail.

    Of a part that grows by b where the whole grows by 1 (its slope over the blocks left out), the
    share s grows by (b - s) where the whole does by as much of itself. On that side the error of
    the whole, of 1 at most, is taken `times` as long; it adds to the part's own as the sides of a
    right angle (Zou and Donner 2008).

    Args:
        found: the share with an interval that has equal sides for this.
        without, present, level: as `analysis.sensitivity.estimators.intervals.student`.
        whole: as `share_of_squares`.
        times: broadcasts to (...), 1 or more.

    Raises:
        ValueError: the level is not between 0 and 1.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.broadcast_to(whole[1:] / whole[0], without.shape)
        slope = _slope(without * relative, relative, 1.0)
        quantile = students_quantile(present, level)
        own = quantile * jackknife_error((without - slope) * relative, present)
        error = np.minimum(jackknife_error(np.log(relative), present), 1.0)
        common = (slope - found.value) * quantile * error
        more = np.hypot(own, times * common) - np.hypot(own, common)
        more = np.where(np.isfinite(more), more, 0.0)
    return Estimate(
        value=found.value,
        low=found.low - np.where(common < 0.0, more, 0.0),
        high=found.high + np.where(common > 0.0, more, 0.0),
    )


def lacking_a_tail(
    found: Estimate,
    without: Array,
    present: NDArray[np.bool_],
    level: float,
    *,
    power: int,
    times: Array,
) -> Estimate:
    """Return a mean of squares, or its root, whose upper side allows for a tail that it lacks.

    As of a variance that is a whole, the error of its logarithm is taken `times` as long above
    (Zou and Donner 2008). It is 1 at most, as a variation in `satterthwaite`.

    Args:
        found: the mean, with an interval that has this error once.
        without, present, level: as `analysis.sensitivity.estimators.intervals.student`.
        power: 2 of a root mean square, 1 of a mean.
        times: broadcasts to (...), 1 or more.

    Raises:
        ValueError: the level is not between 0 and 1.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        own = np.log(found.high / found.value)
        error = jackknife_error(np.log(without / found.value), present)
        error = np.minimum(error, 1.0 / power)
        more = np.sqrt(times**2 - 1.0) * error * students_quantile(present, level)
        high = found.value * np.exp(np.hypot(own, more))
    return Estimate(
        value=found.value, low=found.low, high=np.where(np.isfinite(high), high, found.high)
    )


def kept_apart(found: Estimate, weighted: Array, apart: Array, level: float) -> Estimate:
    """Return an interval whose ends keep a share of what independent rows err (Hanley 2006).

    Args:
        found: the interval.
        weighted: the index in the sample and its replicates, shape (1 + replicates, ...); without
            any replicate an interval that keeps a share is unknown.
        apart: the share; broadcasts to (...).
        level: of the interval.
    """
    if len(weighted) == 1:
        low, high = (np.where(apart > 0.0, np.nan, end) for end in (found.low, found.high))
        return Estimate(value=found.value, low=low, high=high)
    known = ~np.isnan(weighted[1:])
    n = np.maximum(known.sum(axis=0), 1)
    kept = np.where(known, weighted[1:], 0.0)
    off = np.where(known, kept - kept.sum(axis=0) / n, 0.0)
    least = apart * ndtri(0.5 + level / 2.0) * np.sqrt((off * off).sum(axis=0) / n)
    return Estimate(
        value=found.value,
        low=np.minimum(found.low, found.value - least),
        high=np.maximum(found.high, found.value + least),
    )


def _slope(part: Array, whole: Array, most: Array | float) -> Array:
    """Return the slope of `part` on `whole` over the first axis, 0 to `most`; 0 of no slope."""
    there = np.isfinite(part) & np.isfinite(whole)
    n = np.maximum(there.sum(axis=0), 1)
    x, y = (np.where(there, one, 0.0) for one in (whole, part))
    x, y = (np.where(there, one - one.sum(axis=0) / n, 0.0) for one in (x, y))
    squares = (x * x).sum(axis=0)
    slope = np.where(squares > 0.0, (x * y).sum(axis=0) / squares, 0.0)
    return np.clip(slope, 0.0, most)
