"""Whether rows lie in clusters, however these are ordered and whether or not they overlap.

Rows that were drawn around others tell less than as many independent ones. They have more rows
close by than rows have whose factors are dealt anew (Ripley 1977, Modelling spatial patterns).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import pdist
from scipy.stats import norm, rankdata

Array = NDArray[np.float64]

#: How likely rows are said to lie in clusters that were drawn independently.
_BY_CHANCE = 1e-3
#: Rows close by beyond one's own from which intervals are a fifth too narrow or more: 1.25 squared.
_LEAST = 0.5625
#: Rows and factors that are looked at, and how often factors are dealt anew.
_MOST_ROWS, _MOST_FACTORS, _DEALS = 1000, 30, 20


def as_few_as(x: Array, depending: Sequence[tuple[int, int]] = ()) -> float | None:
    """Return as how many independent rows clustered ones tell; None if they are not clustered.

    Of n rows in clusters of m it is n / m (Kish 1965, Survey sampling, section 5.4).

    Args:
        x: shape (rows, factors), in no order.
        depending: pairs of factors that depend on each other, which are dealt together.
    """
    looked = x[:_MOST_ROWS, :_MOST_FACTORS]
    factors = looked.shape[1]
    pairs = np.array([p for p in depending if max(p) < factors], dtype=np.intp).reshape(-1, 2)
    near = csr_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(factors,) * 2)
    groups, group = connected_components(near, directed=False)
    if groups < 2:
        return None
    place = np.apply_along_axis(rankdata, 0, looked) / len(looked)
    rng = np.random.default_rng(0)
    dealt = []
    for _ in range(_DEALS):
        anew = place.copy()
        for one in range(groups):
            anew[:, group == one] = rng.permutation(place[:, group == one])
        dealt.append(pdist(anew))
    # So near that a row dealt anew has one other there.
    radius = np.partition(dealt[0], len(place) // 2)[len(place) // 2]
    by_chance = np.array([2.0 * np.sum(one <= radius) / len(place) for one in dealt])
    beyond = 2.0 * np.sum(pdist(place) <= radius) / len(place) - by_chance.mean()
    if beyond < max(_LEAST, float(norm.isf(_BY_CHANCE)) * by_chance.std(ddof=1)):
        return None
    return float(len(x) / (1.0 + beyond * len(x) / len(place)))


def clustered(x: Array, depending: Sequence[tuple[int, int]] = ()) -> list[str]:
    """Return the remark on rows that lie in clusters (Kish 1965), if they do; as `as_few_as`."""
    rows = as_few_as(x, depending)
    if rows is None:
        return []
    return [
        "Rows lie in clusters: there are more close by each than if its factors had been drawn "
        f"independently. They tell about as much as {rows:.0f} rows of {len(x):,} would, or fewer: "
        "intervals are too narrow, and p-values too small. Or three factors or more depend on each "
        "other, as sums do on their terms."
    ]
