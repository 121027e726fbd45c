"""First-, total- and second-order indices (paper, equations 25 and 26).

First order by Saltelli et al. 2010, equation (b) of table 2, centred; total order by Jansen 1999,
equation (f) of the same table. Centring matters: without it all factors share an error of the size
of mean / standard deviation, whose signature is a negative index of an idle factor.

Second order from the rows of Saltelli 2002, whose theorem 2 estimates it twice. In terms of
Saltelli et al. 2010 (table 2, equation (b) for the first-order parts), once with A and B exchanged,
their mean is made of differences within a row alone:

    V_ij = mean of ((A_B^(j) - A) (B_A^(i) - B) + (A_B^(i) - A) (B_A^(j) - B)) / 2

So a constant in the output cancels without centring, and a pair with an idle factor has exactly 0.
"""

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from analysis.sensitivity.estimators import other_formulas
from analysis.sensitivity.estimators.estimator import Estimator, Terms
from analysis.sensitivity.estimators.intervals import Estimate
from analysis.sensitivity.estimators.shares import longer
from analysis.sensitivity.estimators.statistic import Index
from analysis.sensitivity.estimators.tails import (
    FLOOR,
    LARGEST_FOURTH,
    heaviness,
    of_draws,
    of_leading,
    raw_kurtosis,
    tail,
)
from analysis.sensitivity.estimators.weightings import Weighted


class PairEstimator(Estimator):
    """Of rows that each begin with two independent points, A and B."""

    def independent_runs(self) -> NDArray[np.int64]:
        """Return how many A and B of each output succeeded, shape (outputs,)."""
        runs: NDArray[np.int64] = self._weighted(1).count("value")[0]
        return runs

    def kurtosis(self) -> NDArray[np.float64]:
        """Return that of each output from A less B (Kendall and Stuart 1977), shape (outputs,)."""
        second = self._weighted(1).mean("between_squared")[0]
        fourth = self._weighted_sample().mean("between_fourth")[0]
        return np.maximum(of_draws(raw_kurtosis(second, fourth)), 1.0)


class SaltelliEstimator(PairEstimator):
    """Shares of each output's variance.

    With failures: total order uses the rows whose A and A_B^(i) succeeded, first order those whose
    B did too, mean and variance every A and B that did.
    """

    method = "saltelli"
    use, counted = "difference_squared", "product"
    factor_sums = ("product", "difference", "difference_squared")
    output_sums = ("value", "value_squared", "between_squared")
    sample_sums = ("difference_root", "difference_size", "difference_fourth", *other_formulas.SUMS)
    sample_output_sums = ("between_fourth",)
    #: Whether it has the sums of other estimators, too (`compared`).
    beside: ClassVar[bool] = True

    def other_kurtosis(self) -> NDArray[np.float64]:
        """Return the kurtosis of the differences that one factor makes of each output, (outputs,).

        Of the factor whose differences have the largest fourth moment. A tail that is not chance
        shows in those, since they bound the fourth moment of what independent factors make
        (Boucheron, Bousquet, Lugosi and Massart 2005, Moment inequalities for functions of
        independent random variables).
        """
        fourth = self._weighted_sample().mean("difference_fourth")[0]
        raw = raw_kurtosis(self._weighted(1).mean("difference_squared")[0], fourth)
        return of_leading(raw, fourth)

    def compared(self, level: float) -> dict[str, dict[str, Estimate]]:
        """Return {"martinez": S and ST by Martinez 2011} (`other_formulas`)."""
        return {"martinez": other_formulas.correlations(self._weighted_sample(), level)}

    def _alike(self) -> list[int]:
        """Return the positions of A and the A_B^(i); B has no coordinate of A."""
        return [0, *range(2, 2 + self.factors)]

    def _indices(self, sums: Weighted, sample: Weighted) -> dict[str, Index]:
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
        kurtosis = self.kurtosis()[:, None]
        apart, sides = FLOOR * heaviness(kurtosis), longer(kurtosis)
        return {
            "first_order": Index(
                weighted=first,
                count=firsts,
                whole=variance[..., None],
                apart=apart,
                longer=sides,
            ),
            "total_order": Index(
                weighted=total,
                count=totals,
                power=1,
                whole=variance[..., None],
                apart=apart,
                longer=sides,
                tail=tail(
                    half=sample.mean("difference_root")[0],
                    first=sample.mean("difference_size")[0],
                    second=sums.mean("difference_squared")[0],
                    fourth=sample.mean("difference_fourth")[0],
                    n=totals[0],
                ),
            ),
            "sum_first_order": Index(
                weighted=first.sum(axis=-1), count=firsts.min(axis=-1), whole=variance
            ),
            "sum_total_order": Index(
                weighted=total.sum(axis=-1), count=totals.min(axis=-1), power=1
            ),
            "dummy_first_order": Index(
                weighted=chance, count=sums.count("between_squared"), whole=variance
            ),
        }

    def _terms(self, rows: Sequence[int], values: NDArray[np.float64]) -> Terms:
        a, b = values[:, 0, :, None], values[:, 1, :, None]  # rows, outputs, 1
        mixed = np.moveaxis(values[:, 2:, :], 1, 2)  # rows, outputs, factors
        difference = mixed - a
        product = b * difference
        points = np.moveaxis(values[:, :2], 1, 0)
        between = values[:, 0] - values[:, 1]
        size, apart = (np.abs(one) for one in (difference, between))
        size = np.where(size <= LARGEST_FOURTH, size, np.nan)
        apart = np.where(apart <= LARGEST_FOURTH, apart, np.nan)
        return {
            "product": product[None],
            "difference": np.where(np.isnan(product), np.nan, difference)[None],
            "difference_squared": difference[None],
            "value": points,
            "value_squared": points,
            "between_squared": between[None],
            "between_fourth": ((apart * apart) * (apart * apart))[None],
            "difference_root": np.sqrt(size)[None],
            "difference_size": size[None],
            "difference_fourth": ((size * size) * (size * size))[None],
            **(other_formulas.terms(a, b, mixed) if self.beside else {}),
        }


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


def share(part: NDArray[np.float64], variance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return part / variance, nan where nothing varies (paper, equation 25)."""
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        share: NDArray[np.float64] = np.where(variance > 0.0, part / variance, np.nan)
    return share
