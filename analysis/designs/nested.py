"""Sobol points under Owen's nested scramble, each a pure function of its number and its keys.

Every binary digit of a coordinate is flipped, or not, by a coin that belongs to all digits before
it (Owen 1995, Randomly permuted (t, m, s)-nets and (t, s)-sequences). A linear scramble (Matousek
1998) gives means the same mean square error, but another distribution: few sequences have all the
error of a polynomial's mean, the others none. Under a nested one errors are normal in the limit
(Loh 2003, On the asymptotic distribution of scrambled net quadrature), which is what Student's
interval of eight sequences takes them for.

A coin is a bit of a hash, so that no sequence is walked through and no coin is stored.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

#: A Sobol sequence has 2**30 points and as many values of a coordinate.
BITS = 30

# Multipliers of the finaliser of Steele, Lea and Flood 2014 (Fast splittable pseudorandom number
# generators), and what it counts by.
_GOLDEN, _FIRST, _SECOND = 0x9E3779B97F4A7C15, 0xBF58476D1CE4E5B9, 0x94D049BB133111EB

Words = NDArray[np.uint64]


def nested(index: Words, keys: Words) -> NDArray[np.float64]:
    """Return points of Sobol sequences under nested scrambles (Owen 1995), (rows, dimensions).

    Args:
        index: of each point in its sequence, below 2**BITS, shape (rows,).
        keys: of the scramble of each coordinate, shape (rows, dimensions).

    Returns:
        Strictly between 0 and 1: the middles of cells of a grid of 2**BITS.
    """
    digits = _sobol(index, keys.shape[1])
    flips = np.zeros_like(digits)
    for digit in range(BITS):
        # The digits before, as a place in the tree of all digits.
        place = (digits >> np.uint64(BITS - digit)) + np.uint64(1 << digit)
        flips = (flips << np.uint64(1)) | _coin(place, keys)
    found: NDArray[np.float64] = ((digits ^ flips).astype(np.float64) + 0.5) * 0.5**BITS
    return found


def _coin(place: Words, keys: Words) -> Words:
    """Return 0 or 1, as often and independent of each other (Steele, Lea and Flood 2014)."""
    mixed = (place * np.uint64(_GOLDEN)) ^ keys
    mixed ^= mixed >> np.uint64(30)
    mixed *= np.uint64(_FIRST)
    mixed ^= mixed >> np.uint64(27)
    mixed *= np.uint64(_SECOND)
    return mixed >> np.uint64(63)


def _sobol(index: Words, dimensions: int) -> Words:
    """Return the digits of points without a scramble (Sobol 1967), (rows, dimensions)."""
    gray = index ^ (index >> np.uint64(1))
    digits = np.zeros((len(index), dimensions), dtype=np.uint64)
    for bit, direction in enumerate(_directions(dimensions, int(index.max()).bit_length())):
        digits ^= ((gray >> np.uint64(bit)) & np.uint64(1))[:, None] * direction
    return digits


@lru_cache(maxsize=16)
def _directions(dimensions: int, bits: int) -> Words:
    """Return the first direction numbers of Joe and Kuo 2008, shape (bits, dimensions).

    They are the points of which the Gray code (Antonov and Saleev 1979) has one bit. SciPy walks
    to them, which takes half a second for the points of 10**9 rows.
    """
    # It takes a second to import, which neither Latin hypercubes nor a start need.
    from scipy.stats import qmc

    engine = qmc.Sobol(dimensions, scramble=False, bits=BITS)
    found = np.empty((bits, dimensions), dtype=np.uint64)
    for bit in range(bits):
        engine.fast_forward(2 ** (bit + 1) - 1 - engine.num_generated)
        found[bit] = engine.random(1)[0] * 2.0**BITS
    return found
