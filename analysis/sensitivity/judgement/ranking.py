"""How far a ranking of factors can be relied on: would another sample have given the same one?

There one looks at 300 bootstrap replicates of the mu*-sigma plane by eye (paper, figure 8). Here it
is a number: the share of bootstrap replicates that rank the factors as the sample does.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: By method, the index that ranks.
RANKED_BY = {"morris": "mu_star", "saltelli": "total_order", "shapley": "shapley"}


@dataclass(frozen=True, kw_only=True)
class Ranking:
    """Factors by influence, and how often replicates agree."""

    #: The most influential first.
    order: tuple[str, ...]
    #: Share of the replicates with the same order from first to last.
    same_order: float
    #: Share of the replicates with the same first factor.
    same_first: float


def rank(weighted: NDArray[np.float64], names: Sequence[str]) -> Ranking | None:
    """Rank factors by an index.

    Args:
        weighted: shape (1 + replicates, factors), the sample itself first.
        names: of the factors.

    Returns:
        None while an index is undefined, or in most replicates.
    """
    known = ~np.any(np.isnan(weighted), axis=1)
    if not known[0] or known[1:].mean() < 0.5:
        return None
    orders = np.argsort(-weighted[known], axis=1, kind="stable")
    same = np.asarray(orders[1:] == orders[0], dtype=np.bool_)
    return Ranking(
        order=tuple(names[place] for place in orders[0]),
        same_order=float(same.all(axis=1).mean()),
        same_first=float(same[:, 0].mean()),
    )
