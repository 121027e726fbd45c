"""Indices of any study by functions fitted to its runs, with an honest error.

The method `surrogate`, whose design and stopping are its own, is `fewer_runs`.

A Gaussian process answers, and a sparse polynomial chaos beside it where it can be had: two that
agree although they are of different kinds are more than one.

On a smooth model a hundred runs answer what sampling answers with thousands (Le Gratiet, Marelli
and Sudret 2017, Metamodel-based sensitivity analysis). On a model with a few runs gone wrong the
same fit gives nonsense that looks like interaction. So every answer carries the error of predicting
rows that were held out, and names the runs that no smooth function explains.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import sobol_indices, uniform

from analysis.designs import DEPENDENT, family, unit_row
from analysis.sensitivity.table import Table
from models.curves import names_of

#: Runs a fit uses at most: its cost grows with their cube, 400 take some seconds.
MOST_RUNS = 400

#: With fewer runs per factor a fit with one length scale each says nothing.
FEWEST_PER_FACTOR = 5

#: Parts that are held out in turn, whole rows each: runs of a row share coordinates.
FOLDS = 5

#: Held-out share of the variance explained from which the indices are worth reading.
GOOD = 0.9

#: Robust standard deviations of the held-out errors from which a run is an outlier, which must also
#: be off by half a robust standard deviation of the output.
_FAR, _LARGE = 6.0, 0.5

#: Runs gone wrong are few and lie apart: they are this share of all runs at most (or two), and the
#: least of their errors is so many times the largest of the others. Errors of a correct function at
#: a jump or a kink are many and of every size.
_FEW, _APART = 0.02, 4.0

#: Points of the fitted function that its indices are computed from; they cost little.
_POINTS = 2**11

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Fit:
    """A fitted function's indices."""

    #: How many runs it was fitted to.
    runs: int
    #: Share of the output's variance that predictions of held-out rows explain; 1 is perfect.
    held_out: float
    #: First- and total-order index by factor.
    first_order: dict[str, float]
    total_order: dict[str, float]


@dataclass(frozen=True, kw_only=True)
class Outlier:
    """A run that a smooth function through the others does not explain."""

    #: Study, row and position, as in the coordinator's table.
    instance: str
    value: float
    #: What the others let expect.
    predicted: float


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What a surrogate says of one output."""

    output: str
    fit: Fit
    outliers: tuple[Outlier, ...]
    #: The fit without the outliers; None if there are none. Leaving out what does not fit flatters
    #: its held-out error.
    without_outliers: Fit | None
    #: The same runs by a sparse polynomial chaos; None where OpenTURNS is not installed.
    chaos: Fit | None
    sentence: str

    def fits(self) -> dict[str, Fit]:
        """Return every fit by the words that a table's head has for it."""
        fits = {
            "Gaussian process": self.fit,
            "without the outliers": self.without_outliers,
            "polynomial chaos": self.chaos,
        }
        return {name: fit for name, fit in fits.items() if fit is not None}


def answer(table: Table, output: str) -> Answer:
    """Fit a Gaussian process and a polynomial chaos to a study's runs and return their indices.

    Uses the first runs of the design, base points before all others. Sources: Le Gratiet, Marelli
    and Sudret 2017; Blatman and Sudret 2011.

    Args:
        table: results of a study of any method.
        output: one of its outputs.

    Raises:
        ValueError: the study has no such output, too few runs succeeded, or nothing varies.
        ModuleNotFoundError: scikit-learn is not installed (extra `surrogate`).
    """
    plan = table.plan
    if plan.method in DEPENDENT:
        raise ValueError(
            "a surrogate's indices are those of independent factors, and a study of method "
            f"{plan.method} may have others"
        )
    if plan.groups:
        raise ValueError(
            "the factors of a group move together: a surrogate could not tell them apart"
        )
    if output not in plan.outputs:
        known = ", ".join(names_of(plan.outputs, plan.curves))
        raise ValueError(f"the study has no output {output!r}: it has {known}")
    values = table.values[:, plan.outputs.index(output)]
    lines = _lines(table, np.isfinite(values))
    wanted = FEWEST_PER_FACTOR * len(plan.factors)
    if len(lines) < wanted:
        raise ValueError(
            f"a surrogate needs {wanted} runs with {output}, and there are {len(lines)}"
        )
    y, rows = values[lines], table.rows[lines]
    if np.ptp(y) == 0.0:
        raise ValueError(
            f"{output} is the same in all {len(lines)} runs: there is nothing to explain"
        )
    x = np.stack(
        [
            unit_row(plan.method, plan.sampling, plan.seed, int(table.rows[i]), len(plan.factors))[
                int(table.positions[i])
            ]
            for i in lines
        ]
    )
    fit, predicted = _fit(x, y, rows, plan.factors)
    odd, expected = _outliers(x, y, rows, predicted)
    outliers = tuple(
        Outlier(
            instance=f"{plan.id}:{rows[i]}:{table.positions[lines[i]]}",
            value=float(y[i]),
            predicted=float(expected[i]),
        )
        for i in np.flatnonzero(odd)
    )
    better = None
    if outliers and (~odd).sum() >= wanted:
        better, _ = _fit(x[~odd], y[~odd], rows[~odd], plan.factors)
    return Answer(
        output=output,
        fit=fit,
        outliers=outliers,
        without_outliers=better,
        chaos=(chaos := _chaos(x, y, rows, plan.factors)),
        sentence=_sentence(output, fit, outliers, better, chaos),
    )


def _lines(table: Table, usable: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the lines to fit to: base points (A and B) by row, then the others by row."""
    base = table.positions < (2 if family(table.plan.method) == "saltelli" else 1)
    order = np.lexsort((table.positions, table.rows, ~base))
    chosen: NDArray[np.intp] = order[usable[order]][:MOST_RUNS]
    return chosen


def _trained(x: Array, y: Array, kernel: Any = None) -> Any:
    """Return a fitted process; its length scales are found, unless a kernel brings them."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

    start = ConstantKernel(1.0, (1e-2, 1e4)) * Matern(
        np.ones(x.shape[1]), (0.05, 100.0), nu=2.5
    ) + WhiteKernel(1e-3, (1e-9, 1.0))
    process = GaussianProcessRegressor(
        kernel or start,
        normalize_y=True,
        optimizer=None if kernel else "fmin_l_bfgs_b",
        random_state=0,
    )
    with warnings.catch_warnings():
        # A length scale at its bound means that the factor does nothing, which is an answer.
        warnings.simplefilter("ignore")
        return process.fit(x, y)


def _held_out(x: Array, y: Array, rows: NDArray[np.int64], kernel: Any) -> Array:
    """Return what each run is predicted to be from the runs of other folds."""
    predicted = np.full_like(y, np.mean(y))
    for away in _folds(rows):
        if not away.all():
            predicted[away] = _trained(x[~away], y[~away], kernel).predict(x[away])
    return predicted


def _folds(rows: NDArray[np.int64]) -> list[NDArray[np.bool_]]:
    """Return which runs are held out in turn: five parts by rank, whatever the rows' numbers."""
    fold = np.unique(rows, return_inverse=True)[1] % FOLDS
    return [fold == part for part in np.unique(fold)]


def _fit(x: Array, y: Array, rows: NDArray[np.int64], names: tuple[str, ...]) -> tuple[Fit, Array]:
    """Return the fit and what held-out runs are predicted to be, with the same length scales."""
    process = _trained(x, y)
    found = sobol_indices(
        func=lambda points: process.predict(points.T)[None],
        n=_POINTS,
        dists=[uniform()] * len(names),
        rng=np.random.default_rng(0),
    )
    first, total = (np.ravel(order).tolist() for order in (found.first_order, found.total_order))
    predicted = _held_out(x, y, rows, process.kernel_)
    return _described(y, predicted, names, first, total), predicted


def _chaos(x: Array, y: Array, rows: NDArray[np.int64], names: tuple[str, ...]) -> Fit | None:
    """Return the fit of a polynomial chaos, whose terms are picked anew without each fold."""
    from analysis.sensitivity.polynomial_chaos import fit_chaos

    try:
        whole = fit_chaos(x, y)
    except ModuleNotFoundError:
        return None
    predicted = np.full_like(y, np.mean(y))
    for away in _folds(rows):
        if np.ptp(y[~away]) > 0.0:
            predicted[away] = fit_chaos(x[~away], y[~away]).predict(x[away])
    return _described(y, predicted, names, whole.first_order, whole.total_order)


def _described(
    y: Array,
    predicted: Array,
    names: tuple[str, ...],
    first: Sequence[float],
    total: Sequence[float],
) -> Fit:
    return Fit(
        runs=len(y),
        # Below 0 if a mean would do.
        held_out=1.0 - float(np.sum((y - predicted) ** 2) / np.sum((y - y.mean()) ** 2)),
        first_order=dict(zip(names, first, strict=True)),
        total_order=dict(zip(names, total, strict=True)),
    )


def _outliers(
    x: Array, y: Array, rows: NDArray[np.int64], predicted: Array
) -> tuple[NDArray[np.bool_], Array]:
    """Return which runs are outliers, and what all runs are predicted to be from the others.

    A run gone wrong spoils the predictions around it, so those under suspicion are judged again by
    a fit to the others alone.
    """
    suspect = _far(y - predicted, y - predicted, y)
    if not suspect.any() or suspect.mean() > 0.5:
        return suspect & False, predicted
    process = _trained(x[~suspect], y[~suspect])
    expected = predicted.copy()
    expected[suspect] = process.predict(x[suspect])
    kept = _held_out(x[~suspect], y[~suspect], rows[~suspect], process.kernel_)
    odd = suspect & _far(y - expected, y[~suspect] - kept, y)
    error = np.abs(y - expected)
    error[~suspect] = np.abs(y[~suspect] - kept)
    return odd & _apart(error), expected


def _apart(error: Array) -> NDArray[np.bool_]:
    """Return which runs have errors that lie apart from all others (after Grubbs 1950)."""
    most = max(2, int(_FEW * len(error)))
    order = np.argsort(-error)
    falls = error[order[:most]] >= _APART * error[order[1 : most + 1]]
    apart = np.zeros(len(error), dtype=np.bool_)
    if falls.any():
        apart[order[: 1 + int(np.flatnonzero(falls)[-1])]] = True
    return apart


def _far(error: Array, usual: Array, y: Array) -> NDArray[np.bool_]:
    """Return which errors stand out from the usual ones and are large for the output."""
    off = np.abs(error - np.median(usual))
    odd: NDArray[np.bool_] = (off > _FAR * _robust_sd(usual)) & (off > _LARGE * _robust_sd(y))
    return odd


def _robust_sd(values: Array) -> float:
    """Return the standard deviation of a normal distribution of the same middle half."""
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))


def _sentence(
    output: str,
    fit: Fit,
    outliers: tuple[Outlier, ...],
    better: Fit | None,
    chaos: Fit | None,
) -> str:
    start = (
        f"Fitted to {fit.runs} runs, predictions of held-out rows explain {fit.held_out:.1%} of "
        f"the variance of {output}: "
    )
    if fit.held_out >= GOOD:
        sentence = start + "the surrogate's indices are worth reading."
    else:
        sentence = start + "too little, do not use the surrogate's indices."
    if outliers:
        names = ", ".join(outlier.instance for outlier in outliers[:5])
        more = f" and {len(outliers) - 5} more" if len(outliers) > 5 else ""
        sentence += f" No smooth function explains {names}{more}: look at these runs."
    if better is not None:
        sentence += (
            f" Without them held-out rows are explained to {better.held_out:.1%}, which flatters, "
            "since they were chosen by their error."
        )
    if chaos is not None:
        sentence += f" {_compared(fit, chaos)}"
    return sentence


def _compared(fit: Fit, chaos: Fit) -> str:
    """Say how a polynomial chaos does beside the process."""
    start = f"A polynomial chaos explains {max(chaos.held_out, 0.0):.1%}"
    if chaos.held_out < GOOD:
        return f"{start}, too little for its indices to be used."
    apart = max(abs(fit.total_order[name] - chaos.total_order[name]) for name in fit.total_order)
    return f"{start}; its ST are within {max(apart, 0.001):.1g} of the process's."
