"""Other estimators of S and ST on the same runs, by name, to see what the choice does.

Martinez 2011 with the intervals of Baudin et al. 2016, and Saltelli et al. 2008 without centring.

The indices that studies report are the centred ones of `SaltelliEstimator`. These stand beside them
in a report: they need all runs at once and are no part of what is streamed.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.designs import row_width
from analysis.sensitivity.estimators import Estimate
from analysis.sensitivity.estimators.martinez import fisher
from analysis.sensitivity.table import Table

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Compared:
    """First- and total-order indices by one estimator, arrays of shape (factors,)."""

    #: In a few words, with its source.
    description: str
    first: Estimate
    total: Estimate


def rows_of(table: Table, output: str) -> Array:
    """Return an output's values at A, B and A_B^(i), shape (rows, factors + 2).

    nan where no value came. Rows are those of Saltelli et al. 2010.
    """
    o, factors = table.plan.outputs.index(output), len(table.plan.factors)
    rows = np.full((table.plan.rows, row_width(table.plan.method, factors)), np.nan)
    rows[table.rows, table.positions] = table.values[:, o]
    return rows[:, : factors + 2]


def compare(rows: Array, level: float = 0.9) -> Mapping[str, Compared]:
    """Return indices by Martinez 2011 and, uncentred, by Saltelli et al. 2008.

    Args:
        rows: one output's values, shape (rows, factors + 2), nan where a run failed; every pair of
            values is used.
        level: of the intervals.

    Returns:
        "martinez" with intervals by Fisher's transformation, and "uncentred" without intervals.
    """
    a, b, mixed = rows[:, 0], rows[:, 1], rows[:, 2:].T
    with_b = [_correlation(b, one) for one in mixed]
    with_a = [_correlation(a, one) for one in mixed]
    first, total = (_with_interval(pairs, level) for pairs in (with_b, with_a))
    return {
        "martinez": Compared(
            description="Martinez 2011: correlations, intervals by Fisher's transformation "
            "(Baudin et al. 2016)",
            first=first,
            total=Estimate(value=1.0 - total.value, low=1.0 - total.high, high=1.0 - total.low),
        ),
        "uncentred": Compared(
            description="Products without centring (Saltelli et al. 2008, equations 4.21 and "
            "4.23): all factors share an error of the size of mean / standard deviation",
            first=_bare([_uncentred(b, b, one) for one in mixed]),
            total=_bare([1.0 - _uncentred(b, a, one) for one in mixed]),
        ),
    }


def _correlation(x: Array, y: Array) -> tuple[float, int]:
    """Return the correlation of the pairs that are whole, and their number."""
    whole = ~np.isnan(x) & ~np.isnan(y)
    n = int(whole.sum())
    if n < 2 or np.ptp(x[whole]) == 0.0 or np.ptp(y[whole]) == 0.0:
        return np.nan, n
    return float(np.corrcoef(x[whole], y[whole])[0, 1]), n


def _with_interval(correlations: list[tuple[float, int]], level: float) -> Estimate:
    value = np.array([r for r, _ in correlations])
    return fisher(value, np.array([n for _, n in correlations], dtype=np.int64), level)


def _uncentred(base: Array, x: Array, y: Array) -> float:
    """Return (mean of x y - f0^2) / V with f0 and V of the runs of one base matrix."""
    whole = ~np.isnan(x) & ~np.isnan(y)
    if not whole.any() or not np.any(~np.isnan(base)) or not np.nanvar(base) > 0.0:
        return float("nan")
    return float((np.mean(x[whole] * y[whole]) - np.nanmean(base) ** 2) / np.nanvar(base))


def _bare(values: list[float]) -> Estimate:
    value = np.array(values)
    return Estimate(value=value, low=np.full_like(value, np.nan), high=np.full_like(value, np.nan))
