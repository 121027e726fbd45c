"""Whether runs fail where an output is high or low, though what failed has no output.

The runs of a row share all coordinates but one, so the outputs of those that succeeded tell of what
the failed ones would have been. If failing has nothing to do with an output, the share of a row's
runs that failed and the mean of the others are uncorrelated, and their correlation over n rows has
the standard error 1 / sqrt(n - 1) whatever their distributions (Pitman 1937, Significance tests
which may be applied to samples from any populations II).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.sensitivity.estimators.weightings import Weighted

Array = NDArray[np.float64]

#: What `row_terms` adds up, per output.
ROW_SUMS = ("row_mean", "row_mean_squared", "row_failed", "row_failed_squared", "row_product")


@dataclass(frozen=True, kw_only=True)
class Association:
    """How failing goes with each output; arrays of shape (outputs,), nan where nothing failed."""

    #: Of a row's failed share with the mean of its other runs.
    correlation: Array
    #: Rows that it is from.
    rows: NDArray[np.int64]
    #: By how many standard deviations of row means a failed run's row is off, per correlation.
    off: Array


def row_terms(values: Array) -> dict[str, Array]:
    """Return what rows add to `ROW_SUMS`, for the correlation of Pitman 1937.

    Args:
        values: of runs alike, shape (rows, runs, outputs), nan where one failed.
    """
    runs, failed = values.shape[1], np.isnan(values)
    if failed.any():
        lost, total = failed.sum(axis=1), np.where(failed, 0.0, values).sum(axis=1)
    else:
        # As most rows are: sums along short rows take longer than all else here.
        total = values.sum(axis=1)
        lost = np.zeros(total.shape, dtype=np.intp)
    there = lost < runs
    share = np.where(there, lost / runs, np.nan)
    mean = np.where(there, total / np.maximum(runs - lost, 1), np.nan)
    return {
        "row_mean": mean[None],
        "row_mean_squared": mean[None],
        "row_failed": share[None],
        "row_failed_squared": share[None],
        "row_product": (share * mean)[None],
    }


def association(sums: Weighted) -> Association:
    """Return how failing goes with each output (Pitman 1937)."""
    mean, share = sums.mean("row_mean")[0], sums.mean("row_failed")[0]
    spread, uneven = (
        np.sqrt(sums.variance(name, ddof=0)[0]) for name in ("row_mean", "row_failed")
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        together = sums.mean("row_product")[0] - mean * share
        correlation = together / (spread * uneven)
        off = uneven / share
    # What rounding leaves of outputs that do not vary is no correlation.
    known = (uneven > 0.0) & (spread > 1e-12 * np.abs(mean))
    return Association(
        correlation=np.where(known, correlation, np.nan),
        rows=sums.count("row_mean")[0],
        off=np.where(known, off, np.nan),
    )
