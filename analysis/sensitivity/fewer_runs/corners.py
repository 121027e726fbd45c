"""How steeply a function rises where two factors near an end of their ranges together.

Few runs are close to such a corner: of 256 runs, one within a sixteenth of both ranges. A pole
there, which no held-out run tells of, may have a sixth of the variance where no run is.
"""

import numpy as np
from numpy.typing import NDArray

from analysis.sensitivity.fewer_runs.parts import CELLS

Array = NDArray[np.float64]


def in_corners(pairs: Array, runs: int) -> float:
    """Return how much the innermost run of a corner of two factors may stand for, at most.

    Of a part of the second order, its variance within a box at the corner times the box's area: of
    a smooth function it falls to a sixteenth when the box's sides are halved, of a pole by less.
    How it falls from sides of 1/2 to 1/4 is taken on to the box that one run fills, as far as it is
    known that a function is as rough at small scales as at larger ones (Mallat and Hwang 1992,
    Singularity detection and processing with wavelets).

    Args:
        pairs: of `Surrogate.pairs`, of an output of variance 1.
        runs: how many the surrogate was fitted to.
    """
    most = 0.0
    for at in (pairs, pairs[:, ::-1], pairs[:, :, ::-1], pairs[:, ::-1, ::-1]):
        wide, narrow = (
            side**2 * at[:, : int(side * CELLS), : int(side * CELLS)].var(axis=(1, 2))
            for side in (1.0 / 2.0, 1.0 / 4.0)
        )
        # Never above 1: what varies within the inner box varies within the outer one.
        falls = np.divide(narrow, wide, out=np.zeros_like(wide), where=wide > 0.0)
        steps = np.log2(np.sqrt(runs) / 4.0)
        most = max(most, float((narrow * falls**steps).max(initial=0.0)))
    return most
