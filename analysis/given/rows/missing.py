"""Whether rows without a cell lie where a factor or an output is high, low, extreme or middling.

As failures of a study do (`analysis.sensitivity.judgement.failures`): if rows are missing by
chance, the correlation with any column has the standard error 1 / sqrt(n - 1) whatever its
distribution (Pitman 1937, Significance tests which may be applied to samples from any
populations II).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, rankdata

from analysis.sensitivity.judgement.failures import FEWEST, WRONGLY

Array = NDArray[np.float64]

#: Columns that are shown.
_SHOWN = 5


def lacking(names: Sequence[str], table: Array) -> str:
    """Return the remark on rows that lack a cell, and with which columns they go (Pitman 1937).

    Args:
        names: of the columns.
        table: shape (rows, columns), nan where there is none; one row or more lacks a cell.
    """
    gone: NDArray[np.bool_] = np.asarray(np.isnan(table).any(axis=1), dtype=np.bool_)
    lack = "lacks a cell and is" if gone.sum() == 1 else "lack a cell and are"
    said = f"{gone.sum()} of {len(table)} rows {lack} left out"
    tied = _tied(names, table, gone) if gone.sum() >= FEWEST else []
    if tied:
        more = f" and {len(tied) - _SHOWN} more" if len(tied) > _SHOWN else ""
        return (
            f"{said}, and not by chance: they go with {', '.join(tied[:_SHOWN])}{more}. Indices "
            "are those of the rows that are left, not of the ranges that were sampled."
        )
    return (
        f"{said}: if cells are missing where the output is extreme, indices are too small. Nothing "
        "shows that they go with a column."
        if gone.sum() >= FEWEST
        else f"{said}: if cells are missing where the output is extreme, indices are too small."
    )


def _tied(names: Sequence[str], table: Array, gone: NDArray[np.bool_]) -> list[str]:
    """Return the columns that rows without a cell go with, and how."""
    least = float(norm.isf(WRONGLY / (4.0 * len(names))))
    found = []
    for name, column in zip(names, table.T, strict=True):
        there = ~np.isnan(column)
        rows = int(there.sum())
        if rows < FEWEST or not 0 < gone[there].sum() < rows or np.ptp(column[there]) == 0.0:
            continue
        rank = rankdata(column[there])
        for values, ways in ((rank, "high low"), (np.abs(rank - rank.mean()), "extreme middling")):
            if np.ptp(values) == 0.0:
                continue
            off = float(np.corrcoef(values, gone[there])[0, 1]) * np.sqrt(rows - 1.0)
            if abs(off) > least:
                found.append((abs(off), f"{ways.split()[int(off < 0.0)]} {name}"))
    return [said for _, said in sorted(found, reverse=True)]
