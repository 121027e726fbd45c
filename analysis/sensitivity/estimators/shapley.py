"""Shapley effects, and the full and independent indices of factors that may depend on each other.

Rows are those of `analysis.designs.shapley`. With d_j the difference of A and the point that keeps
the first j factors of the row's order, half the mean of d_j^2 is the expected variance that is left
when these are known (Jansen 1999). What the j-th factor takes off, averaged over orders, is its
Shapley effect (Song, Nelson and Staum 2016, equation 5; the sum telescopes as in Goda 2021,
algorithm 1). In shares of half the mean of d_0^2, which is the variance, effects sum to 1 exactly.

Full indices hold what a factor shares with those that it depends on, independent ones what it has
without them (Mara and Tarantola 2012, section 3): `full_first_order` is the variance of the mean
given the factor, `independent_total_order` the variance left when all others are known; of
independent factors they are S and ST, and equal `independent_first_order` and `full_total_order`.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.designs import orders_of
from analysis.sensitivity.estimators.estimator import Terms
from analysis.sensitivity.estimators.saltelli import PairEstimator, share
from analysis.sensitivity.estimators.shares import longer
from analysis.sensitivity.estimators.statistic import Index
from analysis.sensitivity.estimators.tails import FLOOR, LARGEST_FOURTH, heaviness, tail
from analysis.sensitivity.estimators.weightings import Weighted

#: The four pairs of points by which full and independent indices are told: the sum of products, or
#: of squared differences, that each index is made of.
_FIRSTS = {"full_first_order": "first", "independent_first_order": "last"}
_TOTALS = {"full_total_order": "moved_first", "independent_total_order": "moved_last"}


class ShapleyEstimator(PairEstimator):
    """Shares of each output's variance that add up to 1, whether factors are independent or not.

    With failures: an effect uses the rows whose A and two points before and after the factor
    succeeded.
    """

    method = "shapley"
    use = counted = "gain"
    factor_sums = (
        "gain",
        *(f"{name}_product" for name in _FIRSTS.values()),
        *(f"{name}_difference" for name in _FIRSTS.values()),
        *(f"{name}_squared" for name in _TOTALS.values()),
    )
    output_sums = ("value", "value_squared", "between_squared")
    sample_sums = tuple(
        f"{name}_{what}" for name in _TOTALS.values() for what in ("root", "size", "fourth")
    )
    sample_output_sums = ("between_fourth",)

    def _effects(self, sums: Weighted) -> Index:
        """Return the Shapley effects of every output and factor."""
        whole = 0.5 * sums.mean("between_squared")[..., None]
        return Index(
            weighted=share(sums.mean("gain"), whole),
            count=sums.count("gain"),
            whole=whole,
            apart=FLOOR * heaviness(self.kurtosis())[:, None],
        )

    def _indices(self, sums: Weighted, sample: Weighted) -> dict[str, Index]:
        """Return "shapley", and the four indices of the module's docstring."""
        found = {"shapley": self._effects(sums)}
        variance = sums.variance("value", ddof=0)[..., None]
        apart, sides = found["shapley"].apart, longer(self.kurtosis()[:, None])
        for name, pair in _FIRSTS.items():
            mean = sums.mean("value")[..., None]
            centred = sums.mean(f"{pair}_product") - mean * sums.mean(f"{pair}_difference")
            found[name] = Index(
                weighted=share(centred, variance),
                count=sums.count(f"{pair}_product"),
                whole=variance,
                apart=apart,
            )
        for name, pair in _TOTALS.items():
            squared, count = sums.mean(f"{pair}_squared"), sums.count(f"{pair}_squared")
            found[name] = Index(
                weighted=share(0.5 * squared, variance),
                count=count,
                power=1,
                whole=variance,
                apart=apart,
                longer=sides,
                tail=tail(
                    half=sample.mean(f"{pair}_root")[0],
                    first=sample.mean(f"{pair}_size")[0],
                    second=squared[0],
                    fourth=sample.mean(f"{pair}_fourth")[0],
                    n=count[0],
                ),
            )
        return found

    def _of_effects(self, order: NDArray[np.intp], values: NDArray[np.float64]) -> Terms:
        """Return what rows of these orders add to the sums of Shapley effects."""
        k = self.factors
        a, b = values[:, 0], values[:, 1]  # rows, outputs
        # A less the points that keep 0, 1, ..., k factors of A.
        apart = np.concatenate([a[:, None] - values[:, 1 : k + 1], 0.0 * a[:, None]], axis=1)
        gain = 0.5 * (apart[:, :-1] - apart[:, 1:]) * (apart[:, :-1] + apart[:, 1:])
        by_factor = np.empty_like(gain)
        by_factor[np.arange(len(values))[:, None], order] = gain
        points = np.moveaxis(values[:, :2], 1, 0)
        between = np.abs(a - b)
        between_size = np.where(between <= LARGEST_FOURTH, between, np.nan)
        return {
            "gain": np.moveaxis(by_factor, 1, 2)[None],
            "value": points,
            "value_squared": points,
            "between_squared": (a - b)[None],
            "between_fourth": (between_size**2 * between_size**2)[None],
        }

    def _terms(self, rows: Sequence[int], values: NDArray[np.float64]) -> Terms:
        k = self.factors
        order = orders_of(self.sampling, self.seed, rows, k)
        a, b = values[:, 0], values[:, 1]  # rows, outputs
        every = np.arange(len(rows))

        def of(place: int, terms: NDArray[np.float64]) -> NDArray[np.float64]:
            """Return terms (rows, outputs) as those of the factor at a place of the order."""
            spread = np.full((len(rows), k, values.shape[2]), np.nan)
            spread[every, order[:, place]] = terms
            return np.moveaxis(spread, 1, 2)[None]

        # Beside A, the points that share with it the first factor only, and the last only.
        alone = {"first": (0, values[:, 2] - b), "last": (-1, values[:, k + 2] - b)}
        moved = {"moved_first": (0, values[:, k + 1] - a), "moved_last": (-1, values[:, k] - a)}
        terms = dict(self._of_effects(order, values))
        for name, (place, difference) in alone.items():
            product = a * difference
            terms[f"{name}_product"] = of(place, product)
            terms[f"{name}_difference"] = of(place, np.where(np.isnan(product), np.nan, difference))
        for name, (place, difference) in moved.items():
            size = np.abs(difference)
            size = np.where(size <= LARGEST_FOURTH, size, np.nan)
            terms[f"{name}_squared"] = of(place, difference)
            terms[f"{name}_root"] = of(place, np.sqrt(size))
            terms[f"{name}_size"] = of(place, size)
            terms[f"{name}_fourth"] = of(place, (size * size) * (size * size))
        return terms


class ShapleyEffects(ShapleyEstimator):
    """Shapley effects alone, of the same rows in a part of the time."""

    factor_sums = ("gain",)
    sample_sums = ()

    def _indices(self, sums: Weighted, sample: Weighted) -> dict[str, Index]:
        """Return "shapley"."""
        return {"shapley": self._effects(sums)}

    def _terms(self, rows: Sequence[int], values: NDArray[np.float64]) -> Terms:
        order = orders_of(self.sampling, self.seed, rows, self.factors)
        return self._of_effects(order, values)
