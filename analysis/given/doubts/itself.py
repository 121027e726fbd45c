"""Whether the output stands among the factors too, exactly, or rounded, in grades or with noise.

A column of which the output hardly tells more may be a factor that does all. But where it depends
on two factors that are independent of each other, it is computed of them, as the output is: what
two independent causes make depends on both (Pearl 2009, Causality, section 2.6). Order is told by
pairs of rows, since grades and a monotone function leave it (Goodman and Kruskal 1954, Measures of
association for cross classifications).
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc
from scipy.stats import kendalltau, rankdata

from analysis.given.doubts.left_over import by_themselves, functions_of

Array = NDArray[np.float64]

#: What the correlation of two columns of the same lacks that are rounded to three digits of what
#: they vary by: half of 0.001 squared.
_SAME = 0.5e-6
#: Share of the pairs of rows that are in order, from which a column may be the output again.
_IN_ORDER = 0.9
#: How likely a factor of a table is taken to go with another that it has nothing to do with.
_BY_CHANCE = 1e-3
#: Rows that are looked at.
_MOST_ROWS = 1000


def itself(
    output: str,
    y: Array,
    factors: Sequence[str],
    x: Array,
    depending: Sequence[tuple[int, int]] | None = None,
) -> list[str]:
    """Say which factor is the output but for its unit and what rounding does, as nothing else is.

    Or a function of it that only rises or falls: then no row is out of order. Or nearly so, and
    computed of other factors.

    Args:
        output, factors: names.
        y: shape (rows,).
        x: shape (rows, factors), in no order.
        depending: pairs of factors that depend on each other; None: rows are not drawn
            independently, and nothing can be told of that.
    """
    if len(factors) < 2 or np.ptp(y) == 0.0:
        return []
    varies = np.flatnonzero(np.ptp(x, axis=0) > 0.0).tolist()
    found, order = [], np.argsort(y, kind="stable")
    apart = len(np.unique(y)) == len(y)
    for f in varies:
        steps = np.diff(x[order, f])
        if 1.0 - abs(np.corrcoef(x[:, f], y)[0, 1]) < _SAME:
            found.append(
                f"{output} is a straight line of {factors[f]}, to three digits of what it varies "
                "by or more. If that is the output again, in another unit, leave it out: name the "
                "factors (--factor)."
            )
        elif apart and (np.all(steps > 0.0) or np.all(steps < 0.0)):
            found.append(
                f"{output} {'rises' if steps[0] > 0.0 else 'falls'} with {factors[f]} from row to "
                "row without one exception, whatever other factors do. If that is the output "
                "again, as its logarithm is, leave it out: name the factors (--factor)."
            )
        elif depending is not None:
            few = x[:_MOST_ROWS]
            found.append(_nearly(output, y[:_MOST_ROWS], factors, few, f, depending))
    return [said for said in found if said]


def _nearly(
    output: str,
    y: Array,
    factors: Sequence[str],
    x: Array,
    column: int,
    depending: Sequence[tuple[int, int]],
) -> str:
    """Return the remark on a column that has the output's order and goes with its factors."""
    in_order = _in_order(x[:, column], y)
    if in_order < _IN_ORDER:
        return ""
    rest = [f for f in range(len(factors)) if f != column]
    causes = [rest[at] for at in _going_with(x[:, rest], x[:, column])]
    apart = [pair for pair in combinations(causes, 2) if pair not in depending]
    if not apart:
        return ""
    one, other = (factors[f] for f in apart[0])
    return (
        f"{in_order:.1%} of all pairs of rows have {output} in the order of {factors[column]}, "
        f"which goes with {one} and {other} as well, though these do not go with each other: it "
        "is computed of them. If it is the output again, rounded, in grades or measured anew, or "
        "what the output is made of, leave it out: name the factors (--factor)."
    )


def _in_order(x: Array, y: Array) -> float:
    """Return the share of the pairs of rows, of those that differ in both, that are in one order.

    (Goodman and Kruskal 1954, by Kendall's tau, which counts pairs that differ in one.)
    """
    every = len(y) * (len(y) - 1.0) / 2.0
    x_equal, y_equal, equal = (_equal(one) for one in (x[:, None], y[:, None], np.c_[x, y]))
    differ = every - x_equal - y_equal + equal
    if differ <= 0.0:
        return 0.0
    tau = float(kendalltau(x, y).statistic)
    gamma = tau * float(np.sqrt((every - x_equal) * (every - y_equal))) / differ
    return (1.0 + abs(gamma)) / 2.0


def _equal(table: Array) -> float:
    """Return how many pairs of rows are equal."""
    count = np.unique(table, axis=0, return_counts=True)[1].astype(np.float64)
    return float((count * (count - 1.0)).sum() / 2.0)


def _going_with(x: Array, y: Array) -> list[int]:
    """Return the factors without which functions of all tell surely less of a column's ranks.

    (Fisher's F of each; ranks have no tail.)
    """
    rank = rankdata(y)
    width = [one.shape[1] for one in functions_of(x)]
    free = len(y) - 1.0 - sum(width)
    left = _left(x, rank)
    found = []
    for f, own in enumerate(width):
        more = _left(np.delete(x, f, axis=1), rank) - left
        ratio = more / own * free / max(left, np.finfo(float).tiny)
        if own and fdtrc(own, free, ratio) < _BY_CHANCE / len(width):
            found.append(f)
    return found


def _left(x: Array, y: Array) -> float:
    """Return the sum of squares that functions of factors leave of a column."""
    told = by_themselves(x, y).sum(axis=1) if x.shape[1] else np.zeros(len(y))
    return float(np.sum((y - y.mean() - told) ** 2))
