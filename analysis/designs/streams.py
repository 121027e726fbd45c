"""Random bits that are a pure function of what they are for.

Philox is a counter-based generator (Salmon et al. 2011, Parallel random numbers: as easy as 1, 2,
3): any of its streams can be opened without walking through the others. NumPy promises the raw bits
of a bit generator for good, but not the numbers its distributions make of them, so only raw bits
are used.
"""

import threading
from collections.abc import Sequence
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
    SCRAMBLE = 8
    WALK = 9


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
    found: NDArray[np.uint64] = bits_of(seed, purpose, [index], size)[0]
    return found


def bits_of(seed: int, purpose: Purpose, indices: Sequence[int], size: int) -> NDArray[np.uint64]:
    """Return `bits` of many streams (Salmon et al. 2011), shape (indices, size).

    Raises:
        ValueError: as `bits`.
    """
    ends = {"seed": (seed,), "index": (min(indices, default=0), max(indices, default=0))}
    for name, values in ends.items():
        for value in values:
            if not 0 <= value < 2**64:
                raise ValueError(f"{name} must be an integer from 0 to 2**64 - 1, not {value}")
    generator, state = _PHILOX.generator, _PHILOX.state
    key = state["state"]["key"]
    key[0], state["state"]["counter"][3] = seed, purpose
    words = np.empty((len(indices), size), dtype=np.uint64)
    for place, index in enumerate(indices):
        key[1] = index
        generator.state = state
        words[place] = generator.random_raw(size)
    return words
