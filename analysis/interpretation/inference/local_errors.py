"""How large errors of prediction are around a recording.

Errors are as large as what is predicted says (`error_sizes`), times what the rows nearest to the
recording have more or less than that (Papadopoulos et al. 2011, Regression conformal prediction
with nearest neighbours).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from analysis.interpretation.inference.error_sizes import ErrorSizes, sizes_of_rows
from analysis.interpretation.inference.view import RowErrors

#: Rows around a recording whose errors are like its own.
NEIGHBOURS = 40
#: Weight of these in how large errors are over what is predicted; the rest is of all rows.
LOCAL_WEIGHT = 0.8


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
        more = self._more(self._neighbours(places, own=False))
        return self.rows.around(self.expected.at(predicted) * more)

    @cached_property
    def rows(self) -> RowErrors:
        """The errors, each beside how large it is to expect where it is."""
        more = self._more(self._neighbours(self.places, own=True))
        return RowErrors(errors=self.errors, spreads=self.sizes * more)

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
