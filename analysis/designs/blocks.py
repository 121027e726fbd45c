"""Into which of eight blocks a row counts, so that a study can tell its own error.

What one randomised Sobol sequence errs cannot be seen from its own points: they are not
independent, and the spread between rows says little of the error of their mean. The spread between
several sequences that were scrambled independently does (Owen 1997, Monte Carlo variance of
scrambled net quadrature), and Student's interval from few of them is hard to beat (L'Ecuyer,
Nakayama, Owen and Tuffin 2023, Confidence intervals for randomized quasi-Monte Carlo estimators).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.designs.streams import Purpose, bits_of

#: Fewer widen Student's interval, more leave less of what Sobol points gain: the intervals of 4, 8
#: and 16 blocks are about equally wide from 64 rows on.
BLOCKS = 8
#: The samplings whose rows are points of eight sequences in turn.
IN_TURN = ("owen_blocks", "sobol_blocks")


def blocks_of(sampling: str, seed: int, rows: Sequence[int]) -> NDArray[np.intp]:
    """Return the block of each row (L'Ecuyer et al. 2023), 0 to 7, shape (rows,).

    Under those of `IN_TURN` it is the sequence that the row is a point of. Rows of other designs
    depend on each other across blocks; eight neighbours are dealt to the eight blocks at random.
    """
    number = np.asarray(rows, dtype=np.int64)
    if sampling in IN_TURN:
        return np.asarray(number % BLOCKS, dtype=np.intp)
    deals, place = np.unique(number // BLOCKS, return_inverse=True)
    dealt = bits_of(seed, Purpose.BLOCK, deals.tolist(), BLOCKS).argsort(axis=1, kind="stable")
    return np.asarray(dealt[place, number % BLOCKS], dtype=np.intp)
