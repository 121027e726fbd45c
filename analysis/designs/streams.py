"""Random bits that are a pure function of what they are for.

Philox is a counter-based generator (Salmon et al. 2011, Parallel random numbers: as easy as 1, 2,
3): any of its streams can be opened without walking through the others. NumPy promises the raw bits
of a bit generator for good, but not the numbers its distributions make of them, so only raw bits
are used.
"""

import threading
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray


class Purpose(IntEnum):
    """What a stream is for; two purposes never share bits, whatever their seed and index."""

    LATIN_HYPERCUBE = 1
    BOOTSTRAP = 2
    BLOCK = 3
    TRAJECTORY = 4
    BAND = 5
    ORDER = 6
    GROUP = 7


class _Philox(threading.local):
    """A generator that every thread keeps: making one takes four times as long as winding it."""

    def __init__(self) -> None:
        self.generator = np.random.Philox(0)
        #: Of a generator that has drawn nothing.
        self.state = self.generator.state


_PHILOX = _Philox()


def bits(seed: int, purpose: Purpose, index: int, size: int) -> NDArray[np.uint64]:
    """Return the first `size` words of 64 bits of the stream of `purpose` number `index`.

    By Philox (Salmon et al. 2011), keyed by the seed and the index.

    Raises:
        ValueError: the seed or the index is no unsigned 64 bit integer.
    """
    for name, value in (("seed", seed), ("index", index)):
        if not 0 <= value < 2**64:
            raise ValueError(f"{name} must be an integer from 0 to 2**64 - 1, not {value}")
    generator, state = _PHILOX.generator, _PHILOX.state
    state["state"]["key"][:] = seed, index
    state["state"]["counter"][3] = purpose
    generator.state = state
    return generator.random_raw(size)
