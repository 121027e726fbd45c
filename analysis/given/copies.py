"""Which rows of a table are copies of others, and which are equal because they have few values.

A run that stands in a table twice tells nothing new. Two runs that were drawn at the same point do:
how often a point was drawn is what its distribution is. Rows alone tell the two apart: copies are
far more than chance makes of values that are as frequent as these, or every row stands there as
often as every other.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.stats import poisson

from analysis.given.spread import joined

Array = NDArray[np.float64]

#: Of a column with more than this share of values that stand there once, no two rows are equal by
#: chance; with a smaller share of values of its own, it may depend on another.
_HARDLY = 0.5
#: Equal rows are copies if they are so many times what chance makes: dependence that no rank
#: correlation shows makes a little more. And beyond what so rare a chance makes.
_TIMES, _RARE = 3.0, 1e-4
#: So many points drawn independently stand there all an even number of times once in 16 000.
_FEWEST_POINTS = 14


def without_copies(x: Array, y: Array) -> NDArray[np.intp]:
    """Return the rows of a table without copies, in order (Good 1953; module docstring).

    Args:
        x, y: factors and outputs, shape (rows, factors) and (rows, outputs); nan where a cell is
            empty. Rows without all factors are kept: that they are left out is said elsewhere.
    """
    rows = np.arange(len(x))
    there = np.asarray(~np.isnan(x).any(axis=1), dtype=np.bool_)
    if not there.any():
        return rows
    x, y = x[there], y[there]
    row = _codes(np.column_stack([x, y]))
    count = np.bincount(row)
    if len(count) == len(x):
        return rows
    kept, times = there.copy(), int(np.gcd.reduce(count))
    if times > 1 and len(count) >= _FEWEST_POINTS:
        kept[there] = _which(row) < (count // times)[row]
    elif _beyond_chance(x, y, count):
        kept[there] = _which(row) == 0
    return rows[kept | ~there]


def _beyond_chance(x: Array, y: Array, count: NDArray[np.intp]) -> bool:
    """Say whether more pairs of rows are equal than of rows that were drawn independently.

    An output that the factors determine is the same at the same point. Any other is by chance only
    if it has few values.

    Args:
        count: how often each row stands there.
    """
    point = _codes(x)
    noisy = [one for one in y.T if _codes(np.column_stack([point, one])).max() > point.max()]
    if any(_hardly_repeats(column) for column in (*x.T, *noisy)):
        return True
    codes = np.column_stack([_codes(column[:, None]) for column in x.T])
    # A column with a value for every row repeats it where the row is repeated, and so do others.
    few = codes.max(axis=0) < _HARDLY * len(count)
    group = np.arange(len(few))
    group[few] = len(few) + joined(codes[:, few]) if few.any() else group[few]
    every = 0.5 * len(x) * (len(x) - 1.0)
    chance = every
    for one in np.unique(group):
        chance *= _pairs(np.bincount(_codes(codes[:, group == one]))) / every
    return _pairs(count) > float(poisson.isf(_RARE, _TIMES * chance))


def _hardly_repeats(column: Array) -> bool:
    """Say whether most values of a column stand there once, so that another row has a new one.

    (Good 1953, The population frequencies of species and the estimation of population parameters.)
    """
    _, count = np.unique(column, return_counts=True)
    return bool((count == 1).sum() > _HARDLY * len(count))


def _pairs(count: NDArray[np.intp]) -> float:
    """Return how many pairs of rows are equal, from how often each value stands there."""
    return float((count * (count - 1.0)).sum() / 2.0)


def _codes(table: Array | NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the number of each row of a table among those that differ."""
    # No number is infinite here, and empty cells are equal.
    filled = np.where(np.isnan(table), np.inf, table)
    found: NDArray[np.intp] = np.unique(filled, axis=0, return_inverse=True)[1].reshape(-1)
    return found


def _which(code: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return how many rows before each have the same code."""
    order = np.argsort(code, kind="stable")
    start = np.flatnonzero(np.r_[True, np.diff(code[order]) > 0])
    size = np.diff(np.r_[start, len(code)])
    found = np.empty(len(code), dtype=np.intp)
    found[order] = np.arange(len(code)) - np.repeat(start, size)
    return found
