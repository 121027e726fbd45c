"""First- and total-order indices (paper, equations 25 and 26).

First order by Saltelli et al. 2010, equation (b) of table 2, centred; total order by Jansen 1999,
equation (f) of the same table. Centring matters: without it all factors share an error of the size
of mean / standard deviation, whose signature is a negative index of an idle factor.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.estimators.bootstrap import Estimate, estimate
from analysis.estimators.estimator import Estimator, Terms


class SaltelliEstimator(Estimator):
    """Shares of each output's variance.

    With failures: total order uses the rows whose A and A_B^(i) succeeded, first order those whose
    B did too, mean and variance every A and B that did.
    """

    method = "saltelli"
    use = "difference_squared"
    factor_sums = ("product", "difference", "difference_squared")

    def indices(self, level: float = 0.9) -> dict[str, Estimate]:
        """Return "first_order" and "total_order" of shape (outputs, factors), and their sums.

        The sums are "sum_first_order" and "sum_total_order" of shape (outputs,).
        """
        variance = self._variance("value", ddof=0)[..., None]
        centred = self._mean("product") - self._mean("value")[..., None] * self._mean("difference")
        half_squares = 0.5 * self._mean("difference_squared")
        with np.errstate(divide="ignore", invalid="ignore"):
            first = np.where(variance > 0.0, centred / variance, np.nan)
            total = np.where(variance > 0.0, half_squares / variance, np.nan)
        firsts, totals = self.effects, self._first_count("difference_squared")
        return {
            "first_order": estimate(first, firsts, level),
            "total_order": estimate(total, totals, level),
            "sum_first_order": estimate(first.sum(axis=-1), firsts.min(axis=-1), level),
            "sum_total_order": estimate(total.sum(axis=-1), totals.min(axis=-1), level),
        }

    @property
    def effects(self) -> NDArray[np.int64]:
        return self._first_count("product")

    def _terms(self, rows: Sequence[int], values: NDArray[np.float64]) -> Terms:
        a, b = values[:, 0, :, None], values[:, 1, :, None]  # rows, outputs, 1
        difference = np.moveaxis(values[:, 2:, :], 1, 2) - a  # rows, outputs, factors
        product = b * difference
        points = np.moveaxis(values[:, :2], 1, 0)
        return {
            "product": product[None],
            "difference": np.where(np.isnan(product), np.nan, difference)[None],
            "difference_squared": difference[None],
            "value": points,
            "value_squared": points,
        }
