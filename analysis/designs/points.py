"""Space-filling points of the unit cube, each a pure function of (seed, row).

Every coordinate lies strictly between 0 and 1, so that each has a quantile in any distribution.
"""

import threading
from collections.abc import Sequence
from copy import deepcopy
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.designs.blocks import BLOCKS
from analysis.designs.nested import BITS, nested
from analysis.designs.streams import Purpose, bits, bits_of

#: Rows per Latin hypercube. Every block is a hypercube of its own, so a study can be extended.
LATIN_HYPERCUBE_ROWS = 50

#: Points that are made, and kept, at a time.
_POINTS_AT_ONCE = 1024

#: Places of a sequence from which others are reached.
_PLACES = 4

#: A place is kept if it is left by more points: they take as long as to copy it.
_FAR = 2**16

_CLOSEST_TO_ONE = 1.0 - 2.0**-53


def sobol(seed: int, row: int, dimensions: int) -> NDArray[np.float64]:
    """Return point `row` of the scrambled Sobol sequence of `seed`, shape (dimensions,).

    Scrambling is a random linear matrix and a digital shift (Matousek 1998). On smooth models it
    needs several times fewer rows than random points for the same precision, best at powers of two.

    Raises:
        ValueError: `row` is beyond the sequence's 2**30 points.
    """
    _check(row)
    start, offset = divmod(row, _POINTS_AT_ONCE)
    point: NDArray[np.float64] = _sobol_points(seed, (), start, _POINTS_AT_ONCE, dimensions)[offset]
    return point


def owen_blocks(seed: int, row: int, dimensions: int) -> NDArray[np.float64]:
    """Return a point of one of eight Sobol sequences scrambled independently (Owen 1995, 1997).

    Row r is point r // 8 of sequence r % 8 (`analysis.designs.blocks`), so all grow alike, and are
    balanced when the number of rows is a power of two. Scrambles are nested
    (`analysis.designs.nested`).

    Raises:
        ValueError: as `sobol`.
    """
    _check(row)
    part, offset = divmod(row, _POINTS_AT_ONCE)
    point: NDArray[np.float64] = _owen_rows(seed, part, dimensions)[offset]
    return point


def sobol_blocks(seed: int, row: int, dimensions: int) -> NDArray[np.float64]:
    """Return a point of the same eight sequences with scrambles as those of `sobol` (Owen 1997).

    Raises:
        ValueError: as `sobol`.
    """
    _check(row)
    index, block = divmod(row, BLOCKS)
    size = _POINTS_AT_ONCE // BLOCKS
    start, offset = divmod(index, size)
    point: NDArray[np.float64] = _sobol_points(seed, (block,), start, size, dimensions)[offset]
    return point


def paired(point: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the coordinates of even place, then those of odd place.

    A row takes its first half as A and its second as B, and a total-order index is a mean of
    squared differences between the two coordinates of one factor. Dimensions i and i + k of a Sobol
    sequence may fill the square badly for small numbers of points (Joe and Kuo 2008, Constructing
    Sobol sequences with better two-dimensional projections); neighbouring ones fill it better.
    """
    return np.concatenate([point[..., 0::2], point[..., 1::2]], axis=-1)


def latin_hypercube(seed: int, row: int, dimensions: int) -> NDArray[np.float64]:
    """Return point `row` of the Latin hypercubes (McKay et al. 1979), shape (dimensions,)."""
    block, offset = divmod(row, LATIN_HYPERCUBE_ROWS)
    point: NDArray[np.float64] = _latin_hypercube_block(seed, block, dimensions)[offset]
    return point


def points(sampling: str, seed: int, rows: Sequence[int], dimensions: int) -> NDArray[np.float64]:
    """Return the points of many rows as the function of that name does of one (Owen 1997).

    Args:
        sampling: "owen_blocks", "sobol_blocks", "sobol", "sobol_paired" or "latin_hypercube".

    Returns:
        Shape (rows, dimensions).

    Raises:
        ValueError: as `sobol`.
    """
    number = np.asarray(rows, dtype=np.int64)
    blocks = BLOCKS if sampling == "sobol_blocks" else 1
    if sampling == "latin_hypercube":
        part, offset = np.divmod(number, LATIN_HYPERCUBE_ROWS)
    else:
        _check(int(number.min()))
        _check(int(number.max()))
        index, block = np.divmod(number, blocks)
        part, offset = np.divmod(index, _POINTS_AT_ONCE // blocks)
        part = part * blocks + block
    parts, place = np.unique(part, return_inverse=True)
    found = np.empty((len(number), dimensions))
    for p, one in enumerate(parts.tolist()):
        if sampling == "latin_hypercube":
            made = _latin_hypercube_block(seed, one, dimensions)
        elif sampling == "owen_blocks":
            made = _owen_rows(seed, one, dimensions)
        else:
            start, of = divmod(one, blocks)
            key = (of,) if blocks > 1 else ()
            made = _sobol_points(seed, key, start, _POINTS_AT_ONCE // blocks, dimensions)
        here = place == p
        found[here] = made[offset[here]]
    return found


def _check(row: int) -> None:
    if not 0 <= row < 2**BITS:
        raise ValueError(f"row of a Sobol design must be from 0 to 2**{BITS} - 1, not {row}")


@lru_cache(maxsize=64)
def _owen_rows(seed: int, part: int, dimensions: int) -> NDArray[np.float64]:
    """Return rows `part * _POINTS_AT_ONCE` and on of `owen_blocks`."""
    rows = np.arange(part * _POINTS_AT_ONCE, (part + 1) * _POINTS_AT_ONCE)
    index, block = np.divmod(rows, BLOCKS)
    keys = bits_of(seed, Purpose.SCRAMBLE, range(BLOCKS), dimensions)
    points = nested(index.astype(np.uint64), keys[block])
    points.setflags(write=False)
    return points


@lru_cache(maxsize=64)
def _sobol_points(
    seed: int, key: tuple[int, ...], start: int, size: int, dimensions: int
) -> NDArray[np.float64]:
    """Return points `start * size` to `(start + 1) * size - 1` of the sequence of (seed, key)."""
    return _sequence(seed, key, dimensions).points(start * size, size)


class _Sequence:
    """A scrambled Sobol sequence. SciPy walks to a point; here from the place next before it."""

    def __init__(self, seed: int, key: tuple[int, ...], dimensions: int) -> None:
        self._seed = np.random.SeedSequence(seed, spawn_key=key)
        self._dimensions = dimensions
        #: Where it has been, the latest last.
        self._places: list[Any] = []
        self._lock = threading.Lock()

    def points(self, first: int, size: int) -> NDArray[np.float64]:
        """Return points `first` to `first + size - 1`, shape (size, dimensions)."""
        with self._lock:
            place = self._place_before(first)
            if first > place.num_generated:
                place.fast_forward(first - place.num_generated)
            # The middle of a cell of the sequence's grid rather than its corner, which may be 0.
            points: NDArray[np.float64] = place.random(size) + 0.5 ** (BITS + 1)
            self._places = [*self._places, place][-_PLACES:]
        points.setflags(write=False)
        return points

    def _place_before(self, first: int) -> Any:
        """Return the place to go on from, which is no longer among the places."""
        behind = [place for place in self._places if place.num_generated <= first]
        if not behind:
            return self._beginning()
        place = max(behind, key=lambda one: one.num_generated)
        if first - place.num_generated > _FAR:
            return deepcopy(place)
        self._places.remove(place)
        return place

    def _beginning(self) -> Any:
        # It takes a second to import, which neither Latin hypercubes nor a start need.
        from scipy.stats import qmc

        # SciPy spawns the generator it is given, which only one with a seed sequence can do.
        rng = np.random.Generator(np.random.PCG64(deepcopy(self._seed)))
        return qmc.Sobol(self._dimensions, scramble=True, bits=BITS, rng=rng)


_sequence = lru_cache(maxsize=64)(_Sequence)


@lru_cache(maxsize=32)
def _latin_hypercube_block(seed: int, block: int, dimensions: int) -> NDArray[np.float64]:
    shape = (2, LATIN_HYPERCUBE_ROWS, dimensions)
    words = bits(seed, Purpose.LATIN_HYPERCUBE, block, int(np.prod(shape))).reshape(shape)
    strata = np.argsort(words[0], axis=0, kind="stable")
    within = ((words[1] >> np.uint64(12)).astype(np.float64) + 0.5) * 2.0**-52
    points: NDArray[np.float64] = np.minimum(
        (strata + within) / LATIN_HYPERCUBE_ROWS, _CLOSEST_TO_ONE
    )
    points.setflags(write=False)
    return points
