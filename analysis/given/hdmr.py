"""First-order shares by a sum of functions of one factor each, fitted to the rows: HDMR.

SALib gives the same numbers for many rows (`tests/unit/analysis/given` compares them), but is about
to retire what gives them. Its shares hold what splines fit by chance; ours are less that, by what
each row is foretold without itself, so that noise may differ from row to row (Kline, Saggio and
Solvsten 2020, Leave-out estimation of variance components, Econometrica 88).
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.linalg import cho_factor, cho_solve

from analysis.given.intervals import Spread

Array = NDArray[np.float64]

#: Pieces of a factor's range, and how much large coefficients cost (Li et al. 2010, SALib).
PIECES = 5
PENALTY = 0.01
#: Splines of a factor.
SPLINES = PIECES + 3
#: A row that is fitted nearly alone says nothing of how it would be foretold.
_LEAST_LEFT = 0.01


def hdmr(x: Array, y: Array) -> Array:
    """Return each factor's share of the variance, less what its splines fit by chance.

    The covariance of the output and the factor's function: the sum of what the factor explains and
    of what it shares with those that it depends on (Li et al. 2010, Global sensitivity analysis for
    systems with independent and/or correlated inputs, equations 19 to 21).

    Args:
        x: shape (rows, factors).
        y: shape (rows,).

    Returns:
        Shape (factors,); below 0 where a factor explains less than chance does.
    """
    return leave_out(x, y)[0]


def leave_out(x: Array, y: Array) -> tuple[Array, Spread]:
    """Return the shares of `hdmr` and how they vary, without resampling.

    What chance adds to a share is the sum over the rows of their leverage on themselves times their
    variance, which is the product of the output and the error of foretelling it from the other
    rows (Kline et al. 2020, equation 4). The variance of a share is that of its mean over the rows,
    linearised, which counts what chance adds twice, less that once (their section 4). Its degrees
    of freedom go by the fourth moment of what each row adds (Satterthwaite 1946).
    """
    rows, factors = x.shape
    basis = _splines(x)
    solved = cho_solve(_normal(basis), basis.T)
    centred = y - y.mean()
    whole = centred @ centred
    about = basis - basis.mean(axis=0)

    def of_each(columns: Array) -> Array:
        """Return columns of all splines summed over those of each factor, (rows, factors)."""
        return np.asarray(columns.reshape(rows, factors, SPLINES).sum(axis=-1))

    functions = of_each(about * (solved @ centred))
    fitted = basis @ (solved @ centred)
    left = np.maximum(1.0 - np.einsum("ij,ji->i", basis, solved), _LEAST_LEFT)
    foretold = (centred - fitted) / left
    by_chance = of_each(about * solved.T).T @ (centred * foretold)
    share = ((functions.T @ centred) - by_chance) / whole * rows / (rows - 1)
    each = functions * (centred + foretold)[:, None] * rows / whole
    each -= share * centred[:, None] ** 2 * rows / whole
    each -= each.mean(axis=0)
    squares = np.mean(each**2, axis=0)
    # Of what each row adds alike there is no error, whatever its degrees.
    kurtosis = np.mean(each**4, axis=0) / np.maximum(squares**2, np.finfo(float).tiny)
    chance = _chance(about, solved, (centred - fitted) * foretold) / whole**2
    return share, Spread(
        variance=np.maximum(squares / rows - chance, chance),
        freedom=2.0 * rows / np.maximum(kurtosis - 1.0, 0.01),
    )


def _chance(about: Array, solved: Array, noise: Array) -> Array:
    """Return the variance of the quadratic forms of noise that chance is, (factors,).

    2 tr(C D C D), C the symmetric part of what fits a factor's function, D the rows' variances.
    """
    found = []
    for first in range(0, about.shape[1], SPLINES):
        own = slice(first, first + SPLINES)
        splines, weighted = about[:, own], solved[own] * noise
        across = weighted @ splines
        beside = (splines.T * noise) @ splines * (weighted @ solved[own].T)
        found.append((across * across.T).sum() + beside.sum())
    return np.array(found)


def shares_at(x: Array) -> Callable[[Array], Array]:
    """Return the shares of the functions as fitted (Li et al. 2010), of any output: SALib's `S`."""
    rows, factors = x.shape
    basis = _splines(x)
    normal = _normal(basis)

    def of_output(y: Array) -> Array:
        centred = y - y.mean()
        together = centred @ basis
        # The covariance of the output and the sum of a factor's splines times their coefficients.
        shares = (together * cho_solve(normal, together)).reshape(factors, -1).sum(axis=-1)
        # Covariances divide by n - 1 and the variance by n, as theirs.
        found: Array = shares / (centred @ centred) * rows / (rows - 1)
        return found

    return of_output


def _normal(basis: Array) -> tuple[Array, bool]:
    """Return the factorised normal equations of the splines."""
    factorised: tuple[Array, bool] = cho_factor(basis.T @ basis + PENALTY * np.eye(basis.shape[1]))
    return factorised


def _splines(x: Array) -> Array:
    """Return the cubic B-splines of every factor over its range, (rows, factors * SPLINES)."""
    reach = np.ptp(x, axis=0)
    inside = (x - x.min(axis=0)) / np.where(reach > 0.0, reach, 1.0)
    knots = np.arange(-3.0, PIECES + 4.0) / PIECES
    every = BSpline.design_matrix(inside.ravel(), knots, 3)
    basis: Array = every.toarray().reshape(len(x), -1) * PIECES**3
    return basis
