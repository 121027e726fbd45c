"""S and ST from products that are not centred, to see what centring does.

They need all runs at once and are no part of what is streamed.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def uncentred(rows: Array) -> tuple[Array, Array]:
    """Return first- and total-order indices by Saltelli et al. 2008, equations 4.21 and 4.23.

    All factors share an error of the size of mean / standard deviation.

    Args:
        rows: one output's values at A, B and A_B^(i), shape (rows, factors + 2), nan where a run
            failed; every pair of values is used.

    Returns:
        Two arrays of shape (factors,), nan where nothing varies.
    """
    a, b, mixed = rows[:, 0], rows[:, 1], rows[:, 2:].T
    first = np.array([_share(b, b, one) for one in mixed])
    total = np.array([1.0 - _share(b, a, one) for one in mixed])
    return first, total


def _share(base: Array, x: Array, y: Array) -> float:
    """Return (mean of x y - f0^2) / V with f0 and V of the runs of one base matrix."""
    whole = ~np.isnan(x) & ~np.isnan(y)
    if not whole.any() or not np.any(~np.isnan(base)) or not np.nanvar(base) > 0.0:
        return float("nan")
    return float((np.mean(x[whole] * y[whole]) - np.nanmean(base) ** 2) / np.nanvar(base))
