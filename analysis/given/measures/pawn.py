"""How far a factor moves the output's distribution (Pianosi and Wagener 2018), all slices at once.

SALib gives the same numbers (`tests/unit/analysis/given` compares them), one slice after the other,
and intervals need them again and again.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Slices of a factor: SALib's own.
SLICES = 10


def pawn(x: Array, y: Array) -> Array:
    """Return the median distance of conditional distributions (Pianosi and Wagener 2018).

    It looks at no more of a factor than at ranks, so that slices are of equal size.

    Args:
        x: shape (rows, factors).
        y: shape (rows,).

    Returns:
        Shape (factors,).
    """
    rows = len(y)
    ascending = np.argsort(y, kind="stable")
    # Of equal values, the distribution is what the last of them says.
    last = np.append(np.diff(y[ascending]) > 0.0, True)
    whole = np.arange(1, rows + 1) / rows
    # The place of every rank among the slices; the last rank is in none, as SALib's.
    edges = np.quantile(np.arange(rows), np.arange(0.0, 1.0 + 1.0 / SLICES, 1.0 / SLICES))
    slices = np.searchsorted(edges, np.arange(rows), side="right") - 1
    found = np.empty(x.shape[1])
    for i, column in enumerate(x.T):
        place = np.empty(rows, dtype=np.intp)
        place[np.argsort(column, kind="stable")] = slices
        inside = place[ascending, None] == np.arange(SLICES)
        size = inside.sum(axis=0)
        distance = np.abs(inside.cumsum(axis=0) / np.maximum(size, 1) - whole[:, None])[last]
        found[i] = np.median(distance.max(axis=0)[size > 0])
    return found
