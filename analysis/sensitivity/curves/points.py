"""Indices of a curve at each of its points: the estimators of scalars, all points at once."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.sensitivity.estimators import (
    Estimator,
    MorrisEstimator,
    SaltelliEstimator,
    SecondOrderEstimator,
)
from analysis.sensitivity.estimators.weightings import FIRST

#: A curve needs replicates only to see how its points err together.
REPLICATES = 64

#: A curve is looked at in so many points at most, and in so many per factor that the sums of one
#: curve stay below some 100 MB; they lie evenly among its own.
MOST_POINTS = 201
_MOST_COLUMNS = 2000


def looked_at(points: int, factors: int) -> NDArray[np.intp]:
    """Return which points of a curve have indices, ascending, the first and the last among them.

    (A curve is sampled anyway: Ramsay and Silverman 2005, Functional data analysis, section 3.2.)
    """
    most = min(points, MOST_POINTS, max(_MOST_COLUMNS // factors, 11))
    return np.unique(np.round(np.linspace(0, points - 1, most)).astype(np.intp))


class _MorrisPoints(MorrisEstimator):
    weightings = FIRST + REPLICATES


class _SaltelliPoints(SaltelliEstimator):
    weightings = FIRST + REPLICATES
    # Indices as correlations have no counterpart for a whole curve.
    beside = False
    sample_sums = ("difference_root", "difference_size", "difference_fourth")


class _SecondOrderPoints(SecondOrderEstimator):
    weightings = FIRST + REPLICATES
    beside = False
    sample_sums = _SaltelliPoints.sample_sums


_OF_POINTS = {kind.method: kind for kind in (_MorrisPoints, _SaltelliPoints, _SecondOrderPoints)}


def point_estimator(method: str, **design: Any) -> Estimator:
    """Return an estimator whose outputs are the points of a curve.

    Morris 1991, Saltelli et al. 2010 or Saltelli 2002, with fewer replicates than those of scalars.

    Args:
        method: one of `analysis.designs.METHODS`.
        design: as `Estimator`.
    """
    return _OF_POINTS[method](**design)
