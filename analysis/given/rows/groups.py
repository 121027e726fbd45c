"""Values that several factors repeat together, so that fewer points were drawn than there are rows.

Each of some settings beside each of some others, as a crossed or nested experiment has them, or a
design that moves groups of factors (Saltelli et al. 2008, Global sensitivity analysis: the primer,
section 4.7), gives rows that differ in several factors and share the others: no draws of their own
(Hurlbert 1984, Pseudoreplication and the design of ecological field experiments).
"""

from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.stats import poisson

from analysis.given.rows.copies import FEWEST_POINTS, numbered
from analysis.given.rows.spread import joined

Array = NDArray[np.float64]

#: Factors of fewer values are levels, of which the answer says so; more factors are not looked at.
_FEWEST_VALUES, _MOST_FACTORS = 10, 30
#: Share of the rows that have both values of another row, at least; how many times what chance
#: makes their pairs are, and beyond what so rare a chance makes of that in a table.
_SHARE, _TIMES, _RARE = 0.25, 3.0, 1e-4


def together(x: Array) -> list[list[int]]:
    """Return groups of factors whose values repeat together far more often than by chance.

    Those that depend on each other, as a length in mm and in inches does, are left out: rounded,
    they repeat together where every row was drawn.

    Args:
        x: shape (rows, factors).

    Returns:
        The factors of each group, two or more.
    """
    levels = np.column_stack([numbered(column[:, None]) for column in x.T])
    values = levels.max(axis=0) + 1
    looked = np.flatnonzero((values > _FEWEST_VALUES) & (values < len(x)))[:_MOST_FACTORS]
    pairs = list(combinations(looked.tolist(), 2))
    found = [pair for pair in pairs if _repeat(levels[:, pair], _RARE / len(pairs))]
    if not found:
        return []
    one, other = np.transpose(found)
    near = csr_array((np.ones(len(found)), (one, other)), shape=(x.shape[1],) * 2)
    group = connected_components(near, directed=False)[1]
    members = [np.flatnonzero(group == g).tolist() for g in range(group.max() + 1)]
    return [one for one in members if len(one) > 1]


def _repeat(levels: NDArray[np.intp], rare: float) -> bool:
    """Say whether values of two factors repeat together beyond chance (Good 1953).

    Args:
        levels: the number of each row's values, shape (rows, 2).
        rare: how likely chance makes so many pairs of rows.
    """
    both = levels @ [1, levels[:, 0].max() + 1]
    count = np.unique(both, return_counts=True)[1]
    repeated = count[count > 1]
    # A value that many rows have, as a rain gauge's zero, makes one pair of values.
    if len(repeated) < FEWEST_POINTS or repeated.sum() < _SHARE * len(levels):
        return False
    every = 0.5 * len(levels) * (len(levels) - 1.0)
    chance = every * float(np.prod([_pairs(np.bincount(one)) / every for one in levels.T]))
    if _pairs(count) <= float(poisson.isf(rare, _TIMES * chance)):
        return False
    once = np.unique(both, return_index=True)[1]
    return int(joined(levels[once]).max()) > 0


def _pairs(count: NDArray[np.intp]) -> float:
    return float((count * (count - 1.0)).sum() / 2.0)


def in_trajectories(x: Array) -> int:
    """Return how many rows a walk has that moves every factor once, as one of groups; or 0.

    (Morris 1991, Factorial sampling plans for preliminary computational experiments, with groups:
    Campolongo, Cariboni and Saltelli 2007.) Of two rows all factors of any sample may change.

    Args:
        x: shape (rows, factors), in the order of the file.
    """
    rows, factors = x.shape
    moved = x[1:] != x[:-1]
    for width in range(3, factors + 1):
        if rows % width or rows // width < FEWEST_POINTS:
            continue
        within = np.append(moved, np.zeros((1, factors), dtype=np.bool_), axis=0)
        steps = within.reshape(-1, width, factors)[:, :-1]
        if (steps.sum(axis=1) == 1).all():
            return width
    return 0
