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
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtr

from analysis.designs.streams import Purpose, bits

Array = NDArray[np.float64]

#: How often the largest statistic is drawn.
DRAWS = 1000


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


@lru_cache(maxsize=8)
def _normal(blocks: int) -> Array:
    """Return normal numbers, always the same, shape (draws, blocks, blocks)."""
    shape = (DRAWS, blocks, blocks)
    words = bits(0, Purpose.BAND, blocks, int(np.prod(shape)))
    uniform = ((words >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52
    drawn: Array = ndtri(uniform).reshape(shape)
    drawn.setflags(write=False)
    return drawn
