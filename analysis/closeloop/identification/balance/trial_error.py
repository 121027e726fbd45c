"""Recorded effort next to what a model expects, of one joint in one trial."""

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True, kw_only=True)
class TrialError:
    """One joint in one trial: recorded effort and what the model expects, raw samples, (n,)."""

    trial: int
    joint: int
    time: np.ndarray
    effort: np.ndarray
    predicted: np.ndarray
    #: Time left out at either end, s.
    ends: float = 0.0

    @property
    def residual(self) -> np.ndarray:
        return np.asarray(self.effort - self.predicted)

    def where(self, rows: np.ndarray) -> "TrialError":
        """Return the error over the samples `rows` alone."""
        return replace(
            self, time=self.time[rows], effort=self.effort[rows], predicted=self.predicted[rows]
        )
