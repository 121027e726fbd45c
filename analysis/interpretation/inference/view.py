"""What a recording says before calibration, beside how the bank's rows err where it is said so.

Errors are correlated as in the whole bank: too few rows are near a place to tell that there. The
correlation is shrunk towards none (Ledoit and Wolf 2004, by a fixed share).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from analysis.interpretation.inference.posterior import TARGETS, Posterior, corrected

#: By how much the errors' correlation is shrunk towards none.
SHRINKAGE = 0.05


@dataclass(frozen=True, kw_only=True)
class RowErrors:
    """Errors of prediction of the rows that intervals are calibrated on."""

    #: Of targets and factors, truth less prediction, shape (rows, both).
    errors: np.ndarray
    #: How large these are to expect, as the other rows tell it, shape (rows, both).
    spreads: np.ndarray
    #: By how much the targets are off for each unit that column `pulling` is, beside their own
    #: errors, shape (rows, TARGETS).
    pulls: np.ndarray | None = None
    pulling: int = 0
    #: Whether an error may as well be to the other side.
    either_way: bool = False

    def around(self, spread: np.ndarray, pull: np.ndarray | None = None) -> np.ndarray:
        """Return covariances (k, both, both) of errors that are as large as `spread` (k, both).

        `pull`: as `pulls`, where they are looked at, shape (k, TARGETS).
        """
        own = spread[:, :, None] * self._together * spread[:, None, :]
        return np.asarray(own if pull is None else _pulled(own, pull, self.pulling))

    def as_measured(self, columns: np.ndarray, sds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return errors of `columns` if they were measured, and covariances, of the bank's rows.

        The covariances are of targets and `columns`, shape (rows, both, both).
        """
        noise = self.noise[:, columns] * sds
        chosen = np.concatenate([np.arange(len(TARGETS)), columns, [self.pulling]]).astype(int)
        spread, together = self.spreads[:, chosen], self._together[np.ix_(chosen, chosen)]
        covariances = spread[:, :, None] * together * spread[:, None, :]
        if self.pulls is not None:
            covariances = _pulled(covariances, self.pulls, len(chosen) - 1)
        # What is measured is off by what it is measured to: so are the differences to its mean.
        return self.errors[:, columns] + noise, covariances[:, :-1, :-1]

    def scores(self, columns: np.ndarray, sds: np.ndarray) -> np.ndarray:
        """Return sorted scores of the bank's rows if `columns` were measured, (rows, TARGETS)."""
        surprise, covariances = self.as_measured(columns, sds)
        own = self.of_targets
        centre, spread = corrected(np.zeros_like(own), covariances, surprise, sds)
        return np.sort(self.to_its_sides((own - centre) / spread), axis=0)

    def to_its_sides(self, scores: np.ndarray) -> np.ndarray:
        """Return scores of rows, to either side if they may be, (rows or 2 rows, ...)."""
        return np.concatenate([scores, -scores]) if self.either_way else scores

    @cached_property
    def of_targets(self) -> np.ndarray:
        """Errors of the targets with what `pulling` adds to them, shape (rows, TARGETS)."""
        own = self.errors[:, : len(TARGETS)]
        return own if self.pulls is None else own + self.pulls * self.errors[:, [self.pulling]]

    @cached_property
    def noise(self) -> np.ndarray:
        """Errors of measuring each row, over their standard deviation, shape (rows, both).

        The same whatever else is measured: plans are compared by what they measure alone.
        """
        return np.random.default_rng(0).standard_normal(self.errors.shape)

    @cached_property
    def _together(self) -> np.ndarray:
        """Correlation of errors over their size, shrunk towards none."""
        relative = self.errors / self.spreads
        found = relative.T @ relative
        size = np.sqrt(np.diag(found))
        found = found / np.outer(size, size)
        return np.asarray((1.0 - SHRINKAGE) * found + SHRINKAGE * np.eye(len(found)))


@dataclass(frozen=True, kw_only=True)
class View:
    """What a recording says of targets and factors (in their deviations), before calibration."""

    #: Shape (TARGETS and factors,).
    mean: np.ndarray
    #: Of what is wrong with it around this recording, shape (both, both).
    covariance: np.ndarray
    #: Of the rows that were looked at in the same way.
    rows: RowErrors

    def posterior(self, columns: np.ndarray, values: np.ndarray, sds: np.ndarray) -> Posterior:
        """Return what is believed of the targets if `columns` were measured.

        Args:
            columns: numbers among targets and factors.
            values: over the factors' standard deviations, from their means.
            sds: to which they were measured.
        """
        chosen = np.concatenate([np.arange(len(TARGETS)), columns]).astype(int)
        own = self.covariance[np.ix_(chosen, chosen)]
        surprise = values - self.mean[columns]
        centre, spread = corrected(self.mean[: len(TARGETS)], own, surprise, sds)
        return Posterior(centre=centre, spread=spread, scores=self.rows.scores(columns, sds))


def _pulled(covariances: np.ndarray, pull: np.ndarray, pulling: int) -> np.ndarray:
    """Return covariances (k, m, m) of targets and others if targets are off with one of these."""
    count, found = len(TARGETS), covariances.copy()
    # A product with whole matrices takes several times as long, for each of thousands of plans.
    found[:, :count] += pull[:, :, None] * found[:, [pulling]]
    found[:, :, :count] += pull[:, None, :] * found[:, :, [pulling]]
    return found
