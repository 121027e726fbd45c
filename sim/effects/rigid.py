"""Inertial parameters of a body: mass, first moments, inertia (xx, yy, zz, xy, xz, yz)."""

import numpy as np


def point_mass(position: np.ndarray) -> np.ndarray:
    """Return the ten parameters of one kilogram at a position of a body's frame, (10,)."""
    x, y, z = position
    return np.array(
        [1.0, x, y, z, y * y + z * z, x * x + z * z, x * x + y * y, -x * y, -x * z, -y * z]
    )


#: Those of a body without mass whose inertia about every axis through its centre is 1 kg m2.
BALL = np.array([0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0])


def point_mass_slopes(position: np.ndarray) -> np.ndarray:
    """Return how these parameters change with each coordinate, (10, 3)."""
    x, y, z = position
    return np.array(
        [
            [0, 0, 0],
            [1, 0, 0],
            [0, 1, 0],
            [0, 0, 1],
            [0, 2 * y, 2 * z],
            [2 * x, 0, 2 * z],
            [2 * x, 2 * y, 0],
            [-y, -x, 0],
            [-z, 0, -x],
            [0, -z, -y],
        ],
        dtype=float,
    )
