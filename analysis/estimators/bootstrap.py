"""Confidence intervals that stream: the Poisson bootstrap (Hanley and MacGibbon 2006).

Drawing rows with replacement is, for many rows, giving each an independent Poisson(1) count. The
counts are a pure function of (seed, row, replicate), so an interval does not depend on the order in
which rows arrive, on batching, or on how many processes share the work.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, factorial

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

from analysis.streams import Purpose, bits

REPLICATES = 200

#: Upper edges of the Poisson(1) counts 0, 1, 2, ... on the grid of 32 bit numbers.
_EDGES = np.floor(
    2.0**32 * np.cumsum([exp(-1.0) / factorial(count) for count in range(13)])
).astype(np.uint64)


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A statistic of every column and its confidence interval; nan where it is undefined."""

    value: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]


def weights(seed: int, rows: Sequence[int]) -> NDArray[np.float64]:
    """Return how often each row counts, shape (1 + REPLICATES, rows).

    The first weighting counts every row once: it is the sample itself.
    """
    words = np.stack([bits(seed, Purpose.BOOTSTRAP, row, REPLICATES // 2) for row in rows])
    # As bytes in a fixed order, so that machines of either endianness agree.
    uniform = words.astype("<u8").view("<u4")
    counts = np.ones((1 + REPLICATES, len(rows)))
    counts[1:] = np.searchsorted(_EDGES, uniform.T.astype(np.uint64), side="right")
    return counts


def estimate(statistic: NDArray[np.float64], n: NDArray[np.int64], level: float) -> Estimate:
    """Return the first weighting's statistic with an interval from the others.

    The interval is the expanded percentile interval of Hesterberg 2015 (What teachers should know
    about the bootstrap): percentiles further out than the level's, as far as Student's t lies
    outside the normal distribution, because plain percentiles are too narrow for few rows. It takes
    rows as independent, so it is wider than need be for Sobol points.

    Args:
        statistic: shape (1 + REPLICATES, ...), nan where a replicate leaves it undefined.
        n: from how many rows it was computed, shape (...); there is no interval from one row.
        level: of the two-sided interval, between 0 and 1.

    Raises:
        ValueError: the level is not between 0 and 1.
    """
    if not 0.0 < level < 1.0:
        raise ValueError(f"level of an interval must be between 0 and 1, not {level:g}")
    value, replicates = statistic[0], statistic[1:]
    rows = np.maximum(n, 2).astype(np.float64)
    tail = ndtr(np.sqrt(rows / (rows - 1.0)) * stdtrit(rows - 1.0, (1.0 - level) / 2.0))
    known = ~np.isnan(value) & (n >= 2)
    low, high = (_quantile(replicates, probability) for probability in (tail, 1.0 - tail))
    return Estimate(
        value=value, low=np.where(known, low, np.nan), high=np.where(known, high, np.nan)
    )


def _quantile(
    replicates: NDArray[np.float64], probability: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return quantiles over the first axis of what is not nan; nan if less than half is left.

    (`numpy.nanquantile` does one column at a time, with one probability for all.)
    """
    ordered = np.sort(replicates, axis=0)  # nan last
    count = np.sum(~np.isnan(ordered), axis=0)
    last = np.maximum(count - 1, 0)
    place = probability * last
    below = np.floor(place).astype(np.intp)
    a = np.take_along_axis(ordered, below[None], axis=0)[0]
    b = np.take_along_axis(ordered, np.minimum(below + 1, last)[None], axis=0)[0]
    return np.where(count >= len(replicates) / 2, a + (place - below) * (b - a), np.nan)
