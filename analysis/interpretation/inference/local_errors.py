"""How large errors of prediction are around a recording, and how they go together.

Errors are as large as those of the rows nearest to it, and are correlated as in the whole bank: too
few rows are near a place to tell the latter there. The correlation is shrunk towards none (Ledoit
and Wolf 2004, by a fixed share).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from analysis.interpretation.inference.posterior import TARGETS, corrected

#: Rows around a recording whose errors are like its own.
NEIGHBOURS = 40
#: Weight of these in how large errors are; the rest is of all rows.
LOCAL_WEIGHT = 0.8
#: By how much the errors' correlation is shrunk towards none.
SHRINKAGE = 0.05


@dataclass(frozen=True, kw_only=True)
class LocalErrors:
    """Errors of prediction of the rows that intervals are calibrated on."""

    #: Inputs over the lengths of the first Gaussian process, shape (rows, d).
    places: np.ndarray
    #: Of targets and factors, shape (rows, both).
    errors: np.ndarray

    @property
    def arrays(self) -> Mapping[str, np.ndarray]:
        return {name: getattr(self, name) for name in self.__dataclass_fields__}

    def around(self, places: np.ndarray) -> np.ndarray:
        """Return covariances of errors of targets and factors at places, shape (k, both, both)."""
        near = self._neighbours(places, own=False)
        return self._covariances(near, np.arange(len(TARGETS), self.errors.shape[1]))

    def as_measured(self, columns: np.ndarray, sds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return errors of `columns` if they were measured, and covariances, of the bank's rows."""
        noise = np.random.default_rng(0).standard_normal((len(self.errors), len(columns))) * sds
        # What is measured is off by what it is measured to: so are the differences to its mean.
        return self.errors[:, columns] + noise, self._covariances(self._own_neighbours, columns)

    def scores(self, columns: np.ndarray, sds: np.ndarray) -> np.ndarray:
        """Return sorted scores of the bank's rows if `columns` were measured, (rows, TARGETS)."""
        surprise, covariances = self.as_measured(columns, sds)
        own = self.errors[:, : len(TARGETS)]
        centre, spread = corrected(np.zeros_like(own), covariances, surprise, sds)
        return np.sort((own - centre) / spread, axis=0)

    @cached_property
    def _own_neighbours(self) -> np.ndarray:
        return self._neighbours(self.places, own=True)

    def _neighbours(self, places: np.ndarray, *, own: bool) -> np.ndarray:
        """Return the rows nearest to each place, shape (k, NEIGHBOURS); `own` leaves it out."""
        squared = (
            (places**2).sum(axis=1)[:, None]
            + (self.places**2).sum(axis=1)
            - 2.0 * places @ self.places.T
        )
        if own:
            np.fill_diagonal(squared, np.inf)
        return np.asarray(np.argpartition(squared, NEIGHBOURS, axis=1)[:, :NEIGHBOURS])

    def _covariances(self, near: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Return covariances of errors of targets and `columns`, shape (k, both, both).

        Errors are as large as around each place, and go together as in the whole bank: too few
        rows are near a place to tell the latter there.
        """
        chosen = np.concatenate([np.arange(len(TARGETS)), columns]).astype(int)
        spread = self._spreads(near)[:, chosen]
        together = self._together[np.ix_(chosen, chosen)]
        return np.asarray(spread[:, :, None] * together * spread[:, None, :])

    def _spreads(self, near: np.ndarray) -> np.ndarray:
        """Return how large errors are around places, shape (k, targets and factors)."""
        squared = self.errors**2
        local = squared[near].mean(axis=1)
        return np.asarray(
            np.sqrt(LOCAL_WEIGHT * local + (1.0 - LOCAL_WEIGHT) * squared.mean(axis=0))
        )

    @cached_property
    def _together(self) -> np.ndarray:
        """Correlation of errors over their local size, shrunk towards none."""
        relative = self.errors / self._spreads(self._own_neighbours)
        found = relative.T @ relative
        size = np.sqrt(np.diag(found))
        found = found / np.outer(size, size)
        return np.asarray((1.0 - SHRINKAGE) * found + SHRINKAGE * np.eye(len(found)))
