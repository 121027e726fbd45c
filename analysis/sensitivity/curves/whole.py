"""Generalised indices: what a factor does to a curve as a whole.

The share of the sum of the variances of all points (Lamboni, Monod and Makowski 2011, equation 13;
for a vector the same as the traces of Gamboa, Janon, Klein and Lagnoux 2014), hence the mean of the
indices of the points, weighted with their variances; and the mean of the indices of the scores of
all principal components, weighted with theirs. Of elementary effects it is the root mean square
over the points, averaged over the rows.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.sensitivity.curves.estimator import CurveEstimator
from analysis.sensitivity.estimators import Statistic, interaction
from analysis.sensitivity.estimators.morris import ROWS_ENOUGH
from analysis.sensitivity.estimators.tails import FLOOR, heaviness, tail
from analysis.sensitivity.estimators.weightings import FIRST

Array = NDArray[np.float64]


def generalised(curve: CurveEstimator, at_points: Mapping[str, Statistic]) -> dict[str, Statistic]:
    """Return the generalised indices (Lamboni et al. 2011), shape (factors,) or (pairs,).

    Args:
        curve: of the study.
        at_points: its `points.statistics()`.

    Returns:
        "mu_star" of morris; else "first_order", "total_order", "interaction" (by which the second
        exceeds the first), "second_order" if the method has it; and, of shape (1,),
        "sum_first_order" and "sum_total_order".
    """
    if curve.method == "morris":
        return {"mu_star": _effect(curve)}
    return _shares(curve, at_points)


def _effect(curve: CurveEstimator) -> Statistic:
    sums = curve.lengths()
    mean, count = sums.mean("size") / np.sqrt(curve.points.outputs), sums.count("size")
    return Statistic(
        weighted=np.concatenate([mean[:1], mean[FIRST:]]),
        n=count[0],
        without=mean[1:FIRST],
        present=count[1:FIRST] < count[0],
        power=1,
        apart=np.maximum(1.0 - count[0] / ROWS_ENOUGH, 0.0),
    )


def _shares(curve: CurveEstimator, at_points: Mapping[str, Statistic]) -> dict[str, Statistic]:
    total = at_points["total_order"]
    assert total.whole is not None and total.weighted_whole is not None
    sample, others = total.weighted_whole, total.whole[1:]  # of the points' variances, (..., 1)
    apart = FLOOR * heaviness(np.array(_kurtosis(curve, sample[0, :, 0])))

    def of_curve(name: str) -> Statistic:
        found = at_points[name]
        weighted, whole = _mean(found.weighted, sample)
        without, less = _mean(found.without, others)
        return Statistic(
            weighted=weighted,
            n=found.n.max(axis=0),
            without=without,
            present=np.asarray(found.present.any(axis=1)),
            power=found.power,
            whole=np.concatenate([whole[:1], less]),
            apart=None if found.apart is None else apart,
        )

    first, total = of_curve("first_order"), of_curve("total_order")
    assert total.whole is not None
    lengths = curve.lengths_of_sample()
    heavy = tail(
        half=lengths.mean("root")[0],
        first=curve.lengths().mean("size")[0],
        second=2.0 * total.weighted[0] * total.whole[0],
        fourth=lengths.mean("fourth")[0],
        n=total.n,
    )
    found = {
        "first_order": first,
        "total_order": replace(total, tail=heavy),
        "interaction": interaction(first, total),
        "sum_first_order": _sum(first),
        "sum_total_order": replace(_sum(total), whole=None),
    }
    if "second_order" in at_points:
        found["second_order"] = of_curve("second_order")
    return found


def _mean(index: Array, variance: Array) -> tuple[Array, Array]:
    """Return the mean index (..., factors) over points, weighted with variances, and their sum."""
    whole = np.nansum(variance, axis=-2)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.nansum(index * variance, axis=-2) / whole
    return np.where(whole > 0.0, mean, np.nan), whole


def _sum(index: Statistic) -> Statistic:
    """Return the sum of an index over the factors, shape (1,)."""
    return replace(
        index,
        weighted=index.weighted.sum(axis=-1, keepdims=True),
        n=index.n.min(keepdims=True),
        without=index.without.sum(axis=-1, keepdims=True),
        present=np.asarray(index.present.any(axis=-1, keepdims=True)),
        apart=None,
    )


def _kurtosis(curve: CurveEstimator, variance: Array) -> float:
    """Return the mean kurtosis of the points, weighted with their variances."""
    kurtosis = curve.points.kurtosis()
    known = np.isfinite(kurtosis) & (variance > 0.0)
    return float(np.average(kurtosis[known], weights=variance[known])) if known.any() else 1.0
