"""How far the output's density moves if a factor is known (Borgonovo 2007), all points at once.

SALib gives the same numbers (`tests/unit/analysis/given` compares them), in far longer, and
intervals need them again and again.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Points of the output at which densities are compared, and classes of a factor at most.
POINTS = 100
_MOST_CLASSES = 48


def delta(x: Array, y: Array) -> Array:
    """Return Borgonovo's delta, equation 26 of Plischke, Borgonovo and Smith 2013.

    Classes of values that are all the same have no density, and are left out. Where a density is so
    narrow that it lies between points, or upon one, what is found says nothing, and may be above 1,
    which no delta is.

    Args:
        x: shape (rows, factors).
        y: shape (rows,).

    Returns:
        Shape (factors,), nan where it would be above 1.
    """
    rows = len(y)
    # The classes of a factor, of equal size: as many as SALib cuts a sample in.
    power = 2.0 / (7.0 + np.tanh((1500.0 - rows) / 500.0))
    edges = np.linspace(0, rows, min(int(np.ceil(rows**power)), _MOST_CLASSES) + 1)
    ends = np.searchsorted(np.arange(1, rows + 1), edges, side="right")
    grid = np.linspace(y.min(), y.max(), POINTS)
    whole = _density(y, grid)
    found = np.zeros(x.shape[1])
    for i, column in enumerate(x.T):
        ordered = y[np.argsort(column, kind="stable")]
        for start, stop in pairwise(ends.tolist()):
            of_class = ordered[start:stop]
            if len(of_class) and np.ptp(of_class) > 0.0:
                apart = np.trapezoid(np.abs(whole - _density(of_class, grid)), grid)
                found[i] += 0.5 * len(of_class) / rows * apart
    return np.where(found <= 1.0, found, np.nan)


def _density(values: Array, grid: Array) -> Array:
    """Return a density at the points of a grid, of a width after Silverman 1986."""
    width = values.std(ddof=1) * (0.75 * len(values)) ** -0.2
    off = (grid[:, None] - values) / width
    density: Array = np.exp(-0.5 * off * off).mean(axis=1) / (np.sqrt(2.0 * np.pi) * width)
    return density
