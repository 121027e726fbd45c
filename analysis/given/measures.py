"""Indices of given samples, as SALib computes them, and HSIC (Da Veiga 2015).

Each takes x of shape (rows, factors) and y of shape (rows,), and returns shape (factors,). Rows
must be in no order that has to do with the factors: those with equal values stay as they come.
"""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.given.hsic import hsic
from analysis.given.intervals import by_bootstrap, by_halves

Array = NDArray[np.float64]

#: Harmonics of RBD-FAST and slices of PAWN: SALib's own.
HARMONICS = 10
SLICES = 10


def rbd_fast(x: Array, y: Array) -> Array:
    """Return first-order indices by random balance designs, with the bias taken off.

    Tarantola, Gatelli and Mara 2006; for any sample Plischke 2010; bias Tissot and Prieur 2012.
    """
    from SALib.analyze.rbd_fast import compute_first_order, permute_outputs, unskew_S1

    found = []
    for column in x.T:
        raw = compute_first_order(permute_outputs(column, y), HARMONICS)
        found.append(unskew_S1(raw, HARMONICS, len(y)))
    return np.array(found, dtype=np.float64)


def pawn(x: Array, y: Array) -> Array:
    """Return the median distance of conditional distributions (Pianosi and Wagener 2018)."""
    from SALib.analyze.pawn import analyze

    with _quiet():
        found = analyze(_problem(x), _ranks(x), y, S=SLICES)
    return np.asarray(found["median"], dtype=np.float64)


def delta(x: Array, y: Array) -> Array:
    """Return Borgonovo's delta, eqn 26 of Plischke, Borgonovo and Smith 2013."""
    from SALib.analyze.delta import calc_delta

    rows = len(y)
    # As `SALib.analyze.delta.analyze` cuts a sample, of which it is a part of its own.
    power = 2.0 / (7.0 + np.tanh((1500.0 - rows) / 500.0))
    edges = np.linspace(0, rows, min(int(np.ceil(rows**power)), 48) + 1)
    grid = np.linspace(y.min(), y.max(), 100)
    with _quiet():
        try:
            found = [calc_delta(y, grid, column, edges) for column in x.T]
        except np.linalg.LinAlgError:
            # Of values that are all but the same no density can be drawn.
            found = [np.nan] * x.shape[1]
    return np.array(found, dtype=np.float64)


def r2_hsic(x: Array, y: Array) -> Array:
    """Return R2-HSIC with Gaussian kernels (Da Veiga 2015)."""
    return hsic(x, y).r2


def unless_still(index: Callable[[Array, Array], Array]) -> Callable[[Array, Array], Array]:
    """Return an index that is 0 where the output does not vary, as in parts of a rare event's."""

    def of_what_varies(x: Array, y: Array) -> Array:
        return index(x, y) if np.ptp(y) > 0.0 else np.zeros(x.shape[1])

    return of_what_varies


@dataclass(frozen=True, kw_only=True)
class Measure:
    """An index, how its interval is made, and what a reader must know of it."""

    name: str
    #: In a table.
    symbol: str
    index: Callable[[Array, Array], Array]
    half_width: Callable[..., Array]
    #: It grows with the square of the rows, or is slow: of more rows so many are drawn.
    most_rows: int
    #: No index is below: of what only noise can be, an interval ends there.
    least: float | None
    #: An index of no influence is not 0: what it is, is found by permuting the output.
    biased: bool
    #: Points of a low-discrepancy sequence mislead it.
    needs_drawn: bool = False
    assumes: str
    source: str


MEASURES = (
    Measure(
        name="rbd_fast",
        symbol="S",
        index=unless_still(rbd_fast),
        half_width=by_halves,
        most_rows=20_000,
        least=None,
        biased=False,
        needs_drawn=True,
        assumes="factors are independent of each other, points are drawn at random or as a Latin "
        "hypercube (of Sobol's points it is withheld), and the output changes with each of them "
        f"no more often than {HARMONICS} harmonics follow; says nothing of interactions",
        source="Tarantola, Gatelli and Mara 2006; Plischke 2010; Tissot and Prieur 2012 (SALib)",
    ),
    Measure(
        name="delta",
        symbol="δ",
        index=unless_still(delta),
        half_width=by_bootstrap,
        most_rows=2_000,
        least=0.0,
        biased=True,
        assumes="the output has a density; is never 0 of a finite sample, so compare it with "
        "`chance`; its interval says where another sample of as many rows would put it",
        source="Borgonovo 2007; Plischke, Borgonovo and Smith 2013 (SALib)",
    ),
    Measure(
        name="pawn",
        symbol="PAWN",
        index=unless_still(pawn),
        half_width=by_bootstrap,
        most_rows=20_000,
        least=0.0,
        biased=True,
        assumes=f"a factor's {SLICES} slices are thin enough to be one value of it; is never 0 of "
        "a finite sample, so compare it with `chance`; its interval says where another sample of "
        "as many rows would put it",
        source="Pianosi and Wagener 2018 (SALib)",
    ),
    Measure(
        name="hsic",
        symbol="R²-HSIC",
        index=unless_still(r2_hsic),
        half_width=by_halves,
        most_rows=1_000,
        least=None,
        biased=False,
        assumes="nothing of the form of the dependence; how large it is depends on the kernels, so "
        "rank by it, and take the test for yes or no",
        source="Gretton et al. 2007; Da Veiga 2015; Song et al. 2012",
    ),
)


def _problem(x: Array) -> dict[str, object]:
    factors = x.shape[1]
    return {"num_vars": factors, "names": [f"x{i}" for i in range(factors)]}


def _ranks(x: Array) -> Array:
    """Return the rank of every value in its column; PAWN looks at no more, and leaves ties out."""
    return np.argsort(np.argsort(x, axis=0, kind="stable"), axis=0).astype(np.float64)


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep what SALib warns of, and how it changes warnings and NumPy's seed, to itself."""
    wording = warnings.formatwarning
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
    warnings.formatwarning = wording
