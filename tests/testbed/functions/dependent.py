"""Functions of three factors that depend on each other, and what knowing factors explains."""

from collections.abc import Callable, Sequence
from itertools import combinations
from math import factorial
from typing import Any

import numpy as np
from scipy.special import ndtr

#: The variance that knowing some of three factors explains.
Values = Callable[[Sequence[int]], float]


def effects(known: Values, k: int = 3) -> list[float]:
    """Return Shapley values (Shapley 1953) of the variance that knowing factors explains."""
    found = []
    for i in range(k):
        others = [j for j in range(k) if j != i]
        found.append(
            sum(
                factorial(size)
                * factorial(k - size - 1)
                / factorial(k)
                * (known([*group, i]) - known(group))
                for size in range(k)
                for group in combinations(others, size)
            )
        )
    return found


def truths(known: Values, k: int = 3) -> dict[str, Any]:
    """Return effects, full first order and independent total order, as shares."""
    whole = known(range(k))
    return {
        "shapley": np.array(effects(known, k)) / whole,
        "full_first_order": np.array([known([i]) for i in range(k)]) / whole,
        "independent_total_order": np.array(
            [whole - known([j for j in range(k) if j != i]) for i in range(k)]
        )
        / whole,
    }


def linear(weights: Any, correlation: Any) -> Values:
    """Return what knowing factors of a linear model of correlated normals explains.

    By the normal's conditional covariance (Anderson 2003, theorem 2.5.1), as Owen and Prieur 2017.
    """
    whole = weights @ correlation @ weights

    def known(group: Sequence[int]) -> float:
        inside = list(group)
        rest = [j for j in range(len(weights)) if j not in inside]
        if not inside or not rest:
            return float(whole) if inside else 0.0
        cross = correlation[np.ix_(rest, inside)]
        own = correlation[np.ix_(inside, inside)]
        left = correlation[np.ix_(rest, rest)] - cross @ np.linalg.solve(own, cross.T)
        return float(whole - weights[rest] @ left @ weights[rest])

    return known


def ishigami(u: Any) -> Any:
    x = (2.0 * u - 1.0) * np.pi
    return (
        np.sin(x[..., 0]) + 7.0 * np.sin(x[..., 1]) ** 2 + 0.1 * x[..., 2] ** 4 * np.sin(x[..., 0])
    )


def ishigami_of_dependent(r: float) -> Values:
    """Return the same of Ishigami's function whose first and third factor's normals have `r`.

    Integrals of Kucherenko, Tarantola and Annoni 2012 (section 5.2), by quadrature.
    """
    node, weight = np.polynomial.hermite_e.hermegauss(80)
    weight = weight / weight.sum()
    given = np.repeat(node[:, None], len(node), axis=1)
    other = r * given + np.sqrt(1.0 - r * r) * node

    def angle(normal: Any) -> Any:
        return (2.0 * ndtr(normal) - 1.0) * np.pi

    def share(first: Any, third: Any) -> Any:
        return np.sin(first) * (1.0 + 0.1 * third**4)

    joint = share(angle(given), angle(other))
    mean = weight @ joint @ weight
    pair = weight @ joint**2 @ weight - mean**2
    first = weight @ (joint @ weight) ** 2 - mean**2
    third = weight @ (share(angle(other), angle(given)) @ weight) ** 2 - mean**2
    alone = {(): 0.0, (0,): first, (2,): third, (0, 2): pair}
    second = 49.0 / 8.0

    def known(group: Sequence[int]) -> float:
        inside = set(group)
        return float(alone[tuple(sorted(inside - {1}))] + (second if 1 in inside else 0.0))

    return known
