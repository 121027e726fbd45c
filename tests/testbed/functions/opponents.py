"""Functions written to deceive intervals and stopping, by somebody who had read only the docs.

Of the warnings the documentation says that they look at the kurtosis of the output (above 7), of
the intervals that they come from eight balanced blocks. So most of these keep the kurtosis just
below 7, hide what matters in few rows, or fall on dyadic grids and between them.
"""

from collections.abc import Mapping

import numpy as np
from scipy.special import stdtrit

from tests.testbed.functions.hard import Hard, Points, additive

_LIGHT = np.array([1.0, 0.8, 0.6, 0.4, 0.0])


def student_6(u: Points) -> Points:
    """Return Student's t with six degrees of freedom (kurtosis 6), and light factors beside it."""
    return np.asarray(stdtrit(6.0, u[..., 0]) + u[..., 1:] @ _LIGHT)


def laplace(u: Points) -> Points:
    """Return a factor with Laplace's distribution (kurtosis 6), and light ones beside it."""
    centred = u[..., 0] - 0.5
    return np.asarray(-np.sign(centred) * np.log1p(-2.0 * np.abs(centred)) + u[..., 1:] @ _LIGHT)


def common_event(u: Points) -> Points:
    """Return an event of 0.12 (kurtosis 6.5) of a size that the second factor sets."""
    return np.asarray((u[..., 0] > 0.88) * (0.5 + u[..., 1]) + 0.2 * u[..., 2] + 0.1 * u[..., 3])


def local_factor(u: Points) -> Points:
    """Return a sum, and a factor that moves it in 0.04 of the cube only, much."""
    return np.asarray(u[..., 0] + u[..., 1] + 3.0 * (u[..., 2] > 0.96) * (u[..., 3] - 0.5))


def noise(u: Points) -> Points:
    """Return what looks like white noise: three factors decide only together."""
    return np.asarray(np.sin(1e5 * (u[..., 0] + np.sqrt(2.0) * u[..., 1] + np.pi * u[..., 2])))


def sine_product(u: Points) -> Points:
    """Return a product of four sines: no factor does anything alone."""
    return np.asarray(np.prod(np.sin(2.0 * np.pi * u[..., :4]), axis=-1))


def checkerboard(u: Points) -> Points:
    """Return the colours of a board of eight by eight, and a slope."""
    squares = np.floor(8.0 * u[..., 0]) + np.floor(8.0 * u[..., 1])
    return np.asarray((-1.0) ** squares + 0.5 * u[..., 2])


def dyadic_corner(u: Points) -> Points:
    """Return an eighth of the cube, cut where Sobol points are cut, and a slope."""
    return np.asarray(np.all(u[..., :3] > 0.5, axis=-1) + 0.1 * u[..., 3])


def fast_wave(u: Points) -> Points:
    """Return fifty waves along a factor, and a product."""
    return np.asarray(np.sin(100.0 * np.pi * u[..., 0]) + u[..., 1] * u[..., 2])


def ridge(u: Points) -> Points:
    """Return a narrow ridge across two factors, and a slope."""
    return np.asarray(np.exp(-(((u[..., 0] + u[..., 1] - 1.0) / 0.06) ** 2)) + 0.2 * u[..., 2])


def cusp(u: Points) -> Points:
    """Return a step with infinitely steep shoulders, and a product."""
    centred = u[..., 0] - 0.37
    return np.asarray(np.sign(centred) * np.abs(centred) ** 0.05 + u[..., 1] * u[..., 2])


def swan(u: Points) -> Points:
    """Return a slope, and once in 333 runs something eight times as large."""
    return np.asarray(u[..., 1] + 0.5 * u[..., 2] + 8.0 * (u[..., 0] > 0.997))


_NONE = np.zeros(6)
_THREE, _FOUR = ([1.0] * n + [0.0] * (6 - n) for n in (3, 4))

OPPONENTS: Mapping[str, Hard] = {
    "Student's t of 6": additive(student_6, [1.5, *(_LIGHT**2 / 12.0)]),
    "Laplace": additive(laplace, [2.0, *(_LIGHT**2 / 12.0)]),
    "common event": Hard(function=common_event, factors=6),
    "local factor": Hard(function=local_factor, factors=6),
    "noise": Hard(function=noise, factors=6, first=_NONE, total=np.array(_THREE)),
    "sine product": Hard(function=sine_product, factors=6, first=_NONE, total=np.array(_FOUR)),
    "checkerboard": Hard(function=checkerboard, factors=6),
    "dyadic corner": Hard(function=dyadic_corner, factors=6),
    "fast wave": Hard(function=fast_wave, factors=6),
    "ridge": Hard(function=ridge, factors=6),
    "cusp": Hard(function=cusp, factors=6),
    "swan": additive(swan, [64.0 * 0.003 * 0.997, 1.0 / 12.0, 0.25 / 12.0, 0.0, 0.0, 0.0]),
}
