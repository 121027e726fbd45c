"""Elementary effects (Morris 1991; paper, equations 22 to 24; mu* of Campolongo et al. 2007)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.designs import unit_rows
from analysis.designs.radial import SMALLEST_STEP, legs
from analysis.sensitivity.estimators.estimator import Estimator, Terms
from analysis.sensitivity.estimators.intervals import jackknife_error
from analysis.sensitivity.estimators.shares import LOW
from analysis.sensitivity.estimators.statistic import Index
from analysis.sensitivity.estimators.tails import (
    LARGEST_FOURTH,
    heaviness,
    lopsidedness,
    of_draws,
    of_leading,
    raw_kurtosis,
    tail,
)
from analysis.sensitivity.estimators.weightings import FIRST, Weighted

#: From so many rows on the eight blocks alone say how far an effect may be off; of fewer, ends of
#: intervals keep a share of what independent rows would err.
ROWS_ENOUGH = 128.0

#: By how much, over the output's magnitude, effects that are all the same may differ: two outputs
#: are rounded, some models' twice, and an effect divides by its step.
ROUNDING = 4.0 * float(np.finfo(np.float64).eps) / SMALLEST_STEP


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
    sample_sums = ("effect_root", "effect_fourth", "moved_square", "moved_fourth")

    #: Steps of 0.1 to 0.9 alone give effects of noise a kurtosis of 6.
    heavy_kurtosis = 9.0

    def kurtosis(self) -> NDArray[np.float64]:
        """Return E e^4 / E(e^2)^2 of the effects e of each output's leading factor, (outputs,).

        Of the one with the largest mean square, which a heavy tail makes up (Sobol and Kucherenko
        2009, Derivative based global sensitivity measures, rank by it).
        """
        second = self._weighted(1).mean("effect_squared")[0]
        raw = raw_kurtosis(second, self._weighted_sample().mean("effect_fourth")[0])
        return of_leading(raw, second)

    def other_kurtosis(self) -> NDArray[np.float64]:
        """Return the kurtosis of what the leading factor's moves are differences of, (outputs,).

        Steps of 0.1 to 0.9 alone give effects of normal noise a kurtosis of 10, and interactions
        alone give one to moves: of Ishigami's first factor these have 7, and effects 3 (Kendall and
        Stuart 1977, chapter 3).
        """
        second, sample = self._weighted(1).mean("effect_squared")[0], self._weighted_sample()
        moved = raw_kurtosis(sample.mean("moved_square")[0], sample.mean("moved_fourth")[0])
        return of_leading(of_draws(moved), second)

    def _indices(self, sums: Weighted, sample: Weighted) -> dict[str, Index]:
        """Return "mu", "mu_star" and "sigma" of every output and factor."""
        counts = sums.count("effect")
        variance = sums.variance("effect", ddof=1)
        # Of an exactly linear factor the effects differ by rounding only (Higham 2002, Accuracy and
        # stability of numerical algorithms, section 1.7), which is no sigma.
        size = np.fmax(np.abs(self.least), np.abs(self.most))[:, None]
        same = np.sqrt(variance[0]) <= ROUNDING * size
        variance = np.where(same & np.isfinite(size) & (variance > 0.0), 0.0, variance)
        # Variances of resampled rows are too small by this factor in the mean.
        variance[FIRST:] *= counts[0] / np.maximum(counts[0] - 1, 1)
        # n - 1 makes up for a mean that errs as that of independent rows does; that of balanced
        # ones hardly errs, as the blocks tell.
        mean = sums.mean("effect")
        present = counts[1:FIRST] < counts[0]
        error = jackknife_error(mean[1:FIRST], present)
        with np.errstate(divide="ignore", invalid="ignore"):
            unbiased = 1.0 - 1.0 / counts[0] + error**2 / variance[0]
        scale = np.where(np.isfinite(unbiased), np.sqrt(np.maximum(unbiased, 0.0)), 1.0)
        # Blocks of two or three rows tell little of their spread.
        apart = np.maximum(1.0 - counts[0] / ROWS_ENOUGH, 0.0)
        of_squares = tail(
            half=sample.mean("effect_root")[0],
            first=sums.mean("magnitude")[0],
            second=sums.mean("effect_squared")[0],
            fourth=sample.mean("effect_fourth")[0],
            n=counts[0],
        )
        heavy = heaviness(counts[0] / of_squares.rows, self.heavy_kurtosis)
        magnitude = sums.mean("magnitude")
        skewed, of_magnitudes = (
            lopsidedness(one[1:FIRST], present) for one in (variance, magnitude)
        )
        return {
            "mu": Index(weighted=mean, count=counts, apart=apart),
            "mu_star": Index(
                weighted=magnitude,
                count=counts,
                power=1,
                apart=apart,
                longer=1.0 + (LOW - 1.0) * of_magnitudes,
            ),
            "sigma": Index(
                weighted=np.sqrt(variance),
                count=counts,
                power=2,
                apart=apart,
                scale=scale,
                tail=of_squares,
                longer=1.0 + (LOW - 1.0) * np.maximum(heavy, skewed),
            ),
        }

    def _designed(self, rows: Sequence[int]) -> NDArray[np.float64]:
        """Return the points of rows in the unit cube, shape (rows, factors + 1, factors)."""
        return unit_rows(self.method, self.sampling, self.seed, rows, self.factors)

    def _terms(self, rows: Sequence[int], values: NDArray[np.float64]) -> Terms:
        (before, after), step = legs(self._designed(rows))  # rows, factors
        row = np.arange(len(rows))[:, None]
        moved = np.moveaxis(values[row, after] - values[row, before], 1, 2)
        effect = moved / step[:, None, :]  # rows, outputs, factors
        points = np.moveaxis(values, 1, 0)
        magnitude = np.abs(effect)
        size = np.where(magnitude <= LARGEST_FOURTH, magnitude, np.nan)
        square = np.where(np.abs(moved) <= LARGEST_FOURTH, moved * moved, np.nan)
        return {
            "effect": effect[None],
            "effect_squared": effect[None],
            "magnitude": magnitude[None],
            "effect_root": np.sqrt(size)[None],
            "effect_fourth": ((size * size) * (size * size))[None],
            "moved_square": square[None],
            "moved_fourth": (square * square)[None],
            # Base and moved points alike are draws of the factors' distributions.
            "value": points,
            "value_squared": points,
        }
