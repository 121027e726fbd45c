"""Which rows of a table are copies of others, and which are equal because they have few values.

A run that stands in a table twice tells nothing new. Two runs that were drawn at the same point do:
how often a point was drawn is what its distribution is. Rows alone tell the two apart: copies are
far more than chance makes of values that are as frequent as these, or every row stands there as
often as every other (Good 1953, The population frequencies of species and the estimation of
population parameters).
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.stats import poisson

from analysis.given.rows.spread import joined

#: Fewer rows tell nothing that its interval would not take back.
FEWEST_ROWS = 64

Array = NDArray[np.float64]

#: Of a column with more than this share of values that stand there once, no two rows are equal by
#: chance; with a smaller share of values of its own, it may depend on another.
_HARDLY = 0.5
#: Equal rows are copies if they are so many times what chance makes: dependence that no rank
#: correlation shows makes a little more. And beyond what so rare a chance makes.
_TIMES, _RARE = 3.0, 1e-4
#: So many points drawn independently stand there all an even number of times once in 16 000.
FEWEST_POINTS = 14


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
    row = numbered(np.column_stack([x, y]))
    count = np.bincount(row)
    if len(count) == len(x):
        return rows
    kept, times, again = there.copy(), int(np.gcd.reduce(count)), earlier(row) > 0
    if times > 1 and len(count) >= FEWEST_POINTS and not _balanced(x, count):
        kept[there] = earlier(row) < (count // times)[row]
        return rows[kept | ~there]
    point = numbered(x)
    noisy = [one for one in y.T if numbered(np.column_stack([point, one])).max() > point.max()]
    copy = again & _has_its_own((*x.T, *noisy), row)
    # Noise of few values, as of an event, repeats at a point that is repeated.
    few = [len(np.unique(one)) < _HARDLY * len(count) for one in noisy]
    if not (few and all(few)) and _more_than_drawn(x[~copy], np.bincount(row[~copy])):
        copy = again
    kept[there] = ~copy
    return rows[kept | ~there]


def _balanced(x: Array, count: NDArray[np.intp]) -> bool:
    """Say whether rows are all combinations of few values, each as often as any other.

    As four switches from Sobol's sequence: once each, they are too few to tell anything.

    Args:
        x: factors, shape (rows, factors).
        count: how often each different row stands there.
    """
    values = [len(np.unique(column)) for column in x.T]
    all_alike = len(count) == int(np.prod(values)) and count.min() == count.max()
    return all_alike and len(count) < FEWEST_ROWS


def _has_its_own(columns: Iterable[Array], row: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return which rows have a value that none but their equals have, where values hardly repeat.

    A value that many rows have may be one of those that do: a rain gauge's zero.

    Args:
        columns: factors, and the outputs that these do not determine: what they do is the same at
            the same point, however seldom a value repeats.
        row: the number of each row among those that differ.
    """
    equals = np.bincount(row)[row]
    found = np.zeros(len(row), dtype=np.bool_)
    for column in columns:
        if _hardly_repeats(column):
            code = numbered(column[:, None])
            found |= np.bincount(code)[code] == equals
    return found


def _more_than_drawn(x: Array, count: NDArray[np.intp]) -> bool:
    """Say whether more pairs of rows are equal than of rows that were drawn independently.

    Args:
        count: how often each row stands there; others may stand there never.
    """
    levels = np.column_stack([numbered(column[:, None]) for column in x.T])
    # A column with a value for every row repeats it where the row is repeated, and so do others.
    few = levels.max(axis=0) < _HARDLY * np.count_nonzero(count)
    group = np.arange(len(few))
    group[few] = len(few) + joined(levels[:, few]) if few.any() else group[few]
    return beyond_chance(levels, count, group)


def beyond_chance(
    levels: NDArray[np.intp], count: NDArray[np.intp], group: NDArray[np.intp]
) -> bool:
    """Say whether more pairs of rows are equal than chance makes of values as frequent as these.

    Args:
        levels: the number of each row's value, shape (rows, factors).
        count: how often each different row stands there.
        group: of each factor; those of one may depend on each other.
    """
    every = 0.5 * len(levels) * (len(levels) - 1.0)
    chance = every
    for one in np.unique(group):
        chance *= _pairs(np.bincount(numbered(levels[:, group == one]))) / every
    return _pairs(count) > float(poisson.isf(_RARE, _TIMES * chance))


def _hardly_repeats(column: Array) -> bool:
    """Say whether most values of a column stand there once, so that another row has a new one.

    (Good 1953.)
    """
    _, count = np.unique(column, return_counts=True)
    return bool((count == 1).sum() > _HARDLY * len(count))


def _pairs(count: NDArray[np.intp]) -> float:
    """Return how many pairs of rows are equal, from how often each value stands there."""
    return float((count * (count - 1.0)).sum() / 2.0)


def numbered(table: Array | NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the number of each row of a table among those that differ."""
    # No number is infinite here, and empty cells are equal.
    filled = np.where(np.isnan(table), np.inf, table)
    found: NDArray[np.intp] = np.unique(filled, axis=0, return_inverse=True)[1].reshape(-1)
    return found


def earlier(code: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return how many rows before each have the same number."""
    order = np.argsort(code, kind="stable")
    start = np.flatnonzero(np.r_[True, np.diff(code[order]) > 0])
    size = np.diff(np.r_[start, len(code)])
    found = np.empty(len(code), dtype=np.intp)
    found[order] = np.arange(len(code)) - np.repeat(start, size)
    return found
