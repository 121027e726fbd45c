"""How far the output's density moves if a factor is known (Borgonovo 2007), all points at once.

SALib gives the same numbers (`tests/unit/analysis/given` compares them), in far longer, and
intervals need them again and again. A density between extremes that are far out has next to no
points where the output is: then it is that of normal scores, of which delta is the same.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import rankdata

from analysis.sensitivity.judgement.trust import ENOUGH_RUNS, HEAVY

Array = NDArray[np.float64]

#: Points of the output at which densities are compared, and classes of a factor at most.
POINTS = 100
#: A share of rows that no density spreads over one value.
MANY_ROWS = 0.1
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


def in_scores(x: Array, y: Array) -> Array:
    """Return the normal scores of an output of which `delta` says too little, or else the output.

    An increasing function of the output leaves delta as it is (Borgonovo 2007), so scores of its
    ranks do (van der Waerden 1952), on which extremes are never far out. They stand for an output
    whose variance few rows make up, one that has a value in many rows, whose density there would be
    as high as no point between the extremes shows, and one of which delta is not told.

    Args:
        x: shape (rows, factors).
        y: shape (rows,).
    """
    heavy = kurtosis(y)
    few = heavy > HEAVY and len(y) / heavy < ENOUGH_RUNS
    same = np.unique(y, return_counts=True)[1].max() >= MANY_ROWS * len(y)
    if np.ptp(y) == 0.0 or not (few or same or np.isnan(delta(x, y)).any()):
        return y
    return np.asarray(ndtri((rankdata(y) - 0.5) / len(y)))


def kurtosis(y: Array) -> float:
    """Return the fourth moment over the square of the variance, 0 of what does not vary."""
    if np.ptp(y) == 0.0:
        return 0.0
    return float(np.mean(((y - y.mean()) / y.std()) ** 4))


def _density(values: Array, grid: Array) -> Array:
    """Return a density at the points of a grid, of a width after Silverman 1986."""
    width = values.std(ddof=1) * (0.75 * len(values)) ** -0.2
    off = (grid[:, None] - values) / width
    density: Array = np.exp(-0.5 * off * off).mean(axis=1) / (np.sqrt(2.0 * np.pi) * width)
    return density
