"""Estimators that take rows in any order, merge, and carry their own confidence intervals.

Of elementary effects (Morris 1991), of shares of the variance (Saltelli et al. 2010) and of Shapley
effects (Song, Nelson and Staum 2016).
"""

from analysis.sensitivity.estimators.estimator import OF_PAIRS, Estimator, Moments
from analysis.sensitivity.estimators.intervals import Estimate
from analysis.sensitivity.estimators.morris import MorrisEstimator
from analysis.sensitivity.estimators.saltelli import SaltelliEstimator, SecondOrderEstimator
from analysis.sensitivity.estimators.shapley import ShapleyEffects, ShapleyEstimator
from analysis.sensitivity.estimators.single_points import Sample, SinglePoints
from analysis.sensitivity.estimators.statistic import Statistic, interaction

#: Indices of single factors, with their symbols in the paper.
SYMBOLS = {
    "mu": "μ",
    "mu_star": "μ*",
    "sigma": "σ",
    "first_order": "S",
    "total_order": "ST",
    "shapley": "Sh",
    "full_first_order": "S full",
    "full_total_order": "ST full",
    "independent_first_order": "S independent",
    "independent_total_order": "ST independent",
}

__all__ = [
    "OF_PAIRS",
    "SYMBOLS",
    "Estimate",
    "Estimator",
    "Moments",
    "MorrisEstimator",
    "SaltelliEstimator",
    "Sample",
    "SecondOrderEstimator",
    "ShapleyEffects",
    "ShapleyEstimator",
    "SinglePoints",
    "Statistic",
    "estimator_class",
    "interaction",
]


def estimator_class(method: str) -> type[Estimator]:
    """Return the estimator of a method of `analysis.designs.METHODS`; ValueError if unknown.

    Morris 1991; Saltelli et al. 2010; Saltelli 2002; Song, Nelson and Staum 2016; of single
    points none has indices (`SinglePoints`).
    """
    for known in (
        MorrisEstimator,
        SaltelliEstimator,
        SecondOrderEstimator,
        ShapleyEstimator,
        SinglePoints,
        Sample,
    ):
        if known.method == method:
            return known
    raise ValueError(f"unknown method {method!r}")
