"""Sparse expansions in Legendre and Hermite polynomials, whose terms are picked one by one.

Orthogonal matching pursuit picks the terms, and the corrected leave-one-out error how many of them
(Blatman and Sudret 2011, Adaptive sparse polynomial chaos expansion based on least angle
regression, for the error; Pati, Rezaiifar and Krishnaprasad 1993 for the pursuit). The parts of an
expansion are sums of some of its terms (Sudret 2008).
"""

from functools import lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.special import gamma, ndtri

from analysis.sensitivity.fewer_runs.parts import CELLS, MIDDLES, Normal, Parts

Array = NDArray[np.float64]

#: Terms to pick from at most, and their highest degree. Products of many factors come late
#: (hyperbolic truncation with q = 0.6).
_TERMS = 1000
_DEGREE = 14
_Q = 0.6

#: Terms picked are this share of the runs at most, and picking ends when as many in a row were of
#: no use.
_SHARE = 0.5
_PATIENCE = 20


class Expansions:
    """Sums of products of Legendre polynomials, of normal factors Hermite's, of mean square 1.

    Args:
        x: points of the unit cube, shape (n, factors).
        normal: which factors are (Xiu and Karniadakis 2002).
    """

    def __init__(self, x: Array, normal: Normal) -> None:
        self._normal = normal
        #: Degree of each term in each factor, shape (terms, factors); the constant is not one.
        self._degrees = _candidates(x.shape[1])
        self._terms = _terms(x, self._degrees, normal)

    def without(self, y: Array, away: NDArray[np.bool_]) -> Parts:
        """Fit to the runs that are not away, from the picking of terms on (Sudret 2008)."""
        picked, constant, coefficients = _fitted(self._terms[~away], y[~away])
        active = self._degrees[picked] > 0
        alone = active & (active.sum(axis=1) == 1)[:, None]
        terms, squares = self._terms[np.ix_(away, picked)] * coefficients, coefficients**2
        centred = terms.sum(axis=1)
        return Parts(
            value=constant + centred,
            centred=centred,
            first=terms @ alone,
            total=terms @ active,
            variance=float(squares.sum()),
            first_squares=squares @ alone,
            total_squares=squares @ active,
        )

    def pairs(self, y: Array) -> Array:
        """Return the sums of the terms that have two factors (Sudret 2008)."""
        picked, _, coefficients = _fitted(self._terms, y)
        degrees = self._degrees[picked]
        active = degrees > 0
        two = active.sum(axis=1) == 2
        along = _along(MIDDLES, int(degrees.max(initial=0)), self._normal)
        found = []
        for i, j in combinations(range(degrees.shape[1]), 2):
            of_both = two & active[:, i] & active[:, j]
            first = along[i][:, degrees[of_both, i]] * coefficients[of_both]
            found.append(first @ along[j][:, degrees[of_both, j]].T)
        return np.array(found).reshape(-1, CELLS, CELLS)


def _terms(x: Array, degrees: NDArray[np.int64], normal: Normal) -> Array:
    """Return the values of terms at points, shape (n, terms)."""
    highest = int(degrees.max(initial=0))
    values = np.ones((len(x), len(degrees)))
    for at, of_factor, bell in zip(x.T, degrees.T, normal, strict=True):
        active = of_factor > 0
        values[:, active] *= _polynomials(at, highest, bell=bell)[:, of_factor[active]]
    return values


def _along(places: Array, highest: int, normal: Normal) -> list[Array]:
    """Return each factor's polynomials at places of its range, shape (places, highest + 1)."""
    return [_polynomials(places, highest, bell=bell) for bell in normal]


def _polynomials(x: Array, highest: int, *, bell: bool) -> Array:
    """Return polynomials with mean square 1 at places of the range, shape (n, highest + 1).

    Of a normal factor (`bell`) Hermite's of its standard deviations, else Legendre's.
    """
    degrees = np.arange(highest + 1)
    if bell:
        every = np.polynomial.hermite_e.hermevander(ndtri(x), highest)
        return np.asarray(every / np.sqrt(gamma(degrees + 1.0)), dtype=np.float64)
    every = np.polynomial.legendre.legvander(2.0 * x - 1.0, highest)
    return np.asarray(every * np.sqrt(2.0 * degrees + 1.0), dtype=np.float64)


def _fitted(terms: Array, y: Array) -> tuple[NDArray[np.intp], float, Array]:
    """Return which terms were picked, the constant, and the coefficients of those picked."""
    picked = _picked(terms, y)
    design = np.column_stack([np.ones(len(y)), terms[:, picked]])
    constant, *coefficients = np.linalg.lstsq(design, y, rcond=None)[0]
    return picked, float(constant), np.array(coefficients)


def _picked(terms: Array, y: Array) -> NDArray[np.intp]:
    """Return which terms to take, by the corrected leave-one-out error."""
    n = len(y)
    left = y - y.mean()
    leverage = np.full(n, 1.0 / n)
    free = terms - terms.mean(axis=0)
    #: Squares of what is left of each term beside those picked, and its product with `left`.
    squares, product = (free**2).sum(axis=0), left @ free
    basis = np.empty((min(int(_SHARE * n), terms.shape[1]), n))
    picked: list[int] = []
    errors = [float(((left / (1.0 - leverage)) ** 2).mean())]
    least = 1e-24 * n * float((y**2).max())
    for count in range(len(basis)):
        gain = np.where(squares > 1e-6 * n, product**2 / np.maximum(squares, 1e-6 * n), 0.0)
        best = int(np.argmax(gain))
        if gain[best] <= least or len(errors) - 1 - int(np.argmin(errors)) >= _PATIENCE:
            break
        direction = free[:, best].copy()
        for _ in range(2):  # Once more, for what rounding left.
            direction -= (basis[:count] @ direction) @ basis[:count]
        direction /= np.sqrt(direction @ direction)
        basis[count] = direction
        picked.append(best)
        step, shadows = float(direction @ left), direction @ free
        left = left - step * direction
        product = product - step * shadows
        squares = squares - shadows**2
        squares[picked] = 0.0
        leverage = leverage + direction**2
        # The constant is one of the terms.
        many = count + 2
        correction = n / (n - many) * (1.0 + many / n)
        apart = np.maximum(1.0 - leverage, 1e-6)
        errors.append(correction * float(((left / apart) ** 2).mean()))
    return np.array(picked[: int(np.argmin(errors))], dtype=np.intp)


@lru_cache(maxsize=16)
def _candidates(factors: int) -> NDArray[np.int64]:
    """Return the degrees of the terms to pick from, shape (terms, factors), simplest first."""
    best = _within(factors, 1.0)
    for highest in np.arange(1.0, _DEGREE + 0.5, 0.5):
        found = _within(factors, float(highest))
        if found is None:
            break
        best = found
    assert best is not None
    best.setflags(write=False)
    return best


def _within(factors: int, highest: float) -> NDArray[np.int64] | None:
    """Return all degrees whose hyperbolic norm is at most `highest`; None if too many."""
    limit = highest**_Q + 1e-9
    shares = np.arange(_DEGREE + 1) ** _Q
    found: list[tuple[float, tuple[int, ...]]] = [(0.0, ())]
    for _ in range(factors):
        found = [
            (used + shares[degree], (*degrees, degree))
            for used, degrees in found
            for degree in range(_DEGREE + 1)
            if used + shares[degree] <= limit
        ]
        if len(found) > 20 * _TERMS:
            return None
    if len(found) - 1 > _TERMS and highest > 1.0:
        return None
    return np.array([d for used, d in sorted(found) if used > 0.0], dtype=np.int64)
