"""Classic design for elementary effects: trajectories over a grid of levels (Morris 1991).

Each step moves one factor, all in random order, from a random point of the grid. Those of
`random_trajectories` are drawn independently. For `trajectories`, of many those are kept that lie
far apart (Campolongo, Cariboni and Saltelli 2007; chosen one by one as in Ruano et al. 2012): these
start at outer levels more often, so the effects of factors that interact are those of another
distribution (docs/decisions/0015). Levels are the middles of four equal strata rather than the ends
of three, so that each has a quantile in any distribution.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from analysis.designs.groups import Units
from analysis.designs.streams import Purpose, bits

#: The samplings whose rows are trajectories: drawn independently, and chosen to lie far apart.
TRAJECTORIES = ("random_trajectories", "trajectories")

#: p = 4 levels, and steps of p / 2 of them: from each level there is one step in the range.
LEVELS = 4
STEP = 0.5

#: Trajectories are chosen ten at a time, of forty: a study can be extended by the next ten.
CHOSEN = 10
CANDIDATES = 40


def trajectory_row(sampling: str, seed: int, row: int, factors: int) -> NDArray[np.float64]:
    """Return trajectory `row` (Morris 1991), shape (factors + 1, factors); ValueError as `bits`.

    Args:
        sampling: one of `TRAJECTORIES`.
    """
    if sampling == "random_trajectories":
        words = bits(seed, Purpose.WALK, row, 2 * factors).reshape(2, 1, factors)
        walk: NDArray[np.float64] = _walks(words)[0]
        return walk
    batch, place = divmod(row, CHOSEN)
    points: NDArray[np.float64] = _batch(seed, batch, factors)[place]
    return points


def grouped_row(
    sampling: str, seed: int, row: int, factors: int, units: Units
) -> NDArray[np.float64]:
    """Return a trajectory along which the factors of a unit move at once (Campolongo et al. 2007).

    Every factor moves by two levels, up or down as its own start has room. The first of each unit
    is where `trajectory_row` of so many units has it.

    Returns:
        Shape (units + 1, factors).
    """
    leading = trajectory_row(sampling, seed, row, len(units))
    moved = leading != leading[0]
    level = (bits(seed, Purpose.GROUP, row, factors) >> np.uint64(62)).astype(np.float64)
    start = (level + 0.5) / LEVELS
    end = np.where(start < STEP, start + STEP, start - STEP)
    points = np.empty((len(leading), factors))
    for u, unit in enumerate(units):
        for factor in unit:
            points[:, factor] = np.where(moved[:, u], end[factor], start[factor])
        points[:, unit[0]] = leading[:, u]
    return points


def distances(trajectories: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far trajectories (n, points, factors) lie apart, shape (n, n).

    The sum of the distances between all pairs of their points (Campolongo et al. 2007).
    """
    apart = trajectories[:, None, :, None] - trajectories[None, :, None, :]
    total: NDArray[np.float64] = np.sqrt((apart**2).sum(axis=-1)).sum(axis=(2, 3))
    np.fill_diagonal(total, 0.0)
    return total


def far_apart(distance: NDArray[np.float64], number: int) -> list[int]:
    """Return which of the trajectories to keep (Ruano et al. 2012), from `distances`.

    The two that lie furthest apart, then always the one whose sum of squared distances to those
    kept is largest.
    """
    first = np.unravel_index(np.argmax(distance), distance.shape)
    chosen = [int(place) for place in first]
    while len(chosen) < number:
        reach = (distance[chosen] ** 2).sum(axis=0)
        reach[chosen] = -1.0
        chosen.append(int(np.argmax(reach)))
    return chosen[:number]


@lru_cache(maxsize=32)
def _batch(seed: int, batch: int, factors: int) -> NDArray[np.float64]:
    shape = (2, CANDIDATES, factors)
    words = bits(seed, Purpose.TRAJECTORY, batch, int(np.prod(shape))).reshape(shape)
    candidates = _walks(words)
    chosen: NDArray[np.float64] = candidates[far_apart(distances(candidates), CHOSEN)]
    chosen.setflags(write=False)
    return chosen


def _walks(words: NDArray[np.uint64]) -> NDArray[np.float64]:
    """Return the trajectories of random words (2, n, factors), shape (n, factors + 1, factors)."""
    factors = words.shape[-1]
    level = (words[0] >> np.uint64(62)).astype(np.float64)
    start = (level + 0.5) / LEVELS
    end = np.where(start < STEP, start + STEP, start - STEP)
    # At point j the factors of turn before j have moved.
    turn = np.argsort(np.argsort(words[1], axis=1, kind="stable"), axis=1)
    moved = turn[:, None, :] < np.arange(factors + 1)[:, None]
    walks: NDArray[np.float64] = np.where(moved, end[:, None, :], start[:, None, :])
    return walks
