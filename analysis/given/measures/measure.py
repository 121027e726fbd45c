"""Indices of given samples, as SALib computes them, and HSIC (Da Veiga 2015).

Each takes x of shape (rows, factors) and y of shape (rows,), and returns shape (factors,). Rows
must be in no order that has to do with the factors: those with equal values stay as they come.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from analysis.given.measures.delta import delta, in_scores
from analysis.given.measures.hdmr import PIECES, fewest_rows, hdmr, leave_out
from analysis.given.measures.hsic import r2_hsic
from analysis.given.measures.intervals import (
    PERMUTATIONS,
    Chance,
    Spread,
    by_bootstrap,
    by_chance,
    by_halves,
    by_score,
    half_width,
)
from analysis.given.measures.pawn import SLICES, pawn
from analysis.given.measures.rbd_fast import FEW_VALUES, HARMONICS, rbd_fast, rbd_fast_at

Array = NDArray[np.float64]


def unless_still(index: Callable[[Array, Array], Array]) -> Callable[[Array, Array], Array]:
    """Return an index that is 0 where the output does not vary, as in parts of a rare event's."""

    def of_what_varies(x: Array, y: Array) -> Array:
        return index(x, y) if np.ptp(y) > 0.0 else np.zeros(x.shape[1])

    return of_what_varies


def standard(columns: Array) -> Array:
    """Return columns of mean 0 and deviation 1, which every measure is the same of.

    Numbers far from 1 may overflow or vanish on the way. What does not vary becomes 0.
    """
    deviation = columns.std(axis=0)
    scaled: Array = (columns - columns.mean(axis=0)) / np.where(deviation > 0.0, deviation, 1.0)
    return scaled


def _unexplained(value: Array, chance: Array) -> Array:
    """Return the square of the share of the variance that a factor does not explain."""
    share: Array = np.clip(1.0 - value, 0.0, 1.0) ** 2
    return share


def _by_leaving_out(index: object, x: Array, y: Array, rng: object) -> Spread:
    """Return the spread of `hdmr` (Kline et al. 2020), for which nothing is drawn."""
    return leave_out(x, y)[1]


def _beside(value: Array, chance: Array) -> Array:
    """Return how much of a distance is chance, 1 of an idle factor and soon nothing of others.

    (The power was set on samples of `benchmarks.sensitivity.dependent` that it does not report.)
    """
    share: Array = np.clip(chance / np.maximum(value, 1e-300), 0.0, 1.0) ** 8
    return share


@dataclass(frozen=True, kw_only=True)
class Found:
    """A measure of every factor, shape (factors,) each."""

    value: Array
    low: Array
    high: Array
    #: What a factor gets from as many rows that has nothing to do with the output.
    chance: Array


@dataclass(frozen=True, kw_only=True)
class Measure:
    """An index, how its interval is made, and what a reader must know of it."""

    name: str
    #: In a table.
    symbol: str
    index: Callable[[Array, Array], Array]
    #: How it varies, from index, x, y and a generator (`analysis.given.measures.intervals`).
    spread: Callable[..., Spread]
    #: Of value and chance, shape (factors,) each: the variance of what chance adds to the index, as
    #: a share of what it is of a factor that does nothing where all the output is noise. None: it
    #: is counted once already, or cannot be told apart from what a weak factor does.
    rest: Callable[[Array, Array], Array] | None
    #: Whether that is told at the ends of an interval, where the index would be, not at the value.
    score: bool = False
    #: How often the output is permuted to tell that, and whether it is in halves of the sample too,
    #: where more is taken off for a bias than of all rows.
    permutations: int = PERMUTATIONS
    of_halves: bool = False
    #: It grows with the square of the rows, or is slow: of more rows so many are drawn.
    most_rows: int
    #: Rows squared times factors at most, of one that takes a kernel of every two rows.
    most_held: float = float("inf")
    #: No index is below, and none above: of what only noise can be, an interval ends there.
    least: float | None
    most: float | None = None
    #: Makes of factors and an output one of which the index is the same, and better told.
    settled: Callable[[Array, Array], Array] | None = None
    #: An index of no influence is not 0: what it is, is found by permuting the output.
    biased: bool
    #: The index of any output of the same factors, if that takes less time.
    at: Callable[[Array], Callable[[Array], Array]] | None = None
    #: Points of a low-discrepancy sequence mislead it.
    needs_drawn: bool = False
    #: Of how many factors it takes how many rows, at least.
    fewest_rows: Callable[[int], int] = lambda factors: 0
    assumes: str
    source: str

    def looks_at(self, rows: int, factors: int) -> int:
        """Return of how many rows it is told, as far as time allows."""
        most = min(rows, self.most_rows)
        if np.isfinite(self.most_held):
            most = min(most, int((self.most_held / factors) ** 0.5))
        return most

    def estimate(self, x: Array, y: Array, level: float, rng: np.random.Generator) -> Found:
        """Return it of every factor, with its interval (Efron and Stein 1981).

        Args:
            x: shape (rows, factors).
            y: shape (rows,).
            level: of the interval, between 0 and 1.
            rng: draws halves or resamples, and permutations.
        """
        x, y = standard(x), standard(self.settled(x, y) if self.settled else y)
        value = self.index(x, y)
        spread = self.spread(self.index, x, y, rng)
        nothing = np.zeros_like(value)
        chance, seen = Chance(mean=nothing, variance=nothing), 2.0
        if self.rest is not None:
            # A permuted output varies as the output does.
            chance = by_chance(self._at(x), y, rng, self.permutations)
        half = rng.permutation(len(y))[: len(y) // 2]
        if self.of_halves and np.ptp(y[half]) > 0.0:
            of_half = by_chance(self._at(x[half]), y[half], rng, self.permutations)
            # `by_halves` has half the variance of each. One number for all factors: to tell it of
            # each would take as many times the permutations.
            of_all = max(chance.variance.sum(), 1e-300)
            seen = max(0.5 * float(of_half.variance.sum()) / of_all, 1.0)

        def half_if(true: Array) -> Array:
            """Return half the width of an interval around an index that is `true`."""
            share = nothing if self.rest is None else self.rest(true, chance.mean)
            added = chance.variance * share
            return half_width(spread, added, level, seen, added if self.of_halves else 0.0)

        if self.score:
            low, high = by_score(half_if, value, half_width(spread, nothing, level))
        else:
            low, high = value - half_if(value), value + half_if(value)
        low = low if self.least is None else np.maximum(low, self.least)
        high = high if self.most is None else np.minimum(high, self.most)
        return Found(value=value, low=low, high=high, chance=chance.mean)

    def _at(self, x: Array) -> Callable[[Array], Array]:
        return self.at(x) if self.at else partial(self.index, x)


MEASURES = (
    Measure(
        name="rbd_fast",
        symbol="S",
        index=unless_still(rbd_fast),
        at=rbd_fast_at,
        spread=by_halves,
        rest=_unexplained,
        permutations=64,
        of_halves=True,
        most_rows=20_000,
        least=None,
        biased=False,
        needs_drawn=True,
        assumes="factors are independent of each other, points are drawn at random or as a Latin "
        "hypercube (of Sobol's points it is withheld), and the output changes with each of them "
        f"no more often than {HARMONICS} harmonics and as many jumps follow, but with one of "
        f"{FEW_VALUES} values or fewer in any way; says nothing of interactions",
        source="Tarantola, Gatelli and Mara 2006; Plischke 2010; Tissot and Prieur 2012 (SALib)",
    ),
    Measure(
        name="hdmr",
        symbol="S (HDMR)",
        index=unless_still(hdmr),
        spread=_by_leaving_out,
        rest=None,
        most_rows=5_000,
        least=None,
        biased=False,
        fewest_rows=fewest_rows,
        assumes="the output is a sum of a smooth function of each factor, splines of "
        f"{PIECES} pieces or, of many rows, more, with a few jumps, and of what is left to noise; "
        "factors may depend on each other: what one shares with others counts for each; says "
        "nothing of interactions",
        source="Rabitz and Alis 1999; Li et al. 2010; Kline, Saggio and Solvsten 2020",
    ),
    Measure(
        name="delta",
        symbol="δ",
        index=unless_still(delta),
        spread=by_bootstrap,
        rest=_beside,
        score=True,
        most_rows=2_000,
        least=0.0,
        most=1.0,
        settled=in_scores,
        biased=True,
        assumes="the output has a density; is never 0 of a finite sample, so compare it with "
        "`chance`; its interval says where another sample of as many rows would put it; of an "
        "output whose variance few rows make up, or of which many have one value, it is told from "
        "normal scores, which leave it as it is",
        source="Borgonovo 2007; Plischke, Borgonovo and Smith 2013 (SALib)",
    ),
    Measure(
        name="pawn",
        symbol="PAWN",
        index=unless_still(pawn),
        spread=by_bootstrap,
        rest=_beside,
        most_rows=20_000,
        least=0.0,
        most=1.0,
        biased=True,
        assumes=f"a factor's {SLICES} slices are thin enough to be one value of it; is never 0 of "
        "a finite sample, so compare it with `chance`; its interval says where another sample of "
        "as many rows would put it",
        source="Pianosi and Wagener 2018 (SALib)",
    ),
    Measure(
        name="hsic",
        symbol="R²-HSIC",
        index=unless_still(r2_hsic),
        spread=by_halves,
        rest=None,
        most_rows=1_000,
        most_held=5e7,
        least=None,
        biased=False,
        assumes="nothing of the form of the dependence on this factor alone, and does not see what "
        "factors do only together; how large it is depends on the kernels, so "
        "rank by it, and take the test for yes or no",
        source="Gretton et al. 2007; Da Veiga 2015; Song et al. 2012",
    ),
)
