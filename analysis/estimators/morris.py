"""Elementary effects (Morris 1991; paper, equations 22 to 24; mu* of Campolongo et al. 2007)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.designs import unit_row
from analysis.designs.radial import steps
from analysis.estimators.bootstrap import REPLICATES
from analysis.estimators.estimator import Estimator, Statistic, Terms


class MorrisEstimator(Estimator):
    """Mean, mean magnitude and standard deviation of the elementary effects of each factor.

    Effects are in the output's unit per whole range of the factor's distribution: the step of
    equation 22 is taken in the unit cube. A row whose base failed has no effects; a row whose moved
    point failed lacks that factor's effect only.
    """

    method = "morris"
    use = "effect"
    factor_sums = ("effect", "effect_squared", "magnitude")

    def statistics(self) -> dict[str, Statistic]:
        """Return "mu", "mu_star" and "sigma" of every output and factor."""
        counts = self._count("effect")
        variance = self._variance("effect", ddof=1)
        # Variances of resampled rows are too small by this factor in the mean.
        variance[1 : 1 + REPLICATES] *= counts[0] / np.maximum(counts[0] - 1, 1)
        return {
            "mu": self._statistic(self._mean("effect"), counts),
            "mu_star": self._statistic(self._mean("magnitude"), counts, power=1),
            "sigma": self._statistic(np.sqrt(variance), counts, power=2),
        }

    @property
    def effects(self) -> NDArray[np.int64]:
        return self._first_count("effect")

    def _terms(self, rows: Sequence[int], values: NDArray[np.float64]) -> Terms:
        step = np.stack(
            [
                steps(unit_row(self.method, self.sampling, self.seed, row, self.factors))
                for row in rows
            ]
        )
        moved = np.moveaxis(values[:, 1:, :], 1, 2)  # rows, outputs, factors
        effect = (moved - values[:, 0, :, None]) / step[:, None, :]
        points = np.moveaxis(values, 1, 0)
        return {
            "effect": effect[None],
            "effect_squared": effect[None],
            "magnitude": np.abs(effect)[None],
            # Base and moved points alike are draws of the factors' distributions.
            "value": points,
            "value_squared": points,
        }
