"""A curve as a few numbers: its coefficients of the first cosines (Ahmed et al. 1974).

Principal components need the products of every two of a curve's numbers, for each factor. With a
hundred points these are five thousand, with twenty coefficients two hundred and ten; smooth curves
lose next to nothing, and what they lose is reported (Ramsay and Silverman 2005, Functional data
analysis, section 8.4.2). A curve of no more points than coefficients loses nothing at all: the
cosines are an orthonormal basis.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

COEFFICIENTS = 20


@lru_cache(maxsize=32)
def cosines(points: int) -> Array:
    """Return the orthonormal basis, shape (points, coefficients).

    The discrete cosine transform of Ahmed, Natarajan and Rao 1974.
    """
    order = np.arange(min(points, COEFFICIENTS))
    angle = np.pi / points * (np.arange(points)[:, None] + 0.5) * order
    basis: Array = np.cos(angle) * np.sqrt(np.where(order == 0, 1.0, 2.0) / points)
    basis.setflags(write=False)
    return basis


def coefficients(curves: Array) -> Array:
    """Return the coefficients of curves (..., points) in `cosines`, nan where a point is.

    The same bits for a curve whatever others are beside it, which no matrix product promises.
    """
    basis = cosines(curves.shape[-1])
    found = np.zeros((*curves.shape[:-1], basis.shape[1]))
    for point, row in enumerate(basis):
        found += curves[..., point, None] * row
    return found


def length(curves: Array) -> Array:
    """Return the Euclidean norm of curves (..., points), nan where a point is; bits as above."""
    total = np.zeros(curves.shape[:-1])
    for point in range(curves.shape[-1]):
        total += curves[..., point] * curves[..., point]
    return np.sqrt(total)


def products(one: Array, other: Array) -> Array:
    """Return the symmetric part of one's and other's outer product, shape (..., pairs).

    Args:
        one, other: coefficients, shape (..., m), which broadcast.

    Returns:
        Its upper triangle, in the order of `numpy.triu_indices(m)`.
    """
    i, j = np.triu_indices(one.shape[-1])
    both: Array = 0.5 * (one[..., i] * other[..., j] + one[..., j] * other[..., i])
    return both


def matrices(pairs: Array, size: int) -> Array:
    """Return the symmetric matrices (..., size, size) of upper triangles (..., pairs)."""
    i, j = np.triu_indices(size)
    found = np.empty((*pairs.shape[:-1], size, size))
    found[..., i, j] = found[..., j, i] = pairs
    return found
