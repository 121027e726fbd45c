"""How the points of a sample lie: more evenly than drawn ones, or in groups that share values.

Points of a Sobol sequence (Sobol 1967) fill cells evenly where drawn ones scatter; rows that differ
in one factor only are what Saltelli et al. 2010 and Campolongo et al. 2011 make designs of.
"""

from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

Array = NDArray[np.float64]

#: Drawn points lie so evenly once in so many samples.
_RARE = 1e-4
#: Points that are expected in a cell, at least; cells a side, at most; factors looked at.
_IN_A_CELL, _MOST_CELLS, _MOST_FACTORS = 4, 16, 12
#: Of rows that differ from another in one factor only, the share that is mentioned, if it is so
#: many times that of the same values dealt anew.
_SHARE, _TIMES = 0.25, 3.0


def quasi_random(x: Array) -> bool:
    """Say whether points are those of a low-discrepancy sequence, such as Sobol's or Halton's.

    Their ranks fill the cells of a grid over two factors more evenly than chance does: Pearson's
    chi-square of all pairs (1900) is too small. Of a Latin hypercube it is not.

    Args:
        x: shape (rows, factors), rows in any order.
    """
    distinct = np.array([len(np.unique(column)) for column in x.T])
    # Levels of a grid are no sequence.
    x = x[:, distinct > len(x) / 2][:, :_MOST_FACTORS]
    rows, factors = x.shape
    if factors < 2:
        return False
    side = min(2 ** int(np.log2(rows / _IN_A_CELL) / 2), _MOST_CELLS)
    cell = np.argsort(np.argsort(x, axis=0, kind="stable"), axis=0) * side // rows
    expected, freedom = rows / side**2, (side - 1) ** 2
    found = np.array(
        [
            np.sum((np.bincount(side * cell[:, i] + cell[:, j], minlength=side**2) - expected) ** 2)
            for i, j in combinations(range(factors), 2)
        ]
    )
    found = found / expected
    # Factors that depend on each other say nothing of how the points were drawn.
    found = found[found < chi2.isf(_RARE, freedom)]
    return len(found) > 0 and bool(chi2.cdf(found.sum(), len(found) * freedom) < _RARE)


def in_parts(x: Array) -> int:
    """Return how many rows differ from another in one factor only, if more than by chance; or 0.

    So do those of a Saltelli or Morris design in whatever order, and several of one subject. Of
    two factors nothing can be told.
    """
    if x.shape[1] < 3:
        return 0
    rng = np.random.default_rng(0)
    codes = np.column_stack([np.unique(column, return_inverse=True)[1] for column in x.T])
    found = _neighbours(codes)
    if found < _SHARE * len(x) or found < _TIMES * _neighbours(rng.permuted(codes, axis=0)):
        return 0
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


def _neighbours(codes: NDArray[np.intp]) -> int:
    """Return how many rows have one that differs in exactly one column."""
    # A row is told by the sum of its values' random numbers: taking one away tells all others.
    rng = np.random.default_rng(1)
    marks = [rng.integers(0, 2**62, size=column.max() + 1)[column] for column in codes.T]
    whole = np.sum(marks, axis=0)
    beside = np.zeros(len(codes), dtype=np.bool_)
    for mark in marks:
        order = np.lexsort((mark, whole - mark))
        rest, own = (whole - mark)[order], mark[order]
        start = np.flatnonzero(np.r_[True, rest[1:] != rest[:-1]])
        many = np.maximum.reduceat(own, start) != np.minimum.reduceat(own, start)
        beside[order] |= np.repeat(many, np.diff(np.r_[start, len(rest)]))
    return int(beside.sum())
