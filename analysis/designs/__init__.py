"""Which points a study evaluates.

A study is made of rows: small groups of points whose outputs belong together. Row r is a pure
function of (method, sampling, seed, r), so a study can be extended, sharded, or rebuilt without
storing a point. Rows are those of Campolongo et al. 2011 (`radial`), of Saltelli et al. 2010, or of
Saltelli 2002 for pairs of factors (`saltelli`), or orders of the factors as Song et al. 2016 need
them (`shapley`), or single points (`surrogate`, `sample`), mapped to the factors' distributions by
their quantiles (Devroye 1986, Non-uniform random variate generation, section II.2).
"""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from analysis.designs.blocks import BLOCKS, IN_TURN, blocks_of
from analysis.designs.dependence import dependent
from analysis.designs.distributions import Distribution
from analysis.designs.groups import Units, places_of
from analysis.designs.points import (
    latin_hypercube,
    owen_blocks,
    paired,
    points,
    sobol,
    sobol_blocks,
)
from analysis.designs.radial import radial_row
from analysis.designs.saltelli import saltelli_row
from analysis.designs.shapley import shapley_orders, shapley_row
from analysis.designs.trajectories import TRAJECTORIES, grouped_row, trajectory_row

#: Elementary effects for screening; variance-based indices; these with those of pairs of factors;
#: Shapley effects, the only ones of factors that depend on each other; variance-based indices by a
#: function that is fitted to single points (`analysis.sensitivity.fewer_runs`); and single points
#: for their own sake, which say how outputs spread.
METHODS = ("morris", "saltelli", "saltelli_second_order", "shapley", "surrogate", "sample")
#: Of these, those whose rows are single points, those whose factors may depend on each other, and
#: those that have indices while results arrive.
SINGLE_POINTS = ("surrogate", "sample")
DEPENDENT = ("shapley", "sample")
WITH_INDICES = tuple(method for method in METHODS if method != "sample")
#: Where base points come from: eight Sobol sequences scrambled independently, by nested scrambles
#: or linear ones; one Sobol sequence; the same with the two coordinates that a factor has in a row
#: taken from neighbouring dimensions; Latin hypercubes, as in the paper.
SAMPLINGS = ("owen_blocks", "sobol_blocks", "sobol", "sobol_paired", "latin_hypercube")
#: Its intervals hold the truth as often as they say (`docs/measurements/indices.md`).
DEFAULT_SAMPLING = "owen_blocks"

_POINTS = {
    "owen_blocks": owen_blocks,
    "sobol_blocks": sobol_blocks,
    "sobol": sobol,
    "sobol_paired": sobol,
    "latin_hypercube": latin_hypercube,
}
#: Orders of the factors that are made, and kept, at a time: of as many rows as points are.
_ORDERS_AT_ONCE = 1024
#: Of these, a factor's two coordinates in a row are neighbours.
_PAIRED = (*IN_TURN, "sobol_paired")

__all__ = [
    "BLOCKS",
    "DEFAULT_SAMPLING",
    "DEPENDENT",
    "METHODS",
    "SAMPLINGS",
    "SINGLE_POINTS",
    "TRAJECTORIES",
    "WITH_INDICES",
    "blocks_of",
    "family",
    "fewest_factors",
    "instance_parameters",
    "orders_of",
    "row_width",
    "samplings",
    "unit_row",
    "unit_rows",
]


def samplings(method: str) -> tuple[str, ...]:
    """Return the samplings of a method: `SAMPLINGS`, and `TRAJECTORIES` (Morris 1991) of morris."""
    return (*SAMPLINGS, *TRAJECTORIES) if method == "morris" else SAMPLINGS


def family(method: str) -> str:
    """Return "morris", "saltelli" or "shapley": whose indices of single factors a method has.

    Rows of saltelli and saltelli_second_order begin with A, B and A_B^(i) (Saltelli et al. 2010).
    Indices of single points are those of saltelli, as far as they are known.
    """
    return method if method in ("morris", "shapley") else "saltelli"


def fewest_factors(method: str) -> int:
    """Return how many factors a method must vary: 2 if it looks at pairs (Saltelli 2002)."""
    return 2 if method in ("saltelli_second_order", "shapley") else 1


def row_width(method: str, factors: int) -> int:
    """Return how many points a row has: Campolongo et al. 2011; Saltelli 2002, theorems 1 and 2.

    Raises:
        ValueError: the method is unknown, or fewer factors vary than it needs.
    """
    _check(method, DEFAULT_SAMPLING)
    if factors < fewest_factors(method):
        least = "two factors" if fewest_factors(method) == 2 else "one factor"
        raise ValueError(f"a study of method {method} must vary at least {least}")
    if method in SINGLE_POINTS:
        return 1
    beside = {"morris": 1, "saltelli": 2, "saltelli_second_order": 2 + factors, "shapley": 3}
    return beside[method] + factors


def orders_of(sampling: str, seed: int, rows: Sequence[int], factors: int) -> NDArray[np.intp]:
    """Return the order of the factors in rows of method shapley (Song et al. 2016).

    Shape (rows, factors).
    """
    part, offset = np.divmod(np.asarray(rows, dtype=np.int64), _ORDERS_AT_ONCE)
    parts, place = np.unique(part, return_inverse=True)
    made = np.stack([_orders(sampling, seed, one, factors) for one in parts.tolist()])
    found: NDArray[np.intp] = made[place, offset]
    return found


@lru_cache(maxsize=64)
def _orders(sampling: str, seed: int, part: int, factors: int) -> NDArray[np.intp]:
    """Return the orders of `_ORDERS_AT_ONCE` rows: made with the design, needed with its results.

    (Opening a stream of random bits for each row takes longer than all else that is done to it.)
    """
    rows = range(part * _ORDERS_AT_ONCE, (part + 1) * _ORDERS_AT_ONCE)
    ends = points(sampling, seed, rows, 2 * factors + 2)[:, 2 * factors :]
    return shapley_orders(seed, rows, ends, factors)


def unit_row(
    method: str,
    sampling: str,
    seed: int,
    row: int,
    factors: int,
    correlation: NDArray[np.float64] | None = None,
    units: Units | None = None,
) -> NDArray[np.float64]:
    """Return the points of a row in the unit cube (Campolongo et al. 2011; Saltelli et al. 2010).

    Args:
        correlation: of the normals behind the factors, from `analysis.designs.dependence.copula`;
            None: they are independent.
        units: factors that move together (`analysis.designs.groups`); None: each by itself.

    Returns:
        Shape (row_width(method, units), factors), every value strictly between 0 and 1.

    Raises:
        ValueError: method or sampling is unknown, nothing varies, `row` is negative, `seed` is no
            unsigned 64 bit integer, the method knows independent factors or no groups, or groups of
            morris are not to move along trajectories.
    """
    _check(method, sampling)
    row_width(method, factors if units is None else len(units))
    if units is not None and method == "morris" and sampling not in TRAJECTORIES:
        raise ValueError(
            "groups of morris move along trajectories: choose sampling random_trajectories"
        )
    if not 0 <= seed < 2**64:
        raise ValueError(f"seed must be an integer from 0 to 2**64 - 1, not {seed}")
    if row < 0:
        raise ValueError(f"row must not be negative, but is {row}")
    if sampling in TRAJECTORIES:
        if units is not None:
            return grouped_row(sampling, seed, row, factors, units)
        return trajectory_row(sampling, seed, row, factors)
    if units is not None and method in ("shapley", *SINGLE_POINTS):
        raise ValueError(f"{method} shares the variance among single factors, not groups")
    if correlation is not None and method not in DEPENDENT:
        raise ValueError(
            f"{method} samples factors independently of each other: take {' or '.join(DEPENDENT)}"
        )
    if method in SINGLE_POINTS:
        single = _POINTS[sampling](seed, row, factors)[None]
        return single if correlation is None else dependent(single, correlation, range(factors))
    point = _point(sampling, seed, row, factors, 2 if method == "shapley" else 0)[: 2 * factors]
    if method == "shapley":
        order = orders_of(sampling, seed, [row], factors)[0].tolist()
        found = shapley_row(point, order)
        return found if correlation is None else dependent(found, correlation, order)
    if method == "morris":
        return radial_row(point)
    return saltelli_row(point, second_order=method == "saltelli_second_order", units=units)


def unit_rows(
    method: str, sampling: str, seed: int, rows: Sequence[int], factors: int
) -> NDArray[np.float64]:
    """Return `unit_row` of many rows of independent factors, shape (rows, width, factors).

    As Campolongo et al. 2011 and Saltelli et al. 2010 have them; ValueError as `unit_row`.
    """
    if method != "morris" or sampling not in SAMPLINGS or not len(rows):
        each = [unit_row(method, sampling, seed, row, factors) for row in rows]
        return np.stack(each) if each else np.empty((0, row_width(method, factors), factors))
    # Those of all rows at once, which screening needs again with every batch of results.
    unit_row(method, sampling, seed, min(rows), factors)
    found = points(sampling, seed, rows, 2 * factors)
    return radial_row(paired(found) if sampling in _PAIRED else found)


def instance_parameters(
    method: str,
    sampling: str,
    seed: int,
    row: int,
    distributions: Mapping[str, Distribution],
    correlation: NDArray[np.float64] | None = None,
    groups: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> list[dict[str, float]]:
    """Return the factor values of every point of a row, in position order, in the factors' units.

    By their quantiles (Devroye 1986, section II.2). The order of `distributions` decides which
    coordinate is whose; factors of one of `groups` move together. `correlation` and ValueError as
    in `unit_row`.
    """
    units = places_of(list(distributions), groups) if groups else None
    unit = unit_row(method, sampling, seed, row, len(distributions), correlation, units)
    columns = [
        # Not `ppf`: that these lie between 0 and 1 need not be looked at.
        distribution.quantiles(unit[:, i]).tolist()
        for i, distribution in enumerate(distributions.values())
    ]
    return [dict(zip(distributions, values, strict=True)) for values in zip(*columns, strict=True)]


def _point(sampling: str, seed: int, row: int, factors: int, more: int) -> NDArray[np.float64]:
    """Return a row's point: two coordinates of every factor, and `more` behind them."""
    point = _POINTS[sampling](seed, row, 2 * factors + more)
    if sampling in _PAIRED:
        return np.concatenate([paired(point[: 2 * factors]), point[2 * factors :]])
    return point


def _check(method: str, sampling: str) -> None:
    if method not in METHODS:
        raise ValueError(f"unknown method {method!r}: expected one of {', '.join(METHODS)}")
    if sampling not in samplings(method):
        expected = ", ".join(samplings(method))
        raise ValueError(f"unknown sampling {sampling!r} of {method}: expected one of {expected}")
