"""Estimators that take rows in any order, merge, and carry their own confidence intervals."""

from analysis.estimators.estimator import Estimator, Moments, Statistic
from analysis.estimators.intervals import Estimate
from analysis.estimators.morris import MorrisEstimator
from analysis.estimators.saltelli import SaltelliEstimator

__all__ = [
    "Estimate",
    "Estimator",
    "Moments",
    "MorrisEstimator",
    "SaltelliEstimator",
    "Statistic",
    "estimator_class",
]


def estimator_class(method: str) -> type[Estimator]:
    """Return the estimator of a method of `analysis.designs.METHODS`; ValueError if unknown."""
    for known in (MorrisEstimator, SaltelliEstimator):
        if known.method == method:
            return known
    raise ValueError(f"unknown method {method!r}")
