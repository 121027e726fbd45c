"""Rows A, B and A_B^(i) for first- and total-order indices (Saltelli et al. 2010, section 4).

With B_A^(i) they give those of every pair of factors too (Saltelli 2002, Making best use of model
evaluations to compute sensitivity indices, theorem 2).
"""

import numpy as np
from numpy.typing import NDArray

from analysis.designs.groups import Units


def saltelli_row(
    point: NDArray[np.float64], *, second_order: bool = False, units: Units | None = None
) -> NDArray[np.float64]:
    """Lay out one row from a point of the unit cube of twice as many dimensions as factors.

    Position 0 is A, position 1 is B, position 2 + i is A with factor i taken from B, and, for the
    second order, position 2 + k + i is B with factor i taken from A. Source: Saltelli et al. 2010,
    section 4; Saltelli 2002, theorem 2.

    Args:
        point: shape (2 k,): A, then B.
        second_order: whether the row has the B_A^(i).
        units: the factors that take the place of factor i together; None: each by itself.

    Returns:
        Shape (k + 2, k), or (2 k + 2, k) for the second order; of units, with their number instead
        of the first k.
    """
    factors = point.size // 2
    a, b = point[:factors], point[factors:]
    if units is not None:
        return _by_units(a, b, units, second_order=second_order)
    # A coordinator lays out rows all the time: NumPy's own tile and fill_diagonal take longer.
    row = np.empty((2 * factors + 2 if second_order else factors + 2, factors))
    row[: factors + 2] = a
    row[1] = b
    row[2 : factors + 2].reshape(-1)[:: factors + 1] = b
    if second_order:
        row[factors + 2 :] = b
        row[factors + 2 :].reshape(-1)[:: factors + 1] = a
    return row


def _by_units(
    a: NDArray[np.float64], b: NDArray[np.float64], units: Units, *, second_order: bool
) -> NDArray[np.float64]:
    rows = [a, b]
    for base, other in ((a, b), (b, a))[: 1 + second_order]:
        for unit in units:
            mixed = base.copy()
            mixed[list(unit)] = other[list(unit)]
            rows.append(mixed)
    return np.stack(rows)
