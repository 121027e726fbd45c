"""What another scramble of the same Sobol points does to intervals of elementary effects.

Our sequences have a random linear scramble and a digital shift (Matousek 1998), which give the mean
of a function that is linear in a factor the same mean square error as Owen's nested scramble (Owen
1995, Randomly permuted (t, m, s)-nets and (t, s)-sequences; Owen 2003, Variance with alternative
scramblings of digital nets), but another distribution: few sequences have all the error, the others
next to none. Of nested scrambles errors are normal in the limit (Loh 2003, On the asymptotic
distribution of scrambled net quadrature), which is what Student's interval of eight blocks takes
them for. A nested scramble is no sampling of ours: this module is for comparing.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from analysis.designs import BLOCKS
from analysis.designs.points import paired
from analysis.designs.radial import radial_row
from analysis.sensitivity.curves.points import REPLICATES
from analysis.sensitivity.estimators import MorrisEstimator
from analysis.sensitivity.estimators.weightings import FIRST

Array = NDArray[np.float64]

_BITS = 30
#: Rows of a study at most.
ROWS = 512


def nested(points: NDArray[np.int64], rng: np.random.Generator) -> Array:
    """Return points of the grid of 2^-30, shape (points, dimensions), with a nested scramble.

    Every binary digit of a coordinate is flipped, or not, by a coin that belongs to all digits
    before it (Owen 1995). What comes after the last digit is uniform.
    """
    flips = np.zeros_like(points)
    for dimension, coordinate in enumerate(points.T):
        for digit in range(_BITS):
            _, before = np.unique(coordinate >> (_BITS - digit), return_inverse=True)
            coins = rng.integers(2, size=before.max() + 1)
            flips[:, dimension] |= coins[before] << (_BITS - 1 - digit)
    found: Array = ((points ^ flips) + rng.random(points.shape)) * 2.0**-_BITS
    return found


@lru_cache(maxsize=1)
def _sobol(points: int, dimensions: int) -> NDArray[np.int64]:
    from scipy.stats import qmc

    plain = qmc.Sobol(dimensions, scramble=False, bits=_BITS).random(points)
    return np.asarray(np.rint(plain * 2.0**_BITS), dtype=np.int64)


@lru_cache(maxsize=1)
def _rows(seed: int, factors: int) -> Array:
    """Return the rows of a radial design like ours, eight sequences with nested scrambles."""
    points = np.empty((ROWS, 2 * factors))
    for block in range(BLOCKS):
        rng = np.random.default_rng([seed, block])
        points[block::BLOCKS] = nested(_sobol(ROWS // BLOCKS, 2 * factors), rng)
    return radial_row(paired(np.clip(points, 2.0**-40, 1.0 - 2.0**-40)))


class LinearlyScrambled(MorrisEstimator):
    """Elementary effects at the points of a curve, of our rows, which it has by `rows`."""

    weightings = FIRST + REPLICATES

    def rows_of(self, rows: Sequence[int]) -> Array:
        """Return the points of rows in the unit cube, shape (rows, factors + 1, factors)."""
        return self._designed(rows)


class NestedScrambled(LinearlyScrambled):
    """The same of rows from sequences with nested scrambles (Owen 1995)."""

    def _designed(self, rows: Sequence[int]) -> Array:
        return _rows(self.seed, self.factors)[np.asarray(rows)]


SCRAMBLES = {"linear": LinearlyScrambled, "nested": NestedScrambled}
