"""First- and total-order indices (paper, equations 25 and 26).

First order by Saltelli et al. 2010, equation (b) of table 2, centred; total order by Jansen 1999,
equation (f) of the same table. Centring matters: without it all factors share an error of the size
of mean / standard deviation, whose signature is a negative index of an idle factor.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.estimators.estimator import Estimator, Index, Terms
from analysis.estimators.weightings import Weighted


class SaltelliEstimator(Estimator):
    """Shares of each output's variance.

    With failures: total order uses the rows whose A and A_B^(i) succeeded, first order those whose
    B did too, mean and variance every A and B that did.
    """

    method = "saltelli"
    use = "difference_squared"
    factor_sums = ("product", "difference", "difference_squared")
    output_sums = ("value", "value_squared", "between_squared")

    @property
    def effects(self) -> NDArray[np.int64]:
        effects: NDArray[np.int64] = self._weighted(1).count("product")[0]
        return effects

    def _indices(self, sums: Weighted) -> dict[str, Index]:
        """Return "first_order" and "total_order" of every output and factor, and per output:

        "sum_first_order", "sum_total_order", and "dummy_first_order": the correlation of A with B,
        which are unrelated. It is the first-order index that an estimator without differences gives
        a factor of no influence, hence a measure of chance (Khorashadi Zadeh et al. 2017,
        Comparison of variance-based and moment-independent global sensitivity analysis approaches,
        section 2.3). Ours give such a factor exactly 0.
        """
        variance = sums.variance("value", ddof=0)
        centred = sums.mean("product") - sums.mean("value")[..., None] * sums.mean("difference")
        first = share(centred, variance[..., None])
        total = share(0.5 * sums.mean("difference_squared"), variance[..., None])
        chance = 1.0 - share(0.5 * sums.mean("between_squared"), variance)
        firsts, totals = sums.count("product"), sums.count("difference_squared")
        return {
            "first_order": (first, firsts, None),
            "total_order": (total, totals, 1),
            "sum_first_order": (first.sum(axis=-1), firsts.min(axis=-1), None),
            "sum_total_order": (total.sum(axis=-1), totals.min(axis=-1), 1),
            "dummy_first_order": (chance, sums.count("between_squared"), None),
        }

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
            "between_squared": (values[:, 0] - values[:, 1])[None],
        }


def share(part: NDArray[np.float64], variance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return part / variance, nan where nothing varies (paper, equation 25)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        share: NDArray[np.float64] = np.where(variance > 0.0, part / variance, np.nan)
    return share
