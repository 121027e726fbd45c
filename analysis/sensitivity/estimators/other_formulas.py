"""S and ST by other formulas, which stand beside those that a study reports.

Martinez 2011: S is the correlation of B with A_B^(i), and 1 - ST that of A with A_B^(i). Fisher's
transformation gives their asymptotic intervals without resampling (Fisher 1921; for these indices
Baudin et al. 2016, Numerical stability of Sobol' indices estimation formula). They take rows as
independent and outputs as normal, so for Sobol points they are too wide, and for heavy tails too
narrow.

Saltelli et al. 2008: products that are not centred, to see what centring does. They need all runs
at once and are no part of what is streamed.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from analysis.sensitivity.estimators.intervals import Estimate, check_level
from analysis.sensitivity.estimators.weightings import SQUARED, Weighted

Array = NDArray[np.float64]

#: Of pairs of runs that both succeeded: one of B or A, one of A_B^(i), and their difference.
_PARTS = ("base", "mixed", "gap")
_BASES = ("b", "a")

#: What `terms` adds up.
SUMS = tuple(f"{part}_{base}{end}" for base in _BASES for part in _PARTS for end in ("", SQUARED))


def terms(a: Array, b: Array, mixed: Array) -> dict[str, Array]:
    """Return what rows add to `SUMS`, for the correlations of Martinez 2011.

    Args:
        a, b: shape (rows, outputs, 1), nan where a run failed.
        mixed: A_B^(i), shape (rows, outputs, factors).
    """
    found: dict[str, Array] = {}
    for name, base in (("b", b), ("a", a)):
        gap = mixed - base
        there = ~np.isnan(gap)
        parts = (np.where(there, base, np.nan), np.where(there, mixed, np.nan), gap)
        for part, values in zip(_PARTS, parts, strict=True):
            found[f"{part}_{name}"] = found[f"{part}_{name}{SQUARED}"] = values[None]
    return found


def correlations(sums: Weighted, level: float) -> dict[str, Estimate]:
    """Return "first_order" and "total_order" by Martinez 2011, shape (outputs, factors).

    One minus a correlation is (V(x - y) - (sd(x) - sd(y))^2) / (2 sd(x) sd(y)), whose variances
    come from exact sums: a large mean costs no digits, and a factor of no influence has ST = 0
    exactly.

    Raises:
        ValueError: the level is not between 0 and 1.
    """
    short = {base: _short_of_one(sums, base) for base in _BASES}
    first, total = (
        fisher(1.0 - short[base], sums.count(f"gap_{base}")[0], level) for base in _BASES
    )
    return {
        "first_order": first,
        "total_order": Estimate(value=short["a"], low=1.0 - total.high, high=1.0 - total.low),
    }


def fisher(correlation: Array, n: NDArray[np.int64], level: float) -> Estimate:
    """Return correlations of n pairs with Fisher's intervals (Fisher 1921), from four pairs on.

    Raises:
        ValueError: the level is not between 0 and 1.
    """
    check_level(level)
    width = np.where(n > 3, ndtri(0.5 + level / 2.0) / np.sqrt(np.maximum(n - 3.0, 1.0)), np.nan)
    with np.errstate(divide="ignore"):
        z = np.arctanh(np.clip(correlation, -1.0, 1.0))
    return Estimate(value=correlation, low=np.tanh(z - width), high=np.tanh(z + width))


def _short_of_one(sums: Weighted, base: str) -> Array:
    """Return by how much a correlation is short of 1; nan where nothing varies."""
    x, y, gap = (sums.variance(f"{part}_{base}", ddof=0)[0] for part in _PARTS)
    with np.errstate(divide="ignore", invalid="ignore"):
        product, apart = np.sqrt(x) * np.sqrt(y), np.sqrt(x) - np.sqrt(y)
        short: Array = np.where(product > 0.0, (gap - apart**2) / (2.0 * product), np.nan)
    return np.clip(short, 0.0, 2.0)


def uncentred(rows: Array) -> tuple[Array, Array]:
    """Return first- and total-order indices by Saltelli et al. 2008, equations 4.21 and 4.23.

    All factors share an error of the size of mean / standard deviation.

    Args:
        rows: one output's values at A, B and A_B^(i), shape (rows, factors + 2), nan where a run
            failed; every pair of values is used.

    Returns:
        Two arrays of shape (factors,), nan where nothing varies.
    """
    a, b, mixed = rows[:, 0], rows[:, 1], rows[:, 2:].T
    first = np.array([_share(b, b, one) for one in mixed])
    total = np.array([1.0 - _share(b, a, one) for one in mixed])
    return first, total


def _share(base: Array, x: Array, y: Array) -> float:
    """Return (mean of x y - f0^2) / V with f0 and V of the runs of one base matrix."""
    whole = ~np.isnan(x) & ~np.isnan(y)
    if not whole.any() or not np.any(~np.isnan(base)) or not np.nanvar(base) > 0.0:
        return float("nan")
    return float((np.mean(x[whole] * y[whole]) - np.nanmean(base) ** 2) / np.nanvar(base))
