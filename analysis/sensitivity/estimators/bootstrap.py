"""What other samples might have said: the Poisson bootstrap (Hanley and MacGibbon 2006), streaming.

Drawing rows with replacement is, for many rows, giving each an independent Poisson(1) count. The
counts are a pure function of (seed, row, replicate), so a replicate does not depend on the order in
which rows arrive, on batching, or on how many processes share the work. Replicates take rows as
independent: they err on the side of caution for Sobol points. They tell how stable a ranking is and
whether failures depend on factors; the intervals of indices are those of `intervals`.
"""

from collections.abc import Sequence
from math import exp, factorial

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, stdtrit

from analysis.designs.streams import Purpose, bits_of
from analysis.sensitivity.estimators.intervals import Estimate, check_level

REPLICATES = 200

#: First numbers beyond the Poisson(1) counts 0, 1, 2, ... on the grid of 32 bit numbers.
_EDGES = np.floor(
    2.0**32 * np.cumsum([exp(-1.0) / factorial(count) for count in range(13)])
).astype(np.uint32)


def replicate_weights(seed: int, rows: Sequence[int]) -> NDArray[np.uint8]:
    """Return how often each replicate counts each row, shape (REPLICATES, rows).

    Source: Hanley and MacGibbon 2006.
    """
    words = bits_of(seed, Purpose.BOOTSTRAP, rows, REPLICATES // 2)
    # As bytes in a fixed order, so that machines of either endianness agree.
    uniform = words.astype("<u8", copy=False).view("<u4")
    counts = np.zeros(uniform.shape, dtype=np.uint8)
    for edge in _EDGES:
        counts += uniform >= edge
    return counts.T


def percentiles(statistic: NDArray[np.float64], n: NDArray[np.int64], level: float) -> Estimate:
    """Return the first weighting's statistic with an interval from the others.

    The interval is the expanded percentile interval of Hesterberg 2015 (What teachers should know
    about the bootstrap): percentiles further out than the level's, as far as Student's t lies
    outside the normal distribution, because plain percentiles are too narrow for few rows.

    Args:
        statistic: shape (1 + REPLICATES, ...), nan where a replicate leaves it undefined.
        n: from how many rows it was computed, shape (...); there is no interval from one row.
        level: of the two-sided interval, between 0 and 1.

    Raises:
        ValueError: the level is not between 0 and 1.
    """
    check_level(level)
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
