"""Elementary effects (Morris 1991; paper, equations 22 to 24; mu* of Campolongo et al. 2007)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.designs import unit_row
from analysis.designs.radial import legs
from analysis.sensitivity.estimators.estimator import Estimator, Index, Terms
from analysis.sensitivity.estimators.weightings import FIRST, Weighted


class MorrisEstimator(Estimator):
    """Mean, mean magnitude and standard deviation of the elementary effects of each factor.

    Effects are in the output's unit per whole range of the factor's distribution: the step of
    equation 22 is taken in the unit cube. A radial row whose base failed has no effects, one whose
    moved point failed lacks that factor's effect only; a trajectory lacks the effects of the moves
    to and from what failed.
    """

    method = "morris"
    use = counted = "effect"
    factor_sums = ("effect", "effect_squared", "magnitude")

    def _indices(self, sums: Weighted, sample: Weighted) -> dict[str, Index]:
        """Return "mu", "mu_star" and "sigma" of every output and factor."""
        counts = sums.count("effect")
        variance = sums.variance("effect", ddof=1)
        # Variances of resampled rows are too small by this factor in the mean.
        variance[FIRST:] *= counts[0] / np.maximum(counts[0] - 1, 1)
        return {
            "mu": Index(weighted=sums.mean("effect"), count=counts),
            "mu_star": Index(weighted=sums.mean("magnitude"), count=counts, power=1),
            "sigma": Index(weighted=np.sqrt(variance), count=counts, power=2),
        }

    def _terms(self, rows: Sequence[int], values: NDArray[np.float64]) -> Terms:
        designed = [
            legs(unit_row(self.method, self.sampling, self.seed, row, self.factors)) for row in rows
        ]
        (before, after) = np.stack([places for places, _ in designed], axis=1)  # rows, factors
        step = np.stack([step for _, step in designed])
        row = np.arange(len(rows))[:, None]
        moved = np.moveaxis(values[row, after] - values[row, before], 1, 2)
        effect = moved / step[:, None, :]  # rows, outputs, factors
        points = np.moveaxis(values, 1, 0)
        return {
            "effect": effect[None],
            "effect_squared": effect[None],
            "magnitude": np.abs(effect)[None],
            # Base and moved points alike are draws of the factors' distributions.
            "value": points,
            "value_squared": points,
        }
