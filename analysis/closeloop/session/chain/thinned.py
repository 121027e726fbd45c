"""What depends on where joints are alone changes slowly: some samples tell the others."""

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicSpline

#: Of so many samples one is computed.
STEP = 4


class Thinned:
    """Some samples of stretches, and cubic splines between them.

    Args:
        slices: stretches, one after the other.
    """

    def __init__(self, slices: Sequence[slice]) -> None:
        self._slices = slices
        self._own = [np.unique([*range(p.start, p.stop, STEP), p.stop - 1]) for p in slices]
        #: Which, (m,).
        self.samples = np.concatenate(self._own)

    def between(self, values: np.ndarray) -> np.ndarray:
        """Return at all samples what is known at these, (m, k) to (n, k)."""
        parts = np.split(values, np.cumsum([len(own) for own in self._own])[:-1])
        every = zip(self._slices, self._own, parts, strict=True)
        return np.concatenate(
            [CubicSpline(own, part)(np.arange(p.start, p.stop)) for p, own, part in every]
        )
