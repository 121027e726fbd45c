"""Sparse polynomial chaos: a second surrogate, of another kind than the Gaussian process.

A sum of products of Legendre polynomials, whose squared coefficients are the shares of the variance
(Sudret 2008). Least angle regression picks the terms, and the corrected leave-one-out error how
many of them (Blatman and Sudret 2011); both by OpenTURNS.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Terms to pick from. Products of many factors come late (hyperbolic truncation with q = 0.6).
_TERMS = 300
_Q = 0.6


@dataclass(frozen=True, kw_only=True)
class Chaos:
    """A fitted expansion."""

    #: First- and total-order index of each factor, in the order of the columns.
    first_order: tuple[float, ...]
    total_order: tuple[float, ...]
    #: How many terms were picked, the constant among them.
    terms: int
    predictor: Callable[[Array], Array]

    def predict(self, x: Array) -> Array:
        """Return the expansion at points (n, factors) of the unit cube, shape (n,)."""
        return self.predictor(x)[:, 0]


def fit_chaos(x: Array, y: Array) -> Chaos:
    """Fit an expansion to values `y` (n,) at points `x` (n, factors) of the unit cube.

    Raises:
        ModuleNotFoundError: OpenTURNS is not installed (extra `chaos`).
    """
    import openturns as ot

    factors = x.shape[1]
    basis = ot.OrthogonalProductPolynomialFactory(
        [ot.LegendreFactory()] * factors, ot.HyperbolicAnisotropicEnumerateFunction(factors, _Q)
    )
    algorithm = ot.FunctionalChaosAlgorithm(
        ot.Sample(x),
        # Of unit size, because the rule that ends the picking is an absolute one.
        ot.Sample(((y - y.mean()) / y.std())[:, None]),
        ot.JointDistribution([ot.Uniform(0.0, 1.0)] * factors),
        ot.FixedStrategy(basis, _TERMS),
        ot.LeastSquaresStrategy(
            ot.LeastSquaresMetaModelSelectionFactory(ot.LARS(), ot.CorrectedLeaveOneOut())
        ),
    )
    algorithm.run()
    result = algorithm.getResult()
    mean, sd, meta = float(y.mean()), float(y.std()), result.getMetaModel()
    indices = ot.FunctionalChaosSobolIndices(result)
    return Chaos(
        first_order=_all(indices.getSobolIndex, factors),
        total_order=_all(indices.getSobolTotalIndex, factors),
        terms=len(result.getIndices()),
        predictor=lambda points: mean + sd * np.asarray(meta(ot.Sample(points))),
    )


def _all(index: Callable[[int], float], factors: int) -> tuple[float, ...]:
    return tuple(float(index(f)) for f in range(factors))
