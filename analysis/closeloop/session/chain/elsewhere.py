"""Torques of a chain with one joint elsewhere, for any way, from a few ways.

All that lies behind a hinge turns with it, and kinetic energy is quadratic in where links are:
every torque is a trigonometric polynomial of the hinge's angle, of second degree, and a polynomial
of a slide's way. A declared spring's grows with the way. That is exact, so a few ways tell all
others.
"""

from collections.abc import Callable

import numpy as np

#: Ways that tell a hinge's five coefficients best, of a grid of 0.25 rad, and one to try; rad.
HINGE = (-3.0, -1.75, 0.75, 2.0, 3.0, -0.8)
#: The same of a slide's two, m.
SLIDE = (-0.5, 0.5, 0.3)
#: What the last may be off, of the largest torque: what tendons or a fluid do is no polynomial.
TOLERANCE = 1e-9


def coefficients(
    torque: Callable[[float], np.ndarray], here: np.ndarray, hinge: bool
) -> np.ndarray:
    """Return the coefficients of a change of torques, (5 or 2, n, joints); none if none are exact.

    Args:
        torque: with the joint elsewhere by some way, (n, joints).
        here: the same for no way.
        hinge: whether the joint turns.
    """
    *ways, tried = HINGE if hinge else SLIDE
    values = np.stack([torque(way) for way in ways])
    basis = np.stack([way * rates(way, hinge) for way in ways])
    found = np.tensordot(np.linalg.inv(basis), values - here, axes=1)
    error = here + tried * np.tensordot(rates(tried, hinge), found, axes=1) - torque(tried)
    exact = bool(np.abs(error).max() <= TOLERANCE * np.abs(values).max())
    return found if exact else found[:0]


def rates(way: float, hinge: bool) -> np.ndarray:
    """Return what one unit of each coefficient changes over a way, per rad or m, (5 or 2,)."""
    if not hinge:
        return np.array([1.0, way])
    once, twice = np.sinc(np.array([way, 2.0 * way]) / np.pi) * (1.0, 2.0)
    # 1 - cos is twice the square of the sine of half the angle.
    even = [-2.0 * np.sin(0.5 * n * way) ** 2 / way if way else 0.0 for n in (1, 2)]
    return np.array([once, twice, *even, 1.0])
