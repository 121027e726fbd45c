"""Rows A, B and A_B^(i) for first- and total-order indices (Saltelli et al. 2010, section 4).

With B_A^(i) they give those of every pair of factors too (Saltelli 2002, Making best use of model
evaluations to compute sensitivity indices, theorem 2).
"""

import numpy as np
from numpy.typing import NDArray


def saltelli_row(point: NDArray[np.float64], *, second_order: bool = False) -> NDArray[np.float64]:
    """Lay out one row from a point of the unit cube of twice as many dimensions as factors.

    Position 0 is A, position 1 is B, position 2 + i is A with factor i taken from B, and, for the
    second order, position 2 + k + i is B with factor i taken from A.

    Args:
        point: shape (2 k,): A, then B.
        second_order: whether the row has the B_A^(i).

    Returns:
        Shape (k + 2, k), or (2 k + 2, k) for the second order.
    """
    a, b = np.split(point, 2)
    row = np.tile(a, (a.size + 2, 1))
    row[1] = b
    np.fill_diagonal(row[2:], b)
    if not second_order:
        return row
    mirrored = np.tile(b, (a.size, 1))
    np.fill_diagonal(mirrored, a)
    return np.concatenate([row, mirrored])
