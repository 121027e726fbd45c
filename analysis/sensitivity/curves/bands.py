"""Bands that hold a whole curve as often as an interval holds a number.

Ninety of a hundred intervals hold their point of the curve; that all points are held at once is
rarer. How much, depends on how the points err together, and of that the eight blocks of rows tell,
as they tell how far each point errs: the points of a Sobol sequence leave a curve other errors than
independent rows would, and such as neighbours share far less (where effects change their sign, the
bootstrap's replicates err together and the blocks do not). The largest of the Student's statistics
of all points is drawn a thousand times, each from as many blocks that err together like those seen
(sup-t band: Montiel Olea and Plagborg-Moller 2019, Simultaneous confidence bands: theory,
implementation, and an application to SVARs); the level that its quantile has for one point is the
level of the intervals that make up the band, whatever kind of interval suits the index.

Of many points some have eight blocks that agree by chance, and it is these that a band misses. So
no end is nearer than with a standard error that leans on those of the other points (moderated
t-statistics: Smyth 2004, Linear models and empirical Bayes methods for assessing differential
expression), each in units of what independent rows would err, which the bootstrap tells.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, ndtri, polygamma, stdtr, stdtrit

from analysis.designs.streams import Purpose, bits
from analysis.sensitivity.estimators.intervals import jackknife_error

Array = NDArray[np.float64]

#: How often the largest statistic is drawn.
DRAWS = 1000

#: Degrees of freedom, at most, that the other points add to a point's own.
MOST_FREEDOM = 200.0


def band_level(without: Array, present: NDArray[np.bool_], level: float) -> float:
    """Return the level of intervals that hold all points at once with probability `level`.

    By Montiel Olea and Plagborg-Moller 2019; never beyond what Bonferroni 1936 asks for.

    Args:
        without: the index without each block of rows, shape (blocks, points); points where it is
            undefined or does not vary are left out.
        present: which blocks have rows, of the same shape; those without a row at any point are
            left out.
        level: between 0 and 1.
    """
    seen = without[present.any(axis=1)]
    blocks = len(seen)
    seen = seen[:, np.isfinite(seen).all(axis=0)]
    if blocks < 2 or not seen.size:
        return level
    off = seen - seen.mean(axis=0)
    error = np.sqrt((off * off).sum(axis=0))
    moves = error > 0.0
    if not moves.any():
        return level
    drawn = _normal(blocks) @ (off[:, moves] / error[moves])
    mean, squares = drawn.mean(axis=1), drawn.var(axis=1, ddof=1)
    largest = np.sqrt((mean * mean / squares).max(axis=-1) * blocks)
    single = 2.0 * float(stdtr(blocks - 1, np.quantile(largest, level))) - 1.0
    return float(np.clip(single, level, 1.0 - (1.0 - level) / moves.sum()))


def least_half(
    without: Array, present: NDArray[np.bool_], replicates: Array, level: float
) -> Array:
    """Return how far a band reaches at least, by moderated errors (Smyth 2004), shape (points,).

    The squared ratio of the blocks' error to the replicates' is taken for chi-square around one
    that varies from point to point by an inverse chi-square; 0 where an error is unknown or 0.

    Args:
        without, present: as `band_level`.
        replicates: the index in each replicate of the bootstrap, shape (replicates, points).
        level: of the interval of one point, between 0 and 1.
    """
    freedom = max(int(present.any(axis=1).sum()) - 1, 1)
    seen = jackknife_error(without, present)
    known = ~np.isnan(replicates)
    n = np.maximum(known.sum(axis=0), 1)
    kept = np.where(known, replicates, 0.0)
    off = np.where(known, kept - kept.sum(axis=0) / n, 0.0)
    of_rows: Array = np.sqrt((off * off).sum(axis=0) / n)
    half: Array = np.zeros_like(of_rows)
    both = (seen > 0.0) & (of_rows > 0.0)
    if both.sum() < 3:
        return half
    ratio = seen[both] / of_rows[both]
    logs = 2.0 * np.log(ratio) - digamma(freedom / 2.0) + np.log(freedom / 2.0)
    varies = float(logs.var(ddof=1) - polygamma(1, freedom / 2.0))
    prior = MOST_FREEDOM
    if varies > 0.0:
        prior = min(2.0 * _inverse_trigamma(varies), MOST_FREEDOM)
    common = np.exp(logs.mean() + digamma(prior / 2.0) - np.log(prior / 2.0))
    leaning = np.sqrt((prior * common + freedom * ratio**2) / (prior + freedom))
    half[both] = leaning * of_rows[both] * stdtrit(prior + freedom, 0.5 + level / 2.0)
    return half


def _inverse_trigamma(value: float) -> float:
    """Return where trigamma is `value`, above 0, by Newton's steps on its inverse (Smyth 2004)."""
    found = 0.5 + 1.0 / value
    for _ in range(20):
        trigamma = float(polygamma(1, found))
        found += trigamma * (1.0 - trigamma / value) / float(polygamma(2, found))
    return found


@lru_cache(maxsize=8)
def _normal(blocks: int) -> Array:
    """Return normal numbers, always the same, shape (draws, blocks, blocks)."""
    shape = (DRAWS, blocks, blocks)
    words = bits(0, Purpose.BAND, blocks, int(np.prod(shape)))
    uniform = ((words >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52
    drawn: Array = ndtri(uniform).reshape(shape)
    drawn.setflags(write=False)
    return drawn
