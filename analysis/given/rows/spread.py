"""How the points of a sample lie: more evenly than drawn ones, or in groups that share values.

Points of a Sobol sequence (Sobol 1967) fill cells evenly where drawn ones scatter; rows that differ
in one factor only are what Saltelli et al. 2010 and Campolongo et al. 2011 make designs of.
"""

from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.special import ndtri
from scipy.stats import chi2, rankdata

Array = NDArray[np.float64]

#: Drawn points lie so evenly once in so many samples.
_RARE = 1e-4
#: Points that are expected in a cell, at least; cells a side, at most; factors looked at.
_IN_A_CELL, _MOST_CELLS, _MOST_FACTORS = 4, 16, 12
#: Of rows that differ from another in one factor only, the share that is mentioned, if it is so
#: many times that of the same values dealt anew.
_SHARE, _TIMES = 0.25, 3.0
#: Where values are few, such pairs of rows are there by chance: how many standard deviations and
#: how many times as many as in deals there must be, and how many deals.
_BEYOND, _MORE, _DEALS = 5.0, 1.1, 20
#: Distance of values, in ranges of the factor, that a computer's rounding may have made.
_EQUAL = 1e-9


def quasi_random(x: Array) -> bool:
    """Say whether points are those of a low-discrepancy sequence, such as Sobol's or Halton's.

    Their ranks fill the cells of a grid over two factors more evenly than chance does: Pearson's
    chi-square of all pairs (1900) is too small. Of a Latin hypercube it is not, unless that was
    optimised: then it is as even, without a sequence's waves, and nothing here tells the two apart.
    Of factors that a Gaussian copula joins it is that of the normals behind them.

    Args:
        x: shape (rows, factors), rows in any order.
    """
    distinct = np.array([len(np.unique(column)) for column in x.T])
    # Of rounded values there must be more than the cells have sides, and more than a grid's levels:
    # one over two factors, of which every other point may be missing, is no sequence.
    told = (distinct > 2 * _MOST_CELLS) & (distinct**2 > 2 * len(x))
    x = x[:, (distinct > len(x) / 2) | told][:, :_MOST_FACTORS]
    rows, factors = x.shape
    if factors < 2:
        return False
    side = min(2 ** int(np.log2(rows / _IN_A_CELL) / 2), _MOST_CELLS)
    freedom = (side - 1) ** 2
    rank = _ranks(x)
    plain = _unevenness(rank, side)
    # Of factors that depend on each other only what each adds to those before it lies evenly.
    apart = plain < chi2.isf(_RARE, freedom)
    found, free = plain[apart].sum(), apart.sum() * freedom
    tests = [(found, free)]
    if not apart.all():
        score = ndtri((rank + 0.5) / rows)
        for order in (slice(None), slice(None, None, -1)):
            left = _unevenness(_ranks(_left(score[:, order])), side)
            depends = ~apart if order.step is None else ~_mirrored(apart, factors)
            left = left[depends & (left < chi2.isf(_RARE, freedom))]
            tests.append((found + left.sum(), free + len(left) * (freedom - 1)))
    return any(free > 0 and bool(chi2.cdf(found, free) < _RARE) for found, free in tests)


def _ranks(x: Array) -> NDArray[np.intp]:
    return np.argsort(np.argsort(x, axis=0, kind="stable"), axis=0)


def _unevenness(rank: NDArray[np.intp], side: int) -> Array:
    """Return Pearson's chi-square (1900) of the cells of every two factors, shape (pairs,)."""
    rows, factors = rank.shape
    cell, expected = rank * side // rows, rows / side**2
    found = [
        np.sum((np.bincount(side * cell[:, i] + cell[:, j], minlength=side**2) - expected) ** 2)
        for i, j in combinations(range(factors), 2)
    ]
    return np.asarray(found, dtype=np.float64) / np.float64(expected)


def _left(score: Array) -> Array:
    """Return what normal scores (rows, factors) add to those of the factors before them.

    That is what a Gaussian copula was made of (Cario and Nelson 1997), if in this order.
    """
    correlation = np.corrcoef(score, rowvar=False) + 1e-9 * np.eye(score.shape[1])
    found: Array = np.linalg.solve(np.linalg.cholesky(correlation), score.T).T
    return found


def _mirrored(of_pairs: NDArray[np.bool_], factors: int) -> NDArray[np.bool_]:
    """Return what is said of every pair, of the factors in the opposite order."""
    said = np.zeros((factors, factors), dtype=np.bool_)
    said[np.triu_indices(factors, 1)] = of_pairs
    return (said | said.T)[::-1, ::-1][np.triu_indices(factors, 1)]


def in_parts(x: Array) -> int:
    """Return how many rows differ from another in one factor only, if more than by chance; or 0.

    So do those of a Saltelli or Morris design in whatever order, and several of one subject. Of
    two factors nothing can be told.
    """
    if x.shape[1] < 3:
        return 0
    rng = np.random.default_rng(0)
    codes = np.column_stack([_levels(column) for column in x.T])
    beside, pairs = _neighbours(codes)
    found = int(beside.any(axis=1).sum())
    if found < _SHARE * len(x):
        return 0
    if found >= _TIMES * _neighbours(rng.permuted(codes, axis=0))[0].any(axis=1).sum():
        return found
    dealt, beyond = _beyond_chance(codes, pairs, rng)
    return found if beyond else _of_one_factor(codes, beside, pairs, dealt)


def _beyond_chance(
    codes: NDArray[np.intp], pairs: NDArray[np.intp], rng: np.random.Generator
) -> tuple[Array, bool]:
    """Say whether more pairs of rows differ in one factor only than if rows were drawn.

    Values of factors that may depend on each other are dealt together.

    Returns:
        The pairs of each factor that chance makes, shape (factors,), and whether they are fewer.
    """
    together = joined(codes)
    if together.max() == 0:
        return pairs.astype(np.float64), False
    dealt: list[NDArray[np.intp]] = []
    for deal in range(_DEALS):
        anew = codes.copy()
        for group in range(together.max() + 1):
            anew[:, together == group] = rng.permutation(codes[:, together == group])
        dealt.append(_neighbours(anew)[1])
        chance = np.mean(dealt, axis=0)
        of_all = float(chance.sum())
        if deal >= 2 and pairs.sum() < max(_MORE * of_all, of_all + _SHARE * len(codes)):
            return chance, False
    varied = float(np.std(np.sum(dealt, axis=1), ddof=1))
    return chance, bool(pairs.sum() > of_all + _BEYOND * max(varied, of_all**0.5))


def _of_one_factor(
    codes: NDArray[np.intp], beside: NDArray[np.bool_], pairs: NDArray[np.intp], dealt: Array
) -> int:
    """Return how many rows differ from another in a factor whose pairs are far beyond chance; or 0.

    Where a factor has two values, those of all others that share the rest differ in one as often by
    chance. What a design moves alone has its own value again as often as two draws of it do.
    """
    equal = np.array([np.sum((np.bincount(column) / len(codes)) ** 2) for column in codes.T])
    moved = beside.sum(axis=0) >= _SHARE * len(codes) * (1.0 - equal)
    far = pairs > _TIMES * dealt + _BEYOND * np.sqrt(dealt)
    return int(beside[:, moved & far].any(axis=1).sum())


def joined(codes: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return a group of each factor: of those that may depend on each other, the same."""
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = np.atleast_2d(np.corrcoef(rankdata(codes, axis=0), rowvar=False))
    near = csr_array(np.nan_to_num(np.abs(correlation)) > 3.0 / np.sqrt(len(codes)))
    group: NDArray[np.intp] = connected_components(near, directed=False)[1]
    return group


def _levels(column: Array) -> NDArray[np.intp]:
    """Return the number of each value among those of a column."""
    values, level = np.unique(column, return_inverse=True)
    new = np.diff(values, prepend=values[0]) > _EQUAL * (values[-1] - values[0])
    found: NDArray[np.intp] = np.cumsum(new)[level]
    return found


def sharing_nothing(x: Array) -> NDArray[np.intp]:
    """Return rows of which no two share a value, in order."""
    seen: list[set[float]] = [set() for _ in range(x.shape[1])]
    kept = []
    for row, values in enumerate(x.tolist()):
        if any(value in known for value, known in zip(values, seen, strict=True)):
            continue
        kept.append(row)
        for value, known in zip(values, seen, strict=True):
            known.add(value)
    return np.array(kept, dtype=np.intp)


def _neighbours(codes: NDArray[np.intp]) -> tuple[NDArray[np.bool_], NDArray[np.intp]]:
    """Return which rows have one that differs in exactly this column, and such pairs of rows.

    Shapes (rows, factors) and (factors,).
    """
    # A row is told by the sum of its values' random numbers: taking one away tells all others.
    rng = np.random.default_rng(1)
    marks = [rng.integers(0, 2**62, size=column.max() + 1)[column] for column in codes.T]
    whole = np.sum(marks, axis=0)
    beside = np.zeros(codes.shape, dtype=np.bool_)
    pairs = np.zeros(codes.shape[1], dtype=np.intp)
    for f, mark in enumerate(marks):
        order = np.lexsort((mark, whole - mark))
        rest, own = (whole - mark)[order], mark[order]
        new = np.r_[True, rest[1:] != rest[:-1]]
        start = np.flatnonzero(new)
        many = np.maximum.reduceat(own, start) != np.minimum.reduceat(own, start)
        size = np.diff(np.r_[start, len(rest)])
        beside[order, f] = np.repeat(many, size)
        alike = np.diff(np.r_[np.flatnonzero(new | np.r_[True, own[1:] != own[:-1]]), len(rest)])
        pairs[f] = ((size * (size - 1)).sum() - (alike * (alike - 1)).sum()) // 2
    return beside, pairs
