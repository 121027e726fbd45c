"""Second-order indices from the rows of Saltelli 2002, whose theorem 2 estimates them twice.

Write the two estimates in terms of Saltelli et al. 2010 (table 2, equation (b) for the first-order
parts), one with A and B exchanged, and their mean is made of differences within a row alone:

    V_ij = mean of ((A_B^(j) - A) (B_A^(i) - B) + (A_B^(i) - A) (B_A^(j) - B)) / 2

So a constant in the output cancels without centring, and a pair with an idle factor has exactly 0.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.sensitivity.estimators.estimator import Terms
from analysis.sensitivity.estimators.saltelli import SaltelliEstimator, share
from analysis.sensitivity.estimators.statistic import Index
from analysis.sensitivity.estimators.weightings import Weighted


class SecondOrderEstimator(SaltelliEstimator):
    """Shares of each output's variance, also those of pairs beyond what each factor does alone.

    With failures: a pair uses the rows whose A, B and four mixed points of it succeeded.
    """

    method = "saltelli_second_order"
    pair_sums = ("pair",)

    def _indices(self, sums: Weighted, sample: Weighted) -> dict[str, Index]:
        """Return what `SaltelliEstimator` does, and "second_order" of every output and pair."""
        variance = sums.variance("value", ddof=0)[..., None]
        pairs = Index(
            weighted=share(sums.mean("pair"), variance), count=sums.count("pair"), whole=variance
        )
        return {**super()._indices(sums, sample), "second_order": pairs}

    def _terms(self, rows: Sequence[int], values: NDArray[np.float64]) -> Terms:
        single = values[:, : 2 + self.factors]
        a, b = values[:, 0, :, None], values[:, 1, :, None]  # rows, outputs, 1
        from_a = np.moveaxis(values[:, 2 : 2 + self.factors], 1, 2) - a  # rows, outputs, factors
        from_b = np.moveaxis(values[:, 2 + self.factors :], 1, 2) - b
        i, j = np.triu_indices(self.factors, 1)
        pair = 0.5 * (from_a[..., j] * from_b[..., i] + from_a[..., i] * from_b[..., j])
        return {**super()._terms(rows, single), "pair": pair[None]}
