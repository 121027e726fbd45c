"""Efforts without their sign: some drives report how hard they work, and not which way."""

from collections.abc import Mapping, Sequence

import numpy as np

#: Over so many samples before one and after it a joint moves by more than `MOVES` of its range.
WIDTH, MOVES = 5, 0.002
#: Share of a motion that goes either way at least.
EITHER_WAY = 0.1
#: How often an effort is 0 between samples at which it is not, and its share of the motion. With
#: brakes a signed one may be, too, at rest. (Set while looking at the SO-101 that it refuses, whose
#: joints have 7 % at least: that one is no evidence.)
TIMES, SHARE = 10, 0.01
#: Fewer joints may well have efforts of one sign: gravity pulls one way.
FEWEST = 2
#: What is said of them.
SAID = (
    "the efforts of all joints are magnitudes: none changes its sign, and each is 0 again and "
    "again while its joint moves both ways; their signs are lost: record signed efforts"
)

#: Position and effort of a joint, (n,) each.
Motion = tuple[np.ndarray, np.ndarray]


def are_magnitudes(joints: Mapping[str, Sequence[Motion]]) -> bool:
    """Whether efforts are without their sign: all of them, of two joints or more.

    A joint under gravity may have efforts of one sign alone, but is then not at 0 again and again
    in motion, nor are all joints of a robot; a sensor that has signs shows some.

    Args:
        joints: position and effort of each joint's recordings, (n,) each.
    """
    signs = [_signs(effort) for motions in joints.values() for _, effort in motions]
    if any(len(sign) > 1 for sign in signs):
        return False
    found = [_touches(motions) for motions in joints.values() if _moves_both_ways(motions)]
    return len(found) >= FEWEST and all(found)


def _signs(effort: np.ndarray) -> set[float]:
    return {*np.sign(effort[np.isfinite(effort)])} - {0.0}


def _moving(position: np.ndarray) -> np.ndarray:
    """Return the velocity's sign at each sample, 0 at rest, (n,)."""
    if len(position) <= 2 * WIDTH or not np.isfinite(position).any():
        return np.zeros(len(position))
    least = MOVES * (np.nanmax(position) - np.nanmin(position))
    steps = position[WIDTH:] - position[:-WIDTH]
    before, after = steps[:-WIDTH], steps[WIDTH:]
    moves = (np.abs(before) > least) & (np.abs(after) > least)
    signs = np.zeros(len(position))
    signs[WIDTH:-WIDTH] = np.where(moves, np.sign(before + after), 0.0)
    return signs


def _moves_both_ways(motions: Sequence[Motion]) -> bool:
    ways = np.concatenate([_moving(position) for position, _ in motions])
    least = EITHER_WAY * np.sum(ways != 0.0)
    return bool(0 < least <= min(np.sum(ways > 0.0), np.sum(ways < 0.0)))


def _touches(motions: Sequence[Motion]) -> bool:
    """Whether an effort is 0 again and again, and in motion, too."""
    zero = [effort == 0.0 for _, effort in motions]
    times = sum(int(np.sum(np.diff(at.astype(int)) == 1)) for at in zero)
    moving = np.concatenate([_moving(position) != 0.0 for position, _ in motions])
    return times >= TIMES and bool(np.mean(np.concatenate(zero)[moving]) >= SHARE)
