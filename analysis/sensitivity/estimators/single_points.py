"""Mean and spread of outputs at single points, of which no sum is an index.

The indices of a study of method surrogate are those of a fitted function, which needs the values
themselves (`analysis.sensitivity.fewer_runs.looks`). A study of method sample has none: what its
rows tell of factors is what any sample's tell (`analysis.given`).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.sensitivity.estimators.estimator import Estimator, Terms
from analysis.sensitivity.estimators.statistic import Index
from analysis.sensitivity.estimators.weightings import Weighted


class SinglePoints(Estimator):
    """What a study of single points has of an estimator (Saltelli et al. 2010, for the names)."""

    method = "surrogate"
    use = counted = "run"
    factor_sums = ("run",)

    def _indices(self, sums: Weighted, sample: Weighted) -> dict[str, Index]:
        count = sums.count("run")
        whole = sums.variance("value", ddof=0)
        unknown = np.full(count.shape, np.nan)
        of_factors = Index(weighted=unknown, count=count, whole=whole[..., None])
        of_all = Index(weighted=unknown[..., 0], count=count[..., 0], whole=whole)
        return {
            "first_order": of_factors,
            "total_order": of_factors,
            "sum_first_order": of_all,
            "sum_total_order": of_all,
        }

    def _terms(self, rows: Sequence[int], values: NDArray[np.float64]) -> Terms:
        points = np.moveaxis(values, 1, 0)
        return {
            "run": np.repeat(points[..., None], self.factors, axis=-1),
            "value": points,
            "value_squared": points,
        }


class Sample(SinglePoints):
    """The same of a study that only samples (Saltelli et al. 2010, for the names)."""

    method = "sample"
