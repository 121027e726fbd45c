"""Whether a recording is like those of the bank: a distance, and what is strange where it is large.

The Mahalanobis distance with a shrunk covariance (Ledoit and Wolf 2004). A recording is strange if
it is farther out than all but a share of the bank's own, each looked at from the others (conformal
anomaly detection, Laxhammar and Falkman 2015).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from sim.models import CURVES, ESTIMATES, WINDOWS

#: Share of familiar recordings that are called strange.
CALLED_STRANGE = 0.03
#: Parts into which the bank's recordings are divided to look at each from the others.
FOLDS = 8

#: Words for the groups of what is recorded, in order.
GROUPS = (
    "the elbow's angle over time",
    *(f"the torque about J{joint} that the declared model does not explain" for joint in (1, 2, 3)),
    "the elbow's torque that the declared model does not explain",
    "what regressions make of the elbow's torque",
)


@dataclass(frozen=True, kw_only=True)
class Familiarity:
    """What a bank's recordings have in common, in scaled units."""

    #: Of scaled recordings, shape (CURVES and ESTIMATES,), and the inverse of their covariance.
    mean: np.ndarray
    precision: np.ndarray
    #: Sorted squared distances of the bank's own recordings from the others, shape (n,).
    distances: np.ndarray

    @classmethod
    def fit(cls, scaled: np.ndarray) -> "Familiarity":
        """Learn from scaled recordings, shape (n, both)."""
        fold = np.arange(len(scaled)) % FOLDS
        distances = np.empty(len(scaled))
        for number in range(FOLDS):
            mean, precision = _gaussian(scaled[fold != number])
            distances[fold == number] = _squared(scaled[fold == number] - mean, precision)
        mean, precision = _gaussian(scaled)
        return cls(mean=mean, precision=precision, distances=np.sort(distances))

    @property
    def arrays(self) -> Mapping[str, np.ndarray]:
        return {name: getattr(self, name) for name in self.__dataclass_fields__}

    @property
    def limit(self) -> float:
        """Squared distance beyond which a recording is strange."""
        count = len(self.distances)
        place = int(np.ceil((1.0 - CALLED_STRANGE) * (count + 1))) - 1
        return float(self.distances[min(place, count - 1)])

    def distance(self, scaled: np.ndarray) -> float:
        """Return the squared distance of a scaled recording, shape (both,)."""
        return float(_squared(scaled[None] - self.mean, self.precision)[0])

    def strangest(self, scaled: np.ndarray) -> str:
        """Return, in words, what a recording's distance comes from most."""
        away = scaled - self.mean
        parts = away * (self.precision @ away)
        groups = parts[: len(CURVES)].reshape(-1, WINDOWS).sum(axis=1)
        shares = [*groups, parts[len(CURVES) : len(CURVES) + len(ESTIMATES)].sum()]
        return GROUPS[int(np.argmax(shares))]


def _gaussian(scaled: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    from sklearn.covariance import ledoit_wolf

    mean = scaled.mean(axis=0)
    covariance, _ = ledoit_wolf(scaled - mean, assume_centered=True)
    return mean, np.linalg.inv(covariance)


def _squared(away: np.ndarray, precision: np.ndarray) -> np.ndarray:
    return np.asarray(np.einsum("ni,ij,nj->n", away, precision, away))
