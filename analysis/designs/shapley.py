"""Rows that let factors go one after the other: Shapley effects, full and independent indices.

In an order of the factors drawn for each row, point j keeps what A has of the first j factors and
has of the others what B has of them, given the first (Rosenblatt 1952). So the pairs A and point j
share j factors and nothing else, which is what the conditional variances of Song, Nelson and Staum
2016 (Shapley effects for global sensitivity analysis, algorithm 1) are made of, with one outer and
two inner points, of which all orders' share A. Going through the factors one after the other is
Goda 2021 (A simple algorithm for global sensitivity analysis with Shapley effects), there for
independent factors. The first and the last factor of an order have, with two points more, the full
and the independent indices of Mara and Tarantola 2012 (Variance-based sensitivity indices for
models with dependent inputs).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.designs.streams import Purpose, bits_of


def shapley_orders(
    seed: int, rows: Sequence[int], ends: NDArray[np.float64], factors: int
) -> NDArray[np.intp]:
    """Return the order of the factors in rows (Song et al. 2016), each equally likely.

    Args:
        ends: two coordinates of each row's point: which factor comes first, and which last. So each
            is first and last equally often, as far as points fill the square evenly.

    Returns:
        Shape (rows, factors).
    """
    between = factors - 2
    words = bits_of(seed, Purpose.ORDER, rows, max(between, 0))
    place = np.minimum((ends * (factors, factors - 1)).astype(np.intp), (factors - 1, between))
    first, last = place[:, :1], place[:, 1:]
    rest = np.arange(factors - 1) + (np.arange(factors - 1) >= first)
    left = np.arange(between) + (np.arange(between) >= last)
    middle = np.take_along_axis(left, np.argsort(words[:, :between], kind="stable"), axis=1)
    after = np.take_along_axis(rest, np.concatenate([middle, last], axis=1), axis=1)
    return np.concatenate([first, after], axis=1)


def shapley_row(point: NDArray[np.float64], order: list[int]) -> NDArray[np.float64]:
    """Lay out one row from a point of the unit cube of twice as many dimensions as factors.

    Position 0 is A and position 1 is B; position 1 + j, from 1 to factors - 1, has the first j
    factors of the order from A and the others from B; the last but one is A with the first factor
    from B, and the last is B with the last factor from A (Mara and Tarantola 2012). Coordinates are
    independent of each other: what they are in factors that are not,
    `analysis.designs.dependence.dependent` makes of them, in the same order.

    Args:
        point: shape (2 k,): A, then B.
        order: of the factors.

    Returns:
        Shape (k + 3, k).
    """
    factors = point.size // 2
    a, b = point[:factors], point[factors:]
    row = np.empty((factors + 3, factors))
    row[0] = a
    row[1:] = b
    for j in range(1, factors):
        row[1 + j, order[:j]] = a[order[:j]]
    row[factors + 1] = a
    row[factors + 1, order[0]] = b[order[0]]
    row[factors + 2, order[-1]] = a[order[-1]]
    return row
