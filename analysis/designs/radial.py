"""Radial design for elementary effects (Campolongo, Saltelli and Cariboni 2011)."""

from math import log

import numpy as np
from numpy.typing import NDArray

#: An elementary effect divides by its step; a tiny step would divide noise by almost nothing.
SMALLEST_STEP = 0.1

#: Mean of 1 / |step| over this design: of steps u from 0.1 to 0.9, and u - 1 around the end.
MEAN_INVERSE_STEP = (
    2.0 * log((1.0 - SMALLEST_STEP) / SMALLEST_STEP) / (1.0 - 2.0 * SMALLEST_STEP) - 2.0
)


def radial_row(point: NDArray[np.float64]) -> NDArray[np.float64]:
    """Lay out rows, each from a point of the unit cube of twice as many dimensions as factors.

    Position 0 is the base, position 1 + i is the base with factor i moved by 0.1 to 0.9 of its
    range, around the end if need be. If `point` is uniform, so is every position (Campolongo et
    al. 2011).

    Args:
        point: shape (..., 2 k): the base, then where to step.

    Returns:
        Shape (..., k + 1, k).
    """
    k = point.shape[-1] // 2
    base, where = point[..., :k], point[..., k:]
    step = SMALLEST_STEP + (1.0 - 2.0 * SMALLEST_STEP) * where
    moved = base + step
    # Around the end is a step back; rounding must not take it out of the open cube.
    moved = np.where(moved < 1.0, moved, np.maximum(base - (1.0 - step), 2.0**-53))
    # NumPy's own tile and fill_diagonal take longer.
    row = np.empty((*base.shape[:-1], k + 1, k))
    row[:] = base[..., None, :]
    row.reshape(*base.shape[:-1], -1)[..., k :: k + 1] = moved
    return row


def legs(row: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Return where rows (..., k + 1, k), radial or trajectories, move each factor (Morris 1991).

    Returns:
        The positions before and after the move, shape (2, ..., k), and the signed steps, shape
        (..., k). The position before is the base of a radial row, and the one just before of a
        trajectory.
    """
    k = row.shape[-1]
    apart = row[..., 1:, :] - row[..., :1, :]
    steps = np.diagonal(apart, axis1=-2, axis2=-1)
    if np.count_nonzero(apart) == np.count_nonzero(steps) == steps.size:
        # Radial rows in the order of their factors, as ours are.
        after = np.broadcast_to(np.arange(1, k + 1), steps.shape)
        return np.stack([np.zeros_like(after), after]), steps
    after = 1 + np.argmax(row[..., 1:, :] != row[..., :1, :], axis=-2)
    # In a radial row only one factor differs from the base; along a trajectory ever more do.
    radial = np.count_nonzero(row[..., -1, :] != row[..., 0, :], axis=-1) == 1
    before = np.where(radial[..., None] | (k == 1), 0, after - 1)
    ends = (
        np.take_along_axis(row, place[..., None, :], axis=-2)[..., 0, :]
        for place in (after, before)
    )
    return np.stack([before, after]), next(ends) - next(ends)
