"""Whether a recording is like those of the bank: a distance, and what is strange where it is large.

A distance in so many directions overlooks one that is small in most and far in one. Those that
sensors err in are looked at by themselves: a constant on a joint's torque, or on the moved joint's
angle, estimated by generalised least squares (Aitken 1936) under the covariance of the bank's
recordings.

The Mahalanobis distance with a shrunk covariance (Ledoit and Wolf 2004). A recording is strange if
it is farther out than all but a share of the bank's own, each looked at from the others (conformal
anomaly detection, Laxhammar and Falkman 2015).
"""

from dataclasses import dataclass

import numpy as np

from sim.models import CURVES, ESTIMATES, WINDOWS

#: Share of familiar recordings that are called strange.
CALLED_STRANGE = 0.03
#: Share of familiar recordings in which such an offset is seen: 5 % are called strange in all.
CALLED_OFFSET = 0.02
#: Parts into which the bank's recordings are divided to look at each from the others.
FOLDS = 8

#: Words for the groups of what is recorded, in order.
GROUPS = (
    "the elbow's angle over time",
    *(f"the torque about J{joint} that the declared model does not explain" for joint in (1, 2, 3)),
    "the elbow's torque that the declared model does not explain",
    "what regressions make of the elbow's torque",
)
#: Constants on each group of curves: the moved joint's angle, then the torque of each joint, shape
#: (1 + joints, CURVES and ESTIMATES).
CONSTANTS = np.zeros((len(CURVES) // WINDOWS, len(CURVES) + len(ESTIMATES)))
for _group, _constant in enumerate(CONSTANTS):
    _constant[WINDOWS * _group : WINDOWS * (_group + 1)] = 1.0
EQUATION_21 = np.array([name.startswith("paper_") for name in (*CURVES, *ESTIMATES)])


@dataclass(frozen=True, kw_only=True)
class Familiarity:
    """What a bank's recordings have in common, in scaled units."""

    #: Of scaled recordings, shape (CURVES and ESTIMATES,), and the inverse of their covariance.
    mean: np.ndarray
    precision: np.ndarray
    #: Sorted squared distances of the bank's own recordings from the others, shape (n,).
    distances: np.ndarray
    #: Root mean square of the constants in the bank's own recordings, each estimated from the
    #: others, shape (len(CONSTANTS),); and the largest over these, sorted, shape (n,).
    constants: np.ndarray
    largest: np.ndarray

    @classmethod
    def fit(cls, scaled: np.ndarray) -> "Familiarity":
        """Learn from scaled recordings, shape (n, both)."""
        fold = np.arange(len(scaled)) % FOLDS
        distances = np.empty(len(scaled))
        found = np.empty((len(scaled), len(CONSTANTS)))
        for number in range(FOLDS):
            mean, precision = _gaussian(scaled[fold != number])
            away = scaled[fold == number] - mean
            distances[fold == number] = _squared(away, precision)
            found[fold == number] = _constants(away, precision)
        mean, precision = _gaussian(scaled)
        constants = np.sqrt((found**2).mean(axis=0))
        return cls(
            mean=mean,
            precision=precision,
            distances=np.sort(distances),
            constants=constants,
            largest=np.sort(np.abs(found / constants).max(axis=1)),
        )

    @property
    def limit(self) -> float:
        """Squared distance beyond which a recording is strange."""
        return beyond(self.distances, CALLED_STRANGE)

    def distance(self, scaled: np.ndarray) -> float:
        """Return the squared distance of a scaled recording, shape (both,)."""
        return float(_squared(scaled[None] - self.mean, self.precision)[0])

    def offset(self, scaled: np.ndarray) -> tuple[int, float, float] | None:
        """Return the offset of a curve that no recording of the bank has, or None.

        Returns:
            Which of CONSTANTS, the offset of that curve, and the largest that is familiar, both in
            scaled units.
        """
        found = _constants(scaled[None] - self.mean, self.precision)[0]
        which = int(np.argmax(np.abs(found / self.constants)))
        most = beyond(self.largest, CALLED_OFFSET) * float(self.constants[which])
        return (which, float(found[which]), most) if abs(found[which]) > most else None

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


def _constants(away: np.ndarray, precision: np.ndarray) -> np.ndarray:
    """Return estimates of each of CONSTANTS, shape (n, len(CONSTANTS)).

    Equation 21 has no constant, and shifts with it as the movement is: its results are left out.
    """
    seen, unseen = ~EQUATION_21, EQUATION_21
    both = precision[np.ix_(unseen, seen)]
    within = np.zeros_like(precision)
    within[np.ix_(seen, seen)] = precision[np.ix_(seen, seen)] - both.T @ np.linalg.solve(
        precision[np.ix_(unseen, unseen)], both
    )
    weighted = within @ CONSTANTS.T
    return np.asarray(away @ weighted / (CONSTANTS.T * weighted).sum(axis=0))


def beyond(ordered: np.ndarray, share: float) -> float:
    """Return what a share of new values is expected beyond, of n sorted ones, conformally."""
    place = int(np.ceil((1.0 - share) * (len(ordered) + 1))) - 1
    return float(ordered[min(place, len(ordered) - 1)])


def _squared(away: np.ndarray, precision: np.ndarray) -> np.ndarray:
    return np.asarray(np.einsum("ni,ij,nj->n", away, precision, away))
