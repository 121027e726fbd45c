"""Gaussian processes whose kernel is a product over the factors, so that their parts are sums.

A conditional mean is a sum of kernels, and integrals of a product over the unit cube are products
of integrals over a line: mean, parts and their mean squares need no sampling (Oakley and O'Hagan
2004; Marrel, Iooss, Laurent and Roustant 2009, Calculations of Sobol indices for the Gaussian
process metamodel).
"""

from dataclasses import dataclass
from itertools import combinations
from math import log, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, lapack
from scipy.optimize import minimize
from scipy.special import ndtri

from analysis.sensitivity.fewer_runs.parts import CELLS, MIDDLES, Normal, Parts

Array = NDArray[np.float64]

#: Length scales (of a factor's range) and noise (of the process' variance) looked among.
_SHORTEST, _LONGEST = 0.05, 100.0
_LEAST_NOISE, _MOST_NOISE = 1e-7, 10.0

#: Length scales are found from so many runs at most: the cost grows with their cube.
_SEARCHED = 256

#: Steps of the search, from the likeliest of these length scales (all factors alike).
_STEPS = 50
_STARTS = (0.2, 0.6, 2.0, 8.0)

#: Of length scales beforehand, as Hvarfner, Hellsten and Nardi 2024 have it: lognormal with
#: this mean, and half the logarithm of the number of factors more, and this variance.
_PRIOR_MEAN, _PRIOR_VARIANCE = sqrt(2.0), 3.0

#: Points of the Gauss-Legendre rule along each factor, and along a length scale if that is more:
#: weights of what changes quickly are large and cancel, and a peak's share came out a tenth short.
_NODES, _NODES_A_LENGTH = 48, 20.0


@dataclass(frozen=True, kw_only=True)
class Scales:
    """What the likelihood of a process was largest with."""

    #: Of each factor, as a share of its range.
    lengths: Array
    #: Variance of the noise as a share of the process' variance.
    noise: float


def _places(x: Array, normal: Normal) -> Array:
    """Return where points of the unit cube lie: a normal factor has the spread of a range of 1."""
    return np.where(normal, ndtri(x) / sqrt(12.0), x)


def find_scales(x: Array, y: Array, normal: Normal) -> Scales:
    """Return the scales of largest posterior density (Rasmussen and Williams 2006, section 5.4).

    Args:
        x: points of the unit cube, shape (n, factors).
        y: what was found there, shape (n,); not all the same.
        normal: which factors are.
    """
    x, y = _places(x[:_SEARCHED], normal), y[:_SEARCHED]
    y = (y - y.mean()) / y.std()
    pairs = np.tril_indices(len(y), -1)
    apart = np.abs(x[pairs[0]] - x[pairs[1]]).T
    expected = _PRIOR_MEAN + 0.5 * log(x.shape[1])
    bounds = [(log(_SHORTEST), log(_LONGEST))] * x.shape[1]
    bounds.append((log(_LEAST_NOISE), log(_MOST_NOISE)))
    starts = [np.append(np.full(x.shape[1], log(start)), log(1e-3)) for start in _STARTS]
    found = minimize(
        _misfit,
        min(starts, key=lambda start: _misfit(start, apart, pairs, y, expected)[0]),
        args=(apart, pairs, y, expected),
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": _STEPS},
    )
    return Scales(lengths=np.exp(found.x[:-1]), noise=float(np.exp(found.x[-1])))


def _misfit(
    z: Array,
    apart: Array,
    pairs: tuple[NDArray[np.intp], NDArray[np.intp]],
    y: Array,
    expected: float,
) -> tuple[float, Array]:
    """Return minus the logarithm of the posterior density of scales, and its gradient."""
    n, lengths, noise = len(y), np.exp(z[:-1]), float(np.exp(z[-1]))
    kernel = np.ones(apart.shape[1])
    slopes = np.empty_like(apart)
    for factor, length in enumerate(lengths):
        of_one, slopes[factor] = _kernel(apart[factor] / length)
        kernel *= of_one
    noisy = np.zeros((n, n))
    noisy[pairs] = kernel
    noisy.flat[:: n + 1] = 1.0 + noise
    lower, info = lapack.dpotrf(noisy, lower=1)
    if info:
        return 1e10, np.zeros_like(z)
    inverse = lapack.dpotri(lower, lower=1)[0]
    inverse += np.tril(inverse, -1).T
    ones = inverse.sum(axis=1)
    weights = inverse @ y
    weights -= ones * (weights.sum() / ones.sum())
    variance = float(weights @ y) / n
    away = z[:-1] - expected
    value = 0.5 * n * log(variance) + float(np.log(np.diag(lower)).sum())
    value += 0.5 * float(away @ away) / _PRIOR_VARIANCE
    change = inverse[pairs] - weights[pairs[0]] * weights[pairs[1]] / variance
    of_noise = 0.5 * noise * (float(np.trace(inverse)) - float(weights @ weights) / variance)
    return value, np.append(slopes @ (change * kernel) + away / _PRIOR_VARIANCE, of_noise)


def _kernel(far: Array) -> tuple[Array, Array]:
    """Return Matern's kernel of 5/2, and how its logarithm changes with that of its length."""
    r = sqrt(5.0) * far
    powers = 1.0 + r + r**2 / 3.0
    return powers * np.exp(-r), r**2 * (1.0 + r) / (3.0 * powers)


class Processes:
    """Conditional means of a Gaussian process with given scales.

    Args:
        x: points of the unit cube, shape (n, factors).
        scales: of `find_scales`.
        normal: which factors are (Xiu and Karniadakis 2002).
    """

    def __init__(self, x: Array, scales: Scales, normal: Normal) -> None:
        self._x, self._scales, self._normal = _places(x, normal), scales, normal
        #: Kernels of every factor between two points, shape (factors, n, n).
        self._kernels = _between(self._x, self._x, scales)
        self._kernel = np.prod(self._kernels, axis=0)
        count = max(_NODES, int(_NODES_A_LENGTH / float(scales.lengths.min())))
        nodes, share = np.polynomial.legendre.leggauss(count)
        along = _places(np.tile(0.5 * (nodes + 1.0)[:, None], x.shape[1]), normal)
        lines, half = _between(self._x, along, scales), 0.5 * share
        #: Integrals along each factor of one kernel (factors, n), and of two (factors, n, n).
        self._once = lines @ half
        self._twice = (lines * half) @ lines.transpose(0, 2, 1)
        self._product = np.prod(self._once, axis=0)
        self._products = np.prod(self._twice, axis=0)

    def without(self, y: Array, away: NDArray[np.bool_]) -> Parts:
        """Fit to the runs that are not away (Oakley and O'Hagan 2004; Marrel et al. 2009)."""
        mean_of_all, weights = self._fitted(y, ~away)
        whole = self._kernel[away]
        mean = float(self._product @ weights)
        first, total, first_squares, total_squares = [], [], [], []
        for kernels, once, twice in zip(self._kernels, self._once, self._twice, strict=True):
            apart, apart_twice = kernels[away] - once, twice - np.outer(once, once)
            others = weights * self._product / once
            first.append(apart @ others)
            first_squares.append(others @ apart_twice @ others)
            total.append((whole / kernels[away] * apart) @ weights)
            total_squares.append(weights @ (self._products / twice * apart_twice) @ weights)
        return Parts(
            value=mean_of_all + whole @ weights,
            centred=whole @ weights - mean,
            first=np.stack(first, axis=1),
            total=np.stack(total, axis=1),
            variance=float(weights @ self._products @ weights - mean**2),
            first_squares=np.array(first_squares),
            total_squares=np.array(total_squares),
        )

    def pairs(self, y: Array) -> Array:
        """Return the parts of the second order (Oakley and O'Hagan 2004; Marrel et al. 2009)."""
        _, weights = self._fitted(y, np.ones(len(y), dtype=np.bool_))
        factors = len(self._once)
        places = _places(np.tile(MIDDLES[:, None], factors), self._normal)
        along = _between(places, self._x, self._scales)
        apart = along - self._once[:, None]
        found = [
            (apart[i] * (weights * self._product / (self._once[i] * self._once[j]))) @ apart[j].T
            for i, j in combinations(range(factors), 2)
        ]
        return np.array(found).reshape(-1, CELLS, CELLS)

    def _fitted(self, y: Array, there: NDArray[np.bool_]) -> tuple[float, Array]:
        """Return the constant and the weights of each run's kernel, 0 of those not there."""
        kept = np.flatnonzero(there)
        kernel = self._kernel[np.ix_(kept, kept)]
        kernel.flat[:: len(kept) + 1] += self._scales.noise
        factor = cho_factor(kernel, lower=True)
        ones = cho_solve(factor, np.ones(len(kept)))
        middle = float(y[kept].mean())
        solved = cho_solve(factor, y[kept] - middle)
        constant = float(solved.sum() / ones.sum())
        weights = np.zeros(len(y))
        weights[kept] = solved - constant * ones
        return middle + constant, weights


def _between(a: Array, b: Array, scales: Scales) -> Array:
    """Return the kernels of every factor between two sets of points, shape (factors, a, b)."""
    far = np.abs(a.T[:, :, None] - b.T[:, None, :]) / scales.lengths[:, None, None]
    return _kernel(far)[0]
