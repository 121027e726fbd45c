"""From curves to the inputs of inference: principal components, and what regressions say.

Curves of one kind share a scale, so that a component is a shape of the recording (Jolliffe 2002,
Principal component analysis, section 2.3).
"""

from dataclasses import dataclass

import numpy as np

from sim.models import CURVES, ESTIMATES, WINDOWS

#: Share of the curves' variance that is kept, and the most components.
KEPT_SHARE, MOST = 0.9995, 24


@dataclass(frozen=True, kw_only=True)
class Features:
    """What turns CURVES and ESTIMATES into inputs."""

    #: Mean and scale of CURVES and ESTIMATES, shape (2, both).
    scale: np.ndarray
    #: Of the scaled curves, shape (components, curves), each with variance 1 when applied.
    components: np.ndarray

    @classmethod
    def fit(cls, recorded: np.ndarray) -> "Features":
        """Learn from recordings, shape (n, CURVES and ESTIMATES)."""
        mean, spread = recorded.mean(axis=0), recorded.std(axis=0)
        curves = len(CURVES)
        groups = spread[:curves].reshape(-1, WINDOWS)
        shared = np.sqrt((groups**2).mean(axis=1)).repeat(WINDOWS)
        scale = np.array([mean, np.concatenate([shared, spread[curves:]])])
        scaled = (recorded[:, :curves] - mean[:curves]) / shared
        _, values, vectors = np.linalg.svd(scaled, full_matrices=False)
        share = np.cumsum(values**2) / np.sum(values**2)
        count = min(int(np.searchsorted(share, KEPT_SHARE)) + 1, MOST)
        sizes = values[:count] / np.sqrt(len(recorded))
        return cls(scale=scale, components=vectors[:count] / sizes[:, None])

    def inputs(self, recorded: np.ndarray) -> np.ndarray:
        """Return inputs of recordings (n, both), shape (n, components and ESTIMATES)."""
        scaled = self.scaled(recorded)
        curves = len(CURVES)
        return np.hstack([scaled[:, :curves] @ self.components.T, scaled[:, curves:]])

    def scaled(self, recorded: np.ndarray) -> np.ndarray:
        """Return recordings in units of what the bank's vary by."""
        return np.asarray((recorded - self.scale[0]) / self.scale[1])


#: Names of what recordings are made of, in order.
RECORDED = (*CURVES, *ESTIMATES)
