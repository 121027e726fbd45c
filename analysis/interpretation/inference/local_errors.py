"""How large errors of prediction are around a recording, and how they go together.

Errors are as large as what is predicted says (`error_sizes`), times what the rows nearest to the
recording have more or less than that, and are correlated as in the whole bank: too few rows are
near a place to tell the latter there. The correlation is shrunk towards none (Ledoit and Wolf 2004,
by a fixed share).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from analysis.interpretation.inference.error_sizes import ErrorSizes, sizes_of_rows
from analysis.interpretation.inference.posterior import TARGETS, corrected

#: Rows around a recording whose errors are like its own.
NEIGHBOURS = 40
#: Weight of these in how large errors are over what is predicted; the rest is of all rows.
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
    #: How large these are to expect, as the other rows tell it, shape (rows, both).
    sizes: np.ndarray
    #: How large they are by what is predicted.
    expected: ErrorSizes

    @classmethod
    def fit(cls, places: np.ndarray, predicted: np.ndarray, errors: np.ndarray) -> "LocalErrors":
        """Learn from rows.

        Args:
            places: shape (rows, d).
            predicted: what sizes go by, shape (rows, k).
            errors: of targets and factors, truth less prediction, shape (rows, both).
        """
        return cls(
            places=places,
            errors=errors,
            sizes=sizes_of_rows(predicted, errors),
            expected=ErrorSizes.fit(predicted, errors),
        )

    def around(self, places: np.ndarray, predicted: np.ndarray) -> np.ndarray:
        """Return covariances of errors of targets and factors, shape (k, both, both).

        Args:
            places: of recordings, shape (k, d).
            predicted: what sizes go by, there, shape (k, as many).
        """
        spread = self.expected.at(predicted) * self._more(self._neighbours(places, own=False))
        return np.asarray(spread[:, :, None] * self._together * spread[:, None, :])

    def as_measured(self, columns: np.ndarray, sds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return errors of `columns` if they were measured, and covariances, of the bank's rows.

        The covariances are of targets and `columns`, shape (rows, both, both).
        """
        noise = self.noise[:, columns] * sds
        chosen = np.concatenate([np.arange(len(TARGETS)), columns]).astype(int)
        spread, together = self._spreads[:, chosen], self._together[np.ix_(chosen, chosen)]
        # What is measured is off by what it is measured to: so are the differences to its mean.
        return self.errors[:, columns] + noise, spread[:, :, None] * together * spread[:, None, :]

    def scores(self, columns: np.ndarray, sds: np.ndarray) -> np.ndarray:
        """Return sorted scores of the bank's rows if `columns` were measured, (rows, TARGETS)."""
        surprise, covariances = self.as_measured(columns, sds)
        own = self.errors[:, : len(TARGETS)]
        centre, spread = corrected(np.zeros_like(own), covariances, surprise, sds)
        return np.sort((own - centre) / spread, axis=0)

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

    def _more(self, near: np.ndarray) -> np.ndarray:
        """Return how much larger errors are around places than predicted, shape (k, both)."""
        squared = (self.errors / self.sizes) ** 2
        local = squared[near].mean(axis=1)
        return np.asarray(
            np.sqrt(LOCAL_WEIGHT * local + (1.0 - LOCAL_WEIGHT) * squared.mean(axis=0))
        )

    @cached_property
    def noise(self) -> np.ndarray:
        """Errors of measuring each row, over their standard deviation, shape (rows, both).

        The same whatever else is measured: plans are compared by what they measure alone.
        """
        return np.random.default_rng(0).standard_normal(self.errors.shape)

    @cached_property
    def _spreads(self) -> np.ndarray:
        """How large errors are around each row, shape (rows, targets and factors)."""
        return np.asarray(self.sizes * self._more(self._neighbours(self.places, own=True)))

    @cached_property
    def _together(self) -> np.ndarray:
        """Correlation of errors over their local size, shrunk towards none."""
        relative = self.errors / self._spreads
        found = relative.T @ relative
        size = np.sqrt(np.diag(found))
        found = found / np.outer(size, size)
        return np.asarray((1.0 - SHRINKAGE) * found + SHRINKAGE * np.eye(len(found)))
