"""First-order shares by a sum of functions of one factor each, fitted to the rows: HDMR.

SALib's shares (`tests/unit/analysis/given` compares them) hold what splines fit by chance; ours are
less that, by what each row is foretold without itself, so that noise may differ from row to row
(Kline, Saggio and Solvsten 2020, Leave-out estimation of variance components, Econometrica 88).
Pieces of a factor's range have as many rows each, so that none is fitted to a few far ones. Where
the output jumps beyond chance a step is added (`analysis.given.measures.jumps`).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from analysis.given.measures.intervals import Spread
from analysis.given.measures.jumps import jumps

Array = NDArray[np.float64]

#: Pieces of a factor's range, at least (Li et al. 2010, SALib).
PIECES = 5
#: Of what splines of one factor vary by, the share that is rounding: of few values some are sums of
#: others.
_ROUNDING = 1e-9
#: Functions of several factors that add up to so little, of the sum of their variances, are not
#: told apart: of two, the square of a condition index of 30 (Belsley, Kuh and Welsch 1980,
#: Regression diagnostics, section 3.2), as of two factors that correlate by 0.998.
INDISTINCT = 2.0 / (1.0 + 30.0**2)
#: Rows for each coefficient at least.
ROWS_EACH = 4
#: A piece more is a knot more; the splines are cubic.
_DEGREE = 3
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
    centred = y - y.mean()
    whole = centred @ centred
    each_own = [_apart(splines(column, pieces(rows, factors))) for column in x.T]
    basis = np.concatenate(each_own, axis=1)
    rest = centred - basis @ (_solved(basis) @ centred)
    each_own = [_with_steps(*one, rest, whole) for one in zip(each_own, x.T, strict=True)]
    ends = np.cumsum([one.shape[1] for one in each_own])
    basis = np.concatenate(each_own, axis=1)
    solved = _solved(basis)

    def of_each(columns: Array) -> Array:
        """Return columns of all functions summed over those of each factor, (rows, factors)."""
        return np.asarray(np.add.reduceat(columns, [0, *ends[:-1]], axis=1))

    functions = of_each(basis * (solved @ centred))
    # How an error of each row's output moves the shares through the functions that are fitted.
    through = of_each(solved.T * (centred @ basis))
    fitted = basis @ (solved @ centred)
    # The mean is fitted, too.
    left = np.maximum(1.0 - 1.0 / rows - np.einsum("ij,ji->i", basis, solved), _LEAST_LEFT)
    foretold = (centred - fitted) / left
    by_chance = of_each(basis * solved.T).T @ (centred * foretold)
    share = ((functions.T @ centred) - by_chance) / whole
    each = functions * centred[:, None] + through * foretold[:, None] - np.outer(centred**2, share)
    each *= rows / whole
    each -= each.mean(axis=0)
    squares = np.mean(each**2, axis=0)
    # Of what each row adds alike there is no error, whatever its degrees.
    kurtosis = np.mean(each**4, axis=0) / np.maximum(squares**2, np.finfo(float).tiny)
    noise = (centred - fitted) * foretold
    parts = zip(np.split(basis, ends[:-1], axis=1), np.split(solved, ends[:-1]), strict=True)
    chance, twice = np.transpose([_chance(*part, noise, fitted) for part in parts]) / whole**2
    return share, Spread(
        variance=np.maximum(squares / rows - chance - twice, chance),
        freedom=2.0 * rows / np.maximum(kurtosis - 1.0, 0.01),
    )


def pieces(rows: int, factors: int) -> int:
    """Return in how many pieces a factor's range is cut: of more rows more, so that waves show.

    (Newey 1997, Convergence rates and asymptotic normality for series estimators.)
    """
    most = (rows // ROWS_EACH - 1) // factors + 1 - _DEGREE
    return max(PIECES, min(int(np.cbrt(rows) + 0.5), most))


def fewest_rows(factors: int) -> int:
    """Return how many rows `hdmr` takes (Li et al. 2010): so many for each of its coefficients."""
    return ROWS_EACH * (1 + (PIECES + _DEGREE - 1) * factors)


def _solved(basis: Array) -> Array:
    """Return what fits functions to an output by least squares, shape (functions, rows).

    Of functions that rows do not tell apart, those of the least sum of variances: what copies of a
    factor, to whatever digit, explain is dealt to them in equal parts. Otherwise each would have
    hundreds of times what there is, and another as much less (concurvity; Buja, Hastie and
    Tibshirani 1989, Linear smoothers and additive models, section 4).

    Args:
        basis: orthonormal functions of each factor, shape (rows, functions).
    """
    variance, together = np.linalg.eigh(basis.T @ basis)
    told = together[:, variance > INDISTINCT]
    found: Array = (told / variance[variance > INDISTINCT]) @ (basis @ told).T
    return found


def _with_steps(own: Array, column: Array, rest: Array, whole: float) -> Array:
    """Return a factor's functions, (rows, functions), with steps where what is left jumps with it.

    Args:
        own: orthonormal functions of mean 0.
        column: the factor, shape (rows,).
        rest: what the functions of all factors leave of the output, shape (rows,).
        whole: sum of squares of the output.
    """
    order = np.argsort(column, kind="stable")
    mean = np.full((len(rest), 1), len(rest) ** -0.5)
    basis = np.concatenate([mean, own[order]], axis=1)
    found, _ = jumps(rest[order], basis, column[order], whole)
    if not found:
        return own
    steps = column[:, None] >= column[order[found]]
    return _apart(np.concatenate([own, steps], axis=1))


def _apart(splines: Array) -> Array:
    """Return orthonormal functions of mean 0 of which splines consist, (rows, functions)."""
    left, size, _ = np.linalg.svd(splines - splines.mean(axis=0), full_matrices=False)
    told = size**2 > _ROUNDING * size[0] ** 2
    # Of a factor that does not vary here there is one, which is 0.
    found: Array = left[:, told] if told.any() and size[0] > 0.0 else np.zeros((len(splines), 1))
    return found


def _chance(splines: Array, solved: Array, noise: Array, fitted: Array) -> tuple[float, float]:
    """Return the variance that chance adds to a share, and what rows count twice.

    The former is that of a quadratic form of noise, 2 tr(C D C D): C is the symmetric part of what
    fits the factor's function, D has the rows' variances. The latter is what noise in the function
    adds to its product with the other functions, which stands in `functions` and in `through`.

    Args:
        splines, solved: its functions and what fits them, (rows, functions) and (functions, rows).
        noise: the rows' variances, shape (rows,).
        fitted: the sum of all functions, shape (rows,).
    """
    weighted = solved * noise
    across, beside = weighted @ splines, weighted @ solved.T
    form = (across * across.T).sum() + ((splines.T * noise) @ splines * beside).sum()
    return float(form), float(((splines @ beside) * splines).sum(axis=1) @ fitted**2)


def splines(column: Array, pieces: int) -> Array:
    """Return the B-splines of a factor, (rows, pieces + _DEGREE) unless it has few values."""
    knots = np.unique(np.quantile(column, np.linspace(0.0, 1.0, pieces + 1)))
    if len(knots) == 1:
        return np.ones((len(column), 1))
    knots = np.pad(knots, _DEGREE, mode="edge")
    found = BSpline.design_matrix(column, knots, _DEGREE).toarray()
    # Of two values the splines between them see neither.
    return np.asarray(found[:, found.any(axis=0)])
