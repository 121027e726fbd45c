"""Functions whose output is a curve, with closed forms of all its indices.

Each is a sum of terms, a function of the factors times a shape over time, and of every set of
factors the covariances are known that the terms have through it alone (Sobol 1993). So a share of a
point's variance, of the whole curve's (Lamboni et al. 2011) or of a score's is a quotient of
quadratic forms.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class CurveFunction:
    """A function of points of the unit cube."""

    #: Of points (..., factors): its terms (..., terms).
    terms: Callable[[Array], Array]
    #: Shapes over time, (points, terms).
    shapes: Array
    #: By set of factors: the covariances of the terms through it alone, (terms, terms).
    parts: Mapping[frozenset[int], Array]
    factors: int

    def values(self, points: Array) -> Array:
        """Return its curves at points of the unit cube, shape (..., points)."""
        values: Array = self.terms(points) @ self.shapes.T
        return values

    def covariance(self, which: Callable[[frozenset[int]], bool] = bool) -> Array:
        """Return the covariance of the terms through the sets that `which` wants."""
        wanted = [part for factors, part in self.parts.items() if which(factors)]
        return np.sum(wanted, axis=0) if wanted else 0.0 * next(iter(self.parts.values()))

    def first(self, factor: int) -> Array:
        """Return the covariance of the terms through a factor alone."""
        return self.covariance(lambda factors: factors == {factor})

    def total(self, factor: int) -> Array:
        """Return the covariance of the terms through all sets with a factor."""
        return self.covariance(lambda factors: factor in factors)

    def at_points(self, of: Callable[[int], Array]) -> Array:
        """Return the indices at every point, shape (points, factors)."""
        shares = [np.einsum("tj,jk,tk->t", self.shapes, of(f), self.shapes) for f in self._all()]
        every = np.einsum("tj,jk,tk->t", self.shapes, self.covariance(), self.shapes)
        return np.stack(shares, axis=-1) / every[:, None]

    def of_whole(self, of: Callable[[int], Array]) -> Array:
        """Return the generalised indices, shape (factors,)."""
        gram = self.shapes.T @ self.shapes
        every = np.trace(self.covariance() @ gram)
        return np.array([np.trace(of(f) @ gram) for f in self._all()]) / every

    def of_score(self, of: Callable[[int], Array], component: int) -> Array:
        """Return the indices of a principal component's score, shape (factors,)."""
        every = self.shapes @ self.covariance() @ self.shapes.T
        power, vectors = np.linalg.eigh(every)
        loading = vectors[:, -1 - component] @ self.shapes
        return np.array([loading @ of(f) @ loading for f in self._all()]) / power[-1 - component]

    def _all(self) -> range:
        return range(self.factors)


def _only(value: float, *at: tuple[int, int], terms: int) -> Array:
    """Return a matrix with a value at these places and the mirrored ones."""
    found = np.zeros((terms, terms))
    for i, j in at:
        found[i, j] = found[j, i] = value
    return found


def ishigami_over_time(points: int) -> CurveFunction:
    """Return (1 - t) sin x1 + 7 t sin^2 x2 + 0.1 x3^4 sin x1, after Ishigami and Homma 1990."""
    t = np.linspace(0.0, 1.0, points)

    def terms(unit: Array) -> Array:
        x = np.pi * (2.0 * unit - 1.0)
        sine = np.sin(x[..., 0])
        return np.stack([sine, np.sin(x[..., 1]) ** 2, x[..., 2] ** 4 * sine], axis=-1)

    fourth, eighth = np.pi**4 / 5.0, np.pi**8 / 9.0
    mean = _only(0.5, (0, 0), terms=3) + _only(0.5 * fourth, (0, 2), terms=3)
    return CurveFunction(
        terms=terms,
        shapes=np.stack([1.0 - t, 7.0 * t, np.full(points, 0.1)], axis=-1),
        parts={
            frozenset({0}): mean + _only(0.5 * fourth**2, (2, 2), terms=3),
            frozenset({1}): _only(0.125, (1, 1), terms=3),
            frozenset({0, 2}): _only(0.5 * (eighth - fourth**2), (2, 2), terms=3),
        },
        factors=3,
    )


def waves(points: int) -> CurveFunction:
    """Return four waves that begin one after the other, two of them together, and an idle factor.

    Each is 1 to 2.5 times a standardised factor; the last is the product of the first two.
    """
    t = np.linspace(0.0, 1.0, points)[:, None]

    def terms(unit: Array) -> Array:
        z = np.sqrt(12.0) * (unit - 0.5)
        return np.concatenate([z[..., :4], z[..., :1] * z[..., 1:2]], axis=-1)

    places, sizes = np.linspace(0.0, 1.0, 5), np.array([1.0, 1.5, 2.0, 2.5, 2.0])
    shapes = 0.05 + sizes * np.exp(-0.5 * ((t - places) / 0.12) ** 2)
    parts = {frozenset({i}): _only(1.0, (i, i), terms=5) for i in range(4)}
    parts[frozenset({0, 1})] = _only(1.0, (4, 4), terms=5)
    return CurveFunction(terms=terms, shapes=shapes, parts=parts, factors=5)


def decays(points: int) -> CurveFunction:
    """Return what begins as a product of two factors and decays into those of three others.

    (1 + z1) (1 + z2) e^-3t + e^u3 t + u4^2 sin(pi t) + z1 t^2 of standardised factors z and such
    from 0 to 1, u. Nothing was set on it.
    """
    t = np.linspace(0.0, 1.0, points)

    def terms(unit: Array) -> Array:
        z = np.sqrt(12.0) * (unit - 0.5)
        product = (1.0 + z[..., 0]) * (1.0 + z[..., 1])
        return np.stack([product, np.exp(unit[..., 2]), unit[..., 3] ** 2, z[..., 0]], axis=-1)

    of_exp = 0.5 * (np.e**2 - 1.0) - (np.e - 1.0) ** 2
    return CurveFunction(
        terms=terms,
        shapes=np.stack([np.exp(-3.0 * t), t, np.sin(np.pi * t), t * t], axis=-1),
        parts={
            frozenset({0}): _only(1.0, (0, 0), (0, 3), (3, 3), terms=4),
            frozenset({1}): _only(1.0, (0, 0), terms=4),
            frozenset({0, 1}): _only(1.0, (0, 0), terms=4),
            frozenset({2}): _only(of_exp, (1, 1), terms=4),
            frozenset({3}): _only(4.0 / 45.0, (2, 2), terms=4),
        },
        factors=4,
    )


def gamboa(a: float, b: float) -> CurveFunction:
    """Return (x1 + x2 + x1 x2, a x1 + x2 + b x1 x2) of standard normal factors.

    Gamboa, Janon, Klein and Lagnoux 2014, whose generalised first-order indices are
    (1 + a^2) / (4 + a^2 + b^2) and 2 / (4 + a^2 + b^2).
    """
    from scipy.special import ndtri

    def terms(unit: Array) -> Array:
        x = ndtri(unit)
        return np.concatenate([x, x[..., :1] * x[..., 1:]], axis=-1)

    return CurveFunction(
        terms=terms,
        shapes=np.array([[1.0, 1.0, 1.0], [a, 1.0, b]]),
        parts={
            frozenset({0}): _only(1.0, (0, 0), terms=3),
            frozenset({1}): _only(1.0, (1, 1), terms=3),
            frozenset({0, 1}): _only(1.0, (2, 2), terms=3),
        },
        factors=2,
    )
