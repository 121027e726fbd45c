"""How far factor and output are from independent (Gretton et al. 2007), and a test of it.

OpenTURNS gives the same numbers (`tests/unit/analysis/given` compares them), in a time that grows
with the cube of the rows; intervals need them again and again.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaincc

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Hsic:
    """Of every factor, shape (factors,)."""

    #: R2-HSIC: the index over the root of those of factor and output with themselves; unbiased but
    #: for that root, so it may be below 0.
    r2: Array
    #: How likely so large an index is of an independent factor.
    p_value: Array


def hsic(x: Array, y: Array) -> Hsic:
    """Return the indices of factors x (rows, factors) for y (rows,), with Gaussian kernels.

    Unbiased as in Song et al. 2012 (Feature selection via dependence maximization, eqn 3), shares
    as in Da Veiga 2015 (Global sensitivity analysis with dependence measures), tested by the gamma
    distribution of Gretton et al. 2007 (A kernel statistical test of independence, section 3). A
    kernel is as wide as its variable's standard deviation.
    """
    output = _gram(y)
    own = _unbiased(output, output)
    r2, p_value = np.empty(x.shape[1]), np.empty(x.shape[1])
    for i, column in enumerate(x.T):
        factor = _gram(column)
        found = _unbiased(factor, output)
        r2[i] = _share(found, _unbiased(factor, factor) * own)
        p_value[i] = _by_chance(found, factor, output)
    return Hsic(r2=r2, p_value=p_value)


def r2_hsic(x: Array, y: Array) -> Array:
    """Return R2-HSIC (Da Veiga 2015) as `hsic` does, without the test."""
    output = _gram(y)
    own = _unbiased(output, output)
    factors = (_gram(column) for column in x.T)
    return np.array([_share(_unbiased(k, output), _unbiased(k, k) * own) for k in factors])


def hsic_of_pairs(x: Array) -> tuple[Array, Array]:
    """Return R2-HSIC of every two columns of x (rows, columns), and how likely it is by chance.

    As `hsic` does, all at once. Shape (columns, columns) each; the diagonal means nothing.
    """
    n = len(x)
    # All pairs of rows are the columns of a matrix: sums over them are its products.
    grams = [_gram(column) for column in x.T]
    of_row = np.array([gram.sum(axis=0) for gram in grams])
    upper = np.triu_indices(n, k=1)
    flat = np.array([gram[upper] for gram in grams])
    whole = of_row.sum(axis=1)
    found = 2.0 * (flat @ flat.T) + np.outer(whole, whole) / ((n - 1) * (n - 2))
    found = (found - 2.0 * (of_row @ of_row.T) / (n - 2)) / (n * (n - 3))
    own = np.sqrt(np.maximum(np.diag(found), np.finfo(float).tiny))
    for f, gram in enumerate(grams):
        flat[f] = _centred(gram)[upper] ** 2
    part = whole / (n * (n - 1))
    mean = (1.0 + np.outer(part, part) - part - part[:, None]) / n
    spread = 2.0 * (n - 4) * (n - 5) / (n * (n - 1) * (n - 2) * (n - 3))
    variance = spread * 2.0 * (flat @ flat.T) / (n * (n - 1))
    variance = np.maximum(variance, np.finfo(float).tiny)
    p_value = gammaincc(mean**2 / variance, np.maximum(found + mean, 0.0) * mean / variance)
    return found / np.outer(own, own), p_value


def _share(found: float, whole: float) -> float:
    return float(found / np.sqrt(whole)) if whole > 0.0 else 0.0


def _gram(values: Array) -> Array:
    """Return the kernel of every pair, 0 of a value with itself."""
    spread = values.std(ddof=1)
    scaled = values / (spread if spread > 0.0 else 1.0)
    kernel: Array = np.exp(-0.5 * (scaled[:, None] - scaled) ** 2)
    np.fill_diagonal(kernel, 0.0)
    return kernel


def _unbiased(k: Array, o: Array) -> float:
    n = len(k)
    of_k, of_o = k.sum(axis=0), o.sum(axis=0)
    found = (k * o).sum() + of_k.sum() * of_o.sum() / ((n - 1) * (n - 2))
    return float((found - 2.0 * (of_k @ of_o) / (n - 2)) / (n * (n - 3)))


def _by_chance(found: float, k: Array, o: Array) -> float:
    n = len(k)
    of_k, of_o = (one.sum() / (n * (n - 1)) for one in (k, o))
    mean = (1.0 + of_k * of_o - of_k - of_o) / n
    both = (_centred(k) * _centred(o)) ** 2
    np.fill_diagonal(both, 0.0)
    spread = 2.0 * (n - 4) * (n - 5) / (n * (n - 1) * (n - 2) * (n - 3))
    variance = spread * both.sum() / (n * (n - 1))
    if not variance > 0.0:
        return 1.0
    return float(gammaincc(mean**2 / variance, max(found + mean, 0.0) * mean / variance))


def _centred(kernel: Array) -> Array:
    of_self = kernel + np.eye(len(kernel))
    mean = of_self.mean(axis=0)
    centred: Array = of_self - mean - mean[:, None] + mean.mean()
    return centred
