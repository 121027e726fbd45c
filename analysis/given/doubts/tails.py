"""Whether few rows make up what indices are shares of: the output's variance, or a factor's part.

A variance whose tail is heavy depends on how many of its rare large values a sample has (Kish 1965,
Survey sampling, section 11.7). An output that a factor of such a tail moves has it too, and may not
show it yet beside what others do: 200 rows of a Pareto factor of index 3 that makes half the
variance had a kurtosis below 6 in half of the tables.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc, ndtri
from scipy.stats import rankdata

from analysis.given.measures.delta import kurtosis
from analysis.sensitivity.judgement.screening import SHARE_OF_VARIANCE
from analysis.sensitivity.judgement.trust import ENOUGH_RUNS, HEAVY

Array = NDArray[np.float64]

#: How likely an output of one table is said to follow a factor's tail if it does not.
_BY_CHANCE = 1e-3
#: A heavy tail's fourth moment rests on the largest value alone, so that its standard error is as
#: large as itself: the kurtosis may be so many times what is seen.
_TIMES = 2.0
#: Standard errors by which chance makes one of two exponential tails seem heavier than that in one
#: of twenty factors. (Looked at on tables of 100 to 500 rows, of which none of 200 with uniform or
#: normal factors is said to follow a tail.)
_HEAVIER = 1.96
#: The kurtosis of a normal distribution, which the sum of what many factors do tends to.
_NORMAL = 3.0


def on_few_rows(output: str, y: Array, factors: Sequence[str], x: Array) -> str:
    """Return the remark on an output whose variance few rows make up (Kish 1965), or nothing.

    Args:
        output, factors: names.
        y: shape (rows,).
        x: shape (rows, factors).
    """
    heavy = kurtosis(y)
    if _few(heavy, len(y)):
        return (
            f"The variance of {output} rests on few rows: as many as {len(y) / heavy:.0f} of equal "
            f"size would tell it, of {len(y):,} (its kurtosis is {heavy:.0f}). Shares of it may be "
            "far off, further than their intervals say; look at its logarithm or its ranks, too."
        )
    # What levels off, as a reaction that saturates, has no tail of its own, whatever moves it.
    if heavy <= _NORMAL:
        return ""
    tails = [
        f"{name} (kurtosis {kurtosis(one):.0f})"
        for name, one in zip(factors, x.T, strict=True)
        if _few(kurtosis(one), len(y)) and _follows(one, y, _BY_CHANCE / len(factors))
    ]
    if not tails:
        return ""
    return (
        f"{output} follows the heavy tail of {', '.join(tails)}, and larger values than these "
        f"{len(y):,} rows show may make up much of its variance: shares of it may be far off, "
        "further than their intervals say; look at its logarithm or its ranks, too."
    )


def _few(heavy: float, rows: int) -> bool:
    return heavy > HEAVY and rows / heavy < ENOUGH_RUNS


def _follows(x: Array, y: Array, by_chance: float) -> bool:
    """Say whether an output grows with a factor as far as the factor does, and by what matters.

    A line through the factor explains so much that its tail may give the output a heavy one: of a
    sum of independent terms, what the kurtosis exceeds a normal one's by is the sum of the terms'
    own times the squares of their shares (cumulants add; Fisher 1930). Of a tail with more than an
    exponential's, which may have no kurtosis at all, it explains what matters. And the output does
    not only go by the factor's ranks, as a logarithm does: the line explains more than one through
    normal scores, beyond chance (Fisher's F).

    Args:
        x, y: of factor and output, shape (rows,).
        by_chance: how likely it is said of an output of the ranks.
    """
    rows = len(y)
    score = ndtri((rankdata(x) - 0.5) / rows)
    share = float(np.corrcoef(x, y)[0, 1] ** 2)
    heavy = _NORMAL + share**2 * (_TIMES * kurtosis(x) - _NORMAL) > HEAVY
    if not (heavy or (share > SHARE_OF_VARIANCE and _beyond_exponential(x))):
        return False
    by_ranks = np.column_stack([np.ones(rows), score])
    left = [
        float(np.sum((y - terms @ np.linalg.lstsq(terms, y, rcond=None)[0]) ** 2))
        for terms in (by_ranks, np.column_stack([by_ranks, (x - x.mean()) / x.std()]))
    ]
    ratio = (left[0] - left[1]) * (rows - 3) / max(left[1], np.finfo(float).tiny)
    return bool(fdtrc(1, rows - 3, ratio) < by_chance)


def _beyond_exponential(x: Array) -> bool:
    """Say whether one of a factor's tails is heavier than an exponential one.

    Of what exceeds the median the deviation is more than the mean, to which it is equal of an
    exponential tail, with a standard error of 1 / sqrt(n) of it (del Castillo, Daoudi and Lockhart
    2014, Methods to distinguish between polynomial and exponential tails, Scandinavian Journal of
    Statistics 41, 382-393).

    Args:
        x: shape (rows,).
    """
    for one in (x - np.median(x), np.median(x) - x):
        beyond = one[one > 0.0]
        if len(beyond) > 1:
            ratio = beyond.std(ddof=1) / beyond.mean()
            if (ratio - 1.0) * np.sqrt(len(beyond)) > _HEAVIER:
                return True
    return False
