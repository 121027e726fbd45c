"""Means and variances of exact sums, in every way of weighting the rows.

The weightings are, in this order: every row once, which is the sample itself; all rows but those
of one block, for each block (`analysis.designs.blocks`), which is the jackknife of Tukey 1958; and
each replicate of the Poisson bootstrap (Hanley and MacGibbon 2006).
"""

from collections.abc import Mapping, Sequence
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.designs import BLOCKS, blocks_of
from analysis.sensitivity.estimators.bootstrap import REPLICATES, replicate_weights
from analysis.sensitivity.estimators.exact_sum import (
    ExactSums,
    Integers,
    divide,
    square,
    variance_of_doubles,
)

#: The sample and what it is without each block; and how many weightings there are in all.
FIRST = 1 + BLOCKS
WEIGHTINGS = FIRST + REPLICATES

#: Sums of this ending add up the exact squares of their terms.
SQUARED = "_squared"


def weights(
    sampling: str, seed: int, rows: Sequence[int], stop: int = WEIGHTINGS
) -> NDArray[np.float64]:
    """Return how often each row counts in what is summed, shape (WEIGHTINGS, rows).

    For the jackknife (Tukey 1958) and the Poisson bootstrap (Hanley and MacGibbon 2006). In the
    place of all rows but a block's the block itself is summed: fewer terms, as good.

    Args:
        stop: how many weightings are wanted, the first ones.
    """
    found = np.ones((stop, len(rows)))
    if stop > 1:
        blocks = blocks_of(sampling, seed, rows)
        found[1:FIRST] = np.arange(BLOCKS)[: stop - 1, None] == blocks
    if stop > FIRST:
        found[FIRST:] = replicate_weights(seed, rows)[: stop - FIRST]
    return found


class NamedSums:
    """Exact sums by name, each of as many columns as its shape has places, and their counts.

    They are those of `analysis.sensitivity.estimators.exact_sum`, after Demmel and Nguyen 2015.

    Args:
        weightings: how many of `weights`, the first ones.
        shapes: of one weighting of each sum; a name that ends in `SQUARED` adds up squares.
    """

    def __init__(self, weightings: int, shapes: Mapping[str, tuple[int, ...]]) -> None:
        #: By name, its columns and the shape of one weighting of it.
        self.places: dict[str, tuple[slice, tuple[int, ...]]] = {}
        stop = 0
        for name, shape in shapes.items():
            start, stop = stop, stop + prod(shape)
            self.places[name] = slice(start, stop), shape
        self._sums = ExactSums(weightings, stop)
        self._counts: NDArray[np.int64] = np.zeros((weightings, stop), dtype=np.int64)

    def add(
        self, weighting: NDArray[np.float64], terms: Mapping[str, NDArray[np.float64]]
    ) -> dict[str, NDArray[np.bool_]]:
        """Add terms (points, rows, ...) to sums, and return which were numbers, flattened.

        Args:
            weighting: from `weights`; those that are not kept are left out.
            terms: by the sum's name; nan where there is nothing to add.
        """
        kept = weighting[: len(self._counts)]
        valid: dict[str, NDArray[np.bool_]] = {}
        # Those of as many points a row are added up together, which takes a part of the time.
        alike: dict[int, list[tuple[str, NDArray[np.float64]]]] = {}
        rows = kept.sum(axis=1)[:, None].astype(np.int64)
        for name, given in terms.items():
            flat = given.reshape(*given.shape[:2], -1)
            valid[name] = there = ~np.isnan(flat)
            if there.all():
                addends, many = flat, len(flat) * rows
            else:
                addends = np.where(there, flat, 0.0)
                many = (kept @ there.sum(axis=0, dtype=np.float64)).astype(np.int64)
            self._counts[:, self.places[name][0]] += many
            if name.endswith(SQUARED):
                addends = np.concatenate(square(addends))
            alike.setdefault(len(addends), []).append((name, addends))
        for group in alike.values():
            together = np.concatenate([addends for _, addends in group], axis=-1)
            self._sums.add(self._columns([name for name, _ in group]), kept, together)
        return valid

    def _columns(self, names: Sequence[str]) -> NDArray[np.intp]:
        """Return the columns of some sums, one after the other."""
        places = [self.places[name][0] for name in names]
        return np.concatenate([np.arange(one.start, one.stop) for one in places])

    def merge(self, other: "NamedSums") -> None:
        """Add the sums of `other`, which are of the same names and shapes."""
        self._sums.merge(other._sums)
        self._counts += other._counts

    def arrays(self, start: str) -> dict[str, Any]:
        """Return all that was summed, under names that begin with `start`, for `numpy.savez`."""
        return {
            f"{start}_low": np.int64(self._sums.low),
            f"{start}_limbs": self._sums.limbs,
            f"{start}_counts": self._counts,
        }

    def load(self, start: str, saved: Mapping[str, Any]) -> None:
        """Replace what was summed by `arrays`; ValueError if they are of another shape."""
        counts = saved[f"{start}_counts"]
        if counts.shape != self._counts.shape:
            raise ValueError("these bytes are the state of a study of other shape")
        self._sums.low = int(saved[f"{start}_low"])
        self._sums.limbs = saved[f"{start}_limbs"]
        self._counts = counts

    def weighted(self, stop: int) -> "Weighted":
        """Return what the sums say in the first `stop` weightings."""
        return Weighted(self._sums, self._counts, self.places, stop)


class Weighted:
    """What named sums say in some of the weightings.

    Args:
        sums, counts: sums in all weightings, and how many terms they have.
        places: by name, the columns of a sum and the shape of one weighting of it.
        stop: how many of the weightings to take, the first ones.
    """

    def __init__(
        self,
        sums: ExactSums,
        counts: NDArray[np.int64],
        places: Mapping[str, tuple[slice, tuple[int, ...]]],
        stop: int,
    ) -> None:
        self._sums, self._counts, self._places, self._stop = sums, counts[:stop], places, stop
        self._totals: dict[str, Integers] = {}
        self._replicates: dict[str, tuple[NDArray[np.float64], NDArray[np.float64]]] = {}

    def count(self, name: str) -> NDArray[np.int64]:
        """Return how many terms a sum has, shape (weightings, ...)."""
        columns, shape = self._places[name]
        counts = self._counts[:, columns].copy()
        counts[1:FIRST] = counts[0] - counts[1:FIRST]
        return counts.reshape(-1, *shape)

    def mean(self, name: str) -> NDArray[np.float64]:
        """Return the mean of a sum, shape (weightings, ...); nan of nothing.

        Rounded once in the sample and without each block; to the last digit or two in replicates.
        """
        total, shift = self._total(name)
        count = self.count(name)
        some = divide(total, count[:FIRST].astype(object), shift)
        if self._stop <= FIRST:
            return some
        with np.errstate(divide="ignore", invalid="ignore"):
            high, low = self._doubles(name)
            replicates = np.where(count[FIRST:] > 0, (high + low) / count[FIRST:], np.nan)
        return np.concatenate([some, replicates])

    def variance(self, name: str, *, ddof: int) -> NDArray[np.float64]:
        """Return the variance, 0 exactly if nothing varies; as `mean`."""
        total, shift = self._total(name)
        squares, _ = self._total(name + SQUARED)
        count = self.count(name)
        n = count[:FIRST].astype(object)
        numerator = n * (squares << shift) - total * total
        some = divide(numerator, np.where(n > ddof, n * (n - ddof), 0), 2 * shift)
        if self._stop <= FIRST:
            return some
        of_total, of_squares = self._doubles(name), self._doubles(name + SQUARED)
        replicates = variance_of_doubles(of_total, of_squares, count[FIRST:], ddof)
        return np.concatenate([some, replicates])

    def _total(self, name: str) -> tuple[Integers, int]:
        columns, shape = self._places[name]
        if name not in self._totals:
            total = self._sums.integers(columns, min(self._stop, FIRST))
            total[1:] = total[0] - total[1:]
            self._totals[name] = total.reshape(-1, *shape)
        return self._totals[name], self._sums.shift

    def _doubles(self, name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return a sum in the replicates, as `ExactSums.doubles`."""
        columns, shape = self._places[name]
        if name not in self._replicates:
            high, low = self._sums.doubles(columns, FIRST, self._stop)
            self._replicates[name] = high.reshape(-1, *shape), low.reshape(-1, *shape)
        return self._replicates[name]
