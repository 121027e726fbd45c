"""First-order shares by a sum of functions of one factor each, fitted to the rows: HDMR.

SALib gives the same numbers for many rows (`tests/unit/analysis/given` compares them), but none for
fewer than 300, which intervals need, and is about to retire what gives them.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.linalg import cho_factor, cho_solve

Array = NDArray[np.float64]

#: Pieces of a factor's range, and how much large coefficients cost (Li et al. 2010, SALib).
PIECES = 5
PENALTY = 0.01


def hdmr(x: Array, y: Array) -> Array:
    """Return each factor's share of the variance, less what as many coefficients fit by chance.

    The covariance of the output and the factor's function: the sum of what the factor explains and
    of what it shares with those that it depends on (Li et al. 2010, Global sensitivity analysis for
    systems with independent and/or correlated inputs, equations 19 to 21). What is taken off is
    that of the adjusted R2 (Kelley 1935).

    Args:
        x: shape (rows, factors).
        y: shape (rows,).

    Returns:
        Shape (factors,); below 0 where a factor explains less than chance does.
    """
    return hdmr_at(x)(y)


def hdmr_at(x: Array) -> Callable[[Array], Array]:
    """Return the shares (Li et al. 2010) of any output of these factors: `hdmr` of many at once."""
    # One coefficient of every function is the mean's; few values take no more than they are.
    levels = np.array([len(np.unique(column)) for column in x.T])
    free = np.minimum(PIECES + 2, levels - 1)
    shares = shares_at(x)

    def of_output(y: Array) -> Array:
        fitted = shares(y)
        found: Array = fitted - free * (1.0 - fitted.sum()) / max(len(y) - 1 - free.sum(), 1)
        return found

    return of_output


def shares_at(x: Array) -> Callable[[Array], Array]:
    """Return the shares of the functions as fitted (Li et al. 2010), of any output: SALib's `S`."""
    rows, factors = x.shape
    basis = _splines(x)
    normal = cho_factor(basis.T @ basis + PENALTY * np.eye(basis.shape[1]))

    def of_output(y: Array) -> Array:
        centred = y - y.mean()
        together = centred @ basis
        # The covariance of the output and the sum of a factor's splines times their coefficients.
        shares = (together * cho_solve(normal, together)).reshape(factors, -1).sum(axis=-1)
        # Covariances divide by n - 1 and the variance by n, as theirs.
        found: Array = shares / (centred @ centred) * rows / (rows - 1)
        return found

    return of_output


def _splines(x: Array) -> Array:
    """Return the cubic B-splines of every factor over its range, (rows, factors * (pieces + 3))."""
    reach = np.ptp(x, axis=0)
    inside = (x - x.min(axis=0)) / np.where(reach > 0.0, reach, 1.0)
    knots = np.arange(-3.0, PIECES + 4.0) / PIECES
    every = BSpline.design_matrix(inside.ravel(), knots, 3)
    basis: Array = every.toarray().reshape(len(x), -1) * PIECES**3
    return basis
