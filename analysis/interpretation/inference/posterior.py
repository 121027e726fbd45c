"""What is believed of K_h and its like, as quantiles.

What was measured beside a recording conditions a joint normal distribution (Rasmussen and Williams
2006, Gaussian processes for machine learning, equation A.6). Quantiles are those of scores of rows
that are exchangeable with it (conformal prediction: Vovk et al. 2005, Algorithmic learning in a
random world).
"""

from dataclasses import dataclass

import numpy as np

#: What is inferred: K_h and D_h, then K at a tenth, half and nine tenths of the travel.
TARGETS = ("stiffness", "damping", "start", "middle", "end")


@dataclass(frozen=True, kw_only=True)
class Posterior:
    """What is believed of the targets: quantiles are `centre + spread * score`."""

    #: Shape (TARGETS,).
    centre: np.ndarray
    spread: np.ndarray
    #: Sorted scores of the bank's rows, shape (rows, TARGETS).
    scores: np.ndarray

    def quantiles(self, probabilities: np.ndarray) -> np.ndarray:
        """Return quantiles, shape (len(probabilities), TARGETS)."""
        scores = self.scores[places(len(self.scores), probabilities)]
        return np.asarray(self.centre + self.spread * scores)

    def half_width(self, target: int = 0, share: float = 0.9) -> float:
        """Return half of the width of the interval that holds `share`."""
        low, high = self.quantiles(np.array([(1 - share) / 2, (1 + share) / 2]))[:, target]
        return float((high - low) / 2)

    def rank(self, truth: np.ndarray) -> np.ndarray:
        """Return the share of the belief below a truth (TARGETS,): uniform if it is calibrated."""
        score = (truth - self.centre) / self.spread
        return np.asarray((self.scores < score).mean(axis=0))


def corrected(
    mean: np.ndarray, covariance: np.ndarray, surprise: np.ndarray, sds: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return means and standard deviations of targets, given what was measured beside them.

    Args:
        mean: of the targets, shape (..., targets).
        covariance: of targets and what was measured, shape (..., both, both).
        surprise: what was measured less what was expected, shape (..., measured).
        sds: to which it was measured, shape (measured,).
    """
    count = mean.shape[-1]
    variance = np.einsum("...ii->...i", covariance)[..., :count]
    if len(sds):
        across = covariance[..., :count, count:]
        own = covariance[..., count:, count:] + np.diag(sds**2)
        gain = np.swapaxes(np.linalg.solve(own, np.swapaxes(across, -1, -2)), -1, -2)
        mean = mean + np.einsum("...ij,...j->...i", gain, surprise)
        variance = variance - np.einsum("...ij,...ij->...i", gain, across)
    return mean, np.sqrt(np.maximum(variance, 1e-10))


def squared(away: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """Return squared Mahalanobis distances (1936) of n vectors (n, k), shape (n,)."""
    solved = np.linalg.solve(covariances, away[..., None])[..., 0]
    return np.asarray((away * solved).sum(axis=1))


def places(count: int, probabilities: np.ndarray) -> np.ndarray:
    """Return which of `count` sorted scores quantiles are, as far out as few scores must be.

    Vovk et al. 2005; shape (len(probabilities),).
    """
    below = np.floor(probabilities * (count + 1)).astype(int)
    above = np.ceil(probabilities * (count + 1)).astype(int)
    return np.asarray(np.clip(np.where(probabilities < 0.5, below, above) - 1, 0, count - 1))
