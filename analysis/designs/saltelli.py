"""Rows A, B and A_B^(i) for first- and total-order indices (Saltelli et al. 2010, section 4)."""

import numpy as np
from numpy.typing import NDArray


def saltelli_row(point: NDArray[np.float64]) -> NDArray[np.float64]:
    """Lay out one row from a point of the unit cube of twice as many dimensions as factors.

    Position 0 is A, position 1 is B, position 2 + i is A with factor i taken from B.

    Args:
        point: shape (2 k,): A, then B.

    Returns:
        Shape (k + 2, k).
    """
    a, b = np.split(point, 2)
    row = np.tile(a, (a.size + 2, 1))
    row[1] = b
    np.fill_diagonal(row[2:], b)
    return row
