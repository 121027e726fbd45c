"""Functions of the unit cube whose sensitivity indices are known, all of six factors."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FACTORS = 6

Points = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Known:
    """A function and its closed forms."""

    #: Of points (..., 6), returns (...).
    function: Callable[[Points], NDArray[np.float64]]
    #: Shape (6,).
    first: NDArray[np.float64]
    total: NDArray[np.float64]


_G = np.array([0.0, 1.0, 4.5, 9.0, 99.0, 99.0])
_SLOPES = np.array([4.0, 3.0, 2.0, 1.0, 0.5, 0.0])
_SIGNS = np.array([-1.0, 1.0, -1.0, 1.0, -1.0, 1.0])


def ishigami(u: Points) -> NDArray[np.float64]:
    """Return Ishigami and Homma's function (1990) with a = 7, b = 0.1; three factors are idle."""
    x = np.pi * (2.0 * u - 1.0)
    y: NDArray[np.float64] = (
        np.sin(x[..., 0]) + 7.0 * np.sin(x[..., 1]) ** 2 + 0.1 * x[..., 2] ** 4 * np.sin(x[..., 0])
    )
    return y


def sobol_g(u: Points) -> NDArray[np.float64]:
    """Return Sobol's g-function with a = (0, 1, 4.5, 9, 99, 99) (Saltelli and Sobol 1995)."""
    y: NDArray[np.float64] = np.prod((np.abs(4.0 * u - 2.0) + _G) / (1.0 + _G), axis=-1)
    return y


def bratley(u: Points) -> NDArray[np.float64]:
    """Return the sum of (-1)^i x_1 ... x_i (Bratley, Fox and Niederreiter 1992)."""
    y: NDArray[np.float64] = (_SIGNS * np.cumprod(u, axis=-1)).sum(axis=-1)
    return y


def linear(u: Points) -> NDArray[np.float64]:
    """Return a weighted sum; the last factor is idle."""
    y: NDArray[np.float64] = u @ _SLOPES
    return y


def noise(u: Points) -> NDArray[np.float64]:
    """Return numbers that no factor explains, though the same point has the same number."""
    y: NDArray[np.float64] = np.modf(np.abs(np.sin(u @ (1e4 * np.arange(1.0, 7.0)))) * 1e4)[0]
    return y


def _ishigami() -> Known:
    """Closed forms of Saltelli et al. 2008, page 179."""
    b, pi = 0.1, np.pi
    alone = np.array([0.5 * (1.0 + b * pi**4 / 5.0) ** 2, 49.0 / 8.0, 0.0, 0.0, 0.0, 0.0])
    together = b**2 * pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
    company = alone + np.array([together, 0.0, together, 0.0, 0.0, 0.0])
    variance = alone.sum() + together
    return Known(function=ishigami, first=alone / variance, total=company / variance)


def _sobol_g() -> Known:
    """Closed forms of Saltelli and Sobol 1995."""
    part = 1.0 / (3.0 * (1.0 + _G) ** 2)
    whole = np.prod(1.0 + part)
    return Known(
        function=sobol_g,
        first=part / (whole - 1.0),
        total=part / (1.0 + part) * whole / (whole - 1.0),
    )


def _bratley() -> Known:
    """Moments of products of uniform factors: E[x] = 1/2, E[x^2] = 1/3."""
    i = np.arange(1, FACTORS + 1)
    least, apart = np.minimum.outer(i, i), np.abs(np.subtract.outer(i, i))
    signs = np.outer(_SIGNS, _SIGNS)
    variance = (signs * 3.0**-least * 2.0**-apart).sum() - (_SIGNS * 2.0**-i).sum() ** 2
    first, total = np.empty(FACTORS), np.empty(FACTORS)
    for k in range(FACTORS):
        slope = (_SIGNS * 2.0 ** -(i - 1.0))[k:].sum()
        squares = (signs * 3.0 ** -(least - 1.0) * 2.0**-apart)[k:, k:].sum()
        first[k], total[k] = slope**2 / 12.0 / variance, squares / 12.0 / variance
    return Known(function=bratley, first=first, total=total)


KNOWN: Mapping[str, Known] = {
    "ishigami": _ishigami(),
    "sobol g": _sobol_g(),
    "bratley": _bratley(),
    "linear": Known(
        function=linear,
        first=_SLOPES**2 / (_SLOPES @ _SLOPES),
        total=_SLOPES**2 / (_SLOPES @ _SLOPES),
    ),
    "dummies only": Known(function=noise, first=np.zeros(FACTORS), total=np.ones(FACTORS)),
}
