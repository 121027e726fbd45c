"""Between which bounds indices lie whatever the failed runs would have said.

Nothing is known of a missing output but that it might lie anywhere; here, anywhere in the range of
those that were seen (bounds without further assumptions, after Manski 1990, Nonparametric bounds on
treatment effects). They begin from the intervals, so they hold sampling error too, and they are
wide: of an output whose range is six standard deviations, 3 % failed runs may hide as much variance
as there is.

They are bounds of the true index, and of the estimate that the same runs would have given without
failures only as far as it is a share: that may lie beyond 0 or 1, where no true share does, and
bounds go there only if the interval of the runs that were seen does.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from analysis.designs import family
from analysis.designs.radial import SMALLEST_STEP
from analysis.designs.trajectories import STEP, TRAJECTORIES
from analysis.sensitivity.estimators import Estimate, Estimator, Statistic

Array = NDArray[np.float64]


def worst_case(
    estimator: Estimator, statistics: Mapping[str, Statistic], level: float
) -> dict[str, Estimate]:
    """Return the indices of single factors with their bounds as ends (Manski 1990).

    Nothing of Shapley effects.

    Args:
        estimator: of the study.
        statistics: of the estimator.
        level: of the intervals that the bounds begin from.

    Raises:
        ValueError: the level is not between 0 and 1.
    """
    if family(estimator.method) == "shapley":
        # An effect is a difference of variances of which failed runs may move either.
        return {}
    moments = estimator.moments()
    span = np.where(estimator.most >= estimator.least, estimator.most - estimator.least, np.nan)
    range_, mean = span[:, None], moments.mean[:, None]
    far = np.fmax(estimator.most - moments.mean, moments.mean - estimator.least)[:, None]
    rows = max(estimator.rows, 1)
    found: dict[str, Estimate] = {}
    if family(estimator.method) == "saltelli":
        first, total = statistics["first_order"], statistics["total_order"]
        variance = np.broadcast_to(_whole(total), mean.shape)
        lost = 1.0 - estimator.independent_runs()[:, None] / (2.0 * rows)
        least = (1.0 - lost) * variance
        most = least + lost * far**2
        seen = total.estimate(level)
        missing = 1.0 - total.n / rows
        with np.errstate(divide="ignore", invalid="ignore"):
            low = (1.0 - missing) * seen.low * variance / most
            high = ((1.0 - missing) * seen.high * variance + 0.5 * missing * range_**2) / least
            found["total_order"] = _ends(seen, low, np.minimum(high, np.fmax(1.0, seen.high)))
            seen = first.estimate(level)
            missing = 1.0 - first.n / rows
            hidden = missing * far * range_
            low = (1.0 - missing) * seen.low * variance - hidden
            high = (1.0 - missing) * seen.high * variance + hidden
            low, high = low / np.where(low > 0.0, most, least), high / least
            found["first_order"] = _ends(
                seen, np.maximum(low, np.fmin(0.0, seen.low)), np.minimum(high, 1.0)
            )
        return found
    step = STEP if estimator.sampling in TRAJECTORIES else SMALLEST_STEP
    largest = range_ / step
    ends = {name: statistics[name].estimate(level) for name in ("mu", "mu_star", "sigma")}
    missing = 1.0 - statistics["mu"].n / rows
    hidden, kept = missing * largest, 1.0 - missing
    found["mu"] = _ends(ends["mu"], kept * ends["mu"].low - hidden, kept * ends["mu"].high + hidden)
    found["mu_star"] = _ends(
        ends["mu_star"], kept * ends["mu_star"].low, kept * ends["mu_star"].high + hidden
    )
    squares = ends["sigma"].high ** 2 + ends["mu_star"].high ** 2
    found["sigma"] = _ends(
        ends["sigma"],
        np.sqrt(kept) * ends["sigma"].low,
        np.where(missing > 0.0, np.sqrt(kept * squares + missing * largest**2), ends["sigma"].high),
    )
    return found


def _whole(total: Statistic) -> Array:
    assert total.whole is not None
    whole: Array = total.whole[0]
    return whole


def _ends(seen: Estimate, low: Array, high: Array) -> Estimate:
    return Estimate(value=seen.value, low=low, high=high)
