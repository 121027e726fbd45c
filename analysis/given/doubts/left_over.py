"""What is left of an output when what each factor does by itself is taken off, and what is in it.

Noise is as large wherever factors are; what factors do only together is alike where they are (von
Neumann 1941, Distribution of the ratio of the mean square successive difference to the variance;
Friedman and Rafsky 1979, Multivariate generalizations of the Wald-Wolfowitz and Smirnov two-sample
tests, for neighbours in several factors).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree
from scipy.stats import norm, rankdata

from analysis.given.measures.hdmr import ROWS_EACH, pieces, splines
from analysis.given.measures.measure import standard
from analysis.given.measures.rbd_fast import FEW_VALUES
from analysis.sensitivity.judgement.screening import SHARE_OF_VARIANCE

Array = NDArray[np.float64]

#: How likely factors of one output are said to act together if the rest is noise.
_BY_CHANCE = 1e-3
#: Share of an output from which it is mostly told: of less, a reader must know what the rest is.
_MOSTLY = 0.5
#: Rows that are looked at, and factors of which pairs are.
_MOST_ROWS, _MOST_FACTORS = 2000, 30
#: Pairs that are shown.
_SHOWN = 3


@dataclass(frozen=True, kw_only=True)
class Alike:
    """How alike pairs of rows are."""

    #: Mean product of the two rows' rests.
    product: float
    #: The same in standard errors, as if signs were thrown: hardly ever large by chance whatever
    #: the distribution is, and if noise differs from row to row (Hoeffding 1963).
    errors: float


def alike(left: Array, one: NDArray[np.intp], other: NDArray[np.intp]) -> Alike:
    """Return how alike rows are in what is left (Hoeffding 1963; Friedman and Rafsky 1979).

    Args:
        left: shape (rows,), of mean 0.
        one, other: the rows of each pair.
    """
    pair = np.unique(np.sort(np.column_stack([one, other]), axis=1), axis=0)
    product = left[pair[:, 0]] * left[pair[:, 1]]
    error = max(float(np.sqrt(np.sum(product**2))), float(np.finfo(float).tiny))
    return Alike(product=float(product.mean()), errors=float(product.sum()) / error)


def by_themselves(x: Array, y: Array) -> Array:
    """Return the function of each factor that together fit an output, shape (rows, factors).

    Means of few values and splines of others (Li et al. 2010); straight lines through ranks where
    there are too few rows for these, and nothing of too few for lines.
    """
    rows = len(x)
    each = functions_of(x)
    if not each[0].shape[1]:
        return np.zeros_like(x)
    ends = np.cumsum([one.shape[1] for one in each])
    basis = np.concatenate(each, axis=1)
    basis = basis - basis.mean(axis=0)
    basis /= np.maximum(np.sqrt(np.mean(basis**2, axis=0)), np.finfo(float).tiny)
    # Functions of a factor add up to a constant: without a little of their own there is no inverse.
    inner = basis.T @ basis + 1e-6 * rows * np.eye(basis.shape[1])
    solved = np.linalg.solve(inner, basis.T @ (y - y.mean()))
    return np.asarray(np.add.reduceat(basis * solved, [0, *ends[:-1]], axis=1))


def functions_of(x: Array) -> list[Array]:
    """Return the functions of each factor that are fitted, shape (rows, functions) each.

    As many as the rows allow (Li et al. 2010): splines and means, lines, or none of any.
    """
    rows, factors = x.shape
    if factors > rows / ROWS_EACH:
        return [np.empty((rows, 0)) for _ in range(factors)]
    cut = pieces(rows, factors)
    each = [_functions(column, cut) for column in x.T]
    if sum(one.shape[1] for one in each) > rows / ROWS_EACH:
        each = [rankdata(column)[:, None] for column in x.T]
    return each


def _functions(column: Array, cut: int) -> Array:
    classes = np.unique(column, return_inverse=True)[1]
    if classes.max() < FEW_VALUES:
        return np.asarray(classes[:, None] == np.arange(classes.max() + 1), dtype=np.float64)
    return splines(column, cut)


def unexplained(
    output: str,
    y: Array,
    factors: Sequence[str],
    x: Array,
    told: Mapping[str, Any],
    *,
    designed: bool = False,
) -> list[str]:
    """Say so if shares leave most of an output, and what factors do of the rest together.

    Neighbours in two factors, and in all, are alike beyond chance (Friedman and Rafsky 1979).

    Args:
        output, factors: names.
        y: shape (rows,).
        x: shape (rows, factors), rows drawn independently, in no order.
        told: measures that are shares, {NAME: {FACTOR: INTERVAL}}.
        designed: rows are points of a design, whose outputs may stand beside other points.
    """
    sums = {name: _sum(index) for name, index in told.items()}
    known = {name: one for name, one in sums.items() if one is not None}
    if not known or max(most for _, most in known.values()) >= _MOSTLY:
        return []
    by = max(known, key=lambda name: known[name][0])
    said = (
        f"By themselves the factors explain {max(known[by][0], 0.0):.0%} of {output}, all "
        f"together ({by}). The rest is noise, or factors that the table lacks, or what these do "
        "only together, which no measure of single factors need show: one that looks idle may "
        "matter."
    )
    if designed:
        said += " Or outputs do not stand beside the points that they are of: look at their lines."
    return [said, *_together(output, y[:_MOST_ROWS], factors, x[:_MOST_ROWS])]


def _sum(index: Mapping[str, Any]) -> tuple[float, float] | None:
    """Return the sum of shares and the upper end of its interval; None if none is told."""
    if not index or any(one["high"] is None for one in index.values()):
        return None
    value = sum(one["value"] for one in index.values())
    half = sum((one["high"] - one["value"]) ** 2 for one in index.values()) ** 0.5
    return value, value + half


def _together(output: str, y: Array, factors: Sequence[str], x: Array) -> list[str]:
    """Say which two factors, or else whether all, make rows alike beyond what each does."""
    if len(factors) < 2 or np.ptp(y) == 0.0:
        return []
    y = standard(y)
    left = y - by_themselves(x, y).sum(axis=1)
    # Rows of one point, or of few values, have any of the others for a neighbour.
    place = np.apply_along_axis(rankdata, 0, x) / len(x)
    place += 1e-6 * np.random.default_rng(0).random(x.shape)
    looked = range(min(len(factors), _MOST_FACTORS))
    sets = list(combinations(looked, 2))
    every = [tuple(range(len(factors)))] if len(factors) > 2 else []
    least = float(norm.isf(_BY_CHANCE / (len(sets) + len(every))))
    # Of waves that a factor makes by itself and that nothing followed, `waves.missed` tells.
    waves = {f for f in looked if _next(left, place[:, f]).errors > least}
    sets = [pair for pair in sets if not waves & set(pair)]
    every = [] if waves else every
    row = np.arange(len(x))
    found = []
    for few in (sets, every):
        for one in few:
            near = KDTree(place[:, one]).query(place[:, one], k=2)[1][:, 1]
            seen = alike(left, row, np.where(near == row, (row + 1) % len(row), near))
            if seen.errors > least and seen.product > SHARE_OF_VARIANCE:
                found.append((seen.product, one))
        if found:
            break
    found.sort(reverse=True)
    shown = "; ".join(
        f"{_named(factors, one)} (by {share:.2f} of its variance or more)"
        for share, one in found[:_SHOWN]
    )
    return [
        f"Factors act together on {output}: {shown}. Rows that are alike in them are alike in "
        f"{output}, beyond what each does by itself: they matter, however idle each looks alone."
    ] * bool(found)


def _next(left: Array, column: Array) -> Alike:
    """Return how alike rows are whose values of a factor are next to each other."""
    order = np.argsort(column)
    return alike(left, order[1:], order[:-1])


def _named(factors: Sequence[str], chosen: Sequence[int]) -> str:
    if len(chosen) == len(factors) > 2:
        return "some of all factors"
    return " and ".join(factors[f] for f in chosen)
