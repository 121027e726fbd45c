"""Estimators of small studies with two outputs, for tests of what they promise."""

import numpy as np
from numpy.typing import NDArray

from analysis.designs import unit_rows
from analysis.sensitivity.estimators import (
    Estimator,
    MorrisEstimator,
    SaltelliEstimator,
    SecondOrderEstimator,
    ShapleyEstimator,
)

SEED, FACTORS, OUTPUTS = 12, 3, 2
CLASSES = (MorrisEstimator, SaltelliEstimator, SecondOrderEstimator, ShapleyEstimator)


def empty(cls: type[Estimator], seed: int = SEED, factors: int = FACTORS) -> Estimator:
    return cls(sampling="sobol", seed=seed, factors=factors, outputs=OUTPUTS)


def function(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return two outputs, the second far from zero, of points (..., 3): shape (..., 2)."""
    a, b, c = np.moveaxis(x, -1, 0)
    return np.stack([a + 3.0 * a * b - c**2, 500.0 + b + 0.1 * np.sin(6.0 * c)], axis=-1)


def values_of(cls: type[Estimator], rows: int) -> NDArray[np.float64]:
    """Return the outputs of the first rows of the design, shape (rows, width, outputs)."""
    return function(unit_rows(cls.method, "sobol", SEED, range(rows), FACTORS))


def fed(cls: type[Estimator], values: NDArray[np.float64]) -> Estimator:
    estimator = empty(cls)
    estimator.add_rows(range(len(values)), values)
    return estimator
