"""Principal components of a curve, and the indices of their scores (Campbell et al. 2006).

Campbell, McKay and Williams 2006, Sensitivity analysis when model outputs are functions. The score
of a component is a linear function of the curve, so its variance, and the parts of it that the
indices of `analysis.sensitivity.estimators.saltelli` are made of, are quadratic forms of matrices
that are summed row by row. Each block's jackknife finds components of its own, so that intervals
count that the components are estimated, too.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.sensitivity.curves.basis import cosines, matrices
from analysis.sensitivity.curves.estimator import CurveEstimator
from analysis.sensitivity.estimators.intervals import Estimate, estimate
from analysis.sensitivity.estimators.weightings import Weighted

Array = NDArray[np.float64]

#: Components of a smaller share of the variance are left out, and those after the fifth.
LEAST_SHARE = 0.01
MOST = 5

#: Of a curve whose norm is so many times its spread, the products of coefficients have too few
#: digits left for their covariances: it has no components. All other indices come from exact sums.
LARGEST_MEAN = 1e5


@dataclass(frozen=True, kw_only=True)
class Component:
    """One principal component of a curve."""

    #: Of the sum of the points' variances.
    share: Estimate
    #: What one standard deviation of its score adds to the curve, shape (points,).
    shape: Array
    #: Of its score, shape (factors,): "first_order" and "total_order", or "mu" and "sigma" in the
    #: output's unit, per whole range of the factor, of the score times `shape`'s root mean square.
    indices: dict[str, Estimate]


@dataclass(frozen=True, kw_only=True)
class Components:
    """The leading principal components of a curve."""

    leading: tuple[Component, ...]
    #: What share of the variance the coefficients hold of which they are made; nan of none.
    held: float


def components(curve: CurveEstimator, variance: float, level: float) -> Components:
    """Return the leading components with the indices of their scores (Campbell et al. 2006).

    Args:
        curve: of the study.
        variance: the sum of the variances of its points.
        level: of the intervals, between 0 and 1.
    """
    sums = curve.components()
    count = sums.count("score_product")[:, 0]
    if count[0] < 2 or not variance > 0.0 or np.any(count < 1):
        return Components(leading=(), held=np.nan)
    mean = sums.mean("score")
    if (mean[0] ** 2).sum() > LARGEST_MEAN**2 * variance:
        return Components(leading=(), held=np.nan)
    covariance = matrices(sums.mean("score_product"), curve.size)
    covariance = covariance - mean[:, :, None] * mean[:, None, :]
    power, vectors = _matched(covariance)
    whole = np.trace(covariance, axis1=-2, axis2=-1)
    present = count[1:] < count[0]
    found = _of_scores(curve, sums, mean, vectors, power)
    n = sums.count("difference_product")[..., 0]
    present_of = n[1:] < n[0]
    basis = cosines(curve.points.outputs)
    leading = []
    for c in range(min(curve.size, MOST)):
        if not power[0, c] > LEAST_SHARE * variance:
            break
        share = power[:, c] / whole * (whole[0] / variance)
        shape = basis @ vectors[0, :, c] * np.sqrt(power[0, c])
        leading.append(
            Component(
                share=estimate(share[0], share[1:], present, level, power=None),
                shape=shape,
                indices={
                    name: estimate(
                        values[0, :, c],
                        values[1:, :, c],
                        present_of,
                        level,
                        power=_POWER[name],
                        whole=power[:, None, c] if name == "first_order" else None,
                    )
                    for name, values in found.items()
                },
            )
        )
    return Components(leading=tuple(leading), held=float(whole[0] / variance))


_POWER = {"first_order": None, "total_order": 1, "mu": None, "sigma": 2}


def _of_scores(
    curve: CurveEstimator, sums: Weighted, mean: Array, vectors: Array, power: Array
) -> dict[str, Array]:
    """Return indices of the scores of every component, shape (weightings, factors, components)."""
    difference = sums.mean("difference")  # weightings, factors, size
    squares = _form(matrices(sums.mean("difference_product"), curve.size), vectors)
    linear = difference @ vectors
    with np.errstate(divide="ignore", invalid="ignore"):
        if curve.method == "morris":
            n = sums.count("difference_product")[..., :1]
            spread = np.maximum(squares - linear**2, 0.0) * n / np.maximum(n - 1, 1)
            scale = 1.0 / np.sqrt(curve.points.outputs)
            return {"mu": linear * scale, "sigma": np.sqrt(spread) * scale}
        cross = _form(matrices(sums.mean("cross"), curve.size), vectors)
        centred = cross - (mean[:, None] @ vectors) * linear
        share = np.where(power > 0.0, power, np.nan)[:, None]
        return {"first_order": centred / share, "total_order": 0.5 * squares / share}


def _form(matrix: Array, vectors: Array) -> Array:
    """Return v' M v of each column v: (weightings, factors, components)."""
    moved = matrix @ vectors[:, None]
    found: Array = (vectors[:, None] * moved).sum(axis=-2)
    return found


def _matched(covariance: Array) -> tuple[Array, Array]:
    """Return eigenvalues (..., size) and vectors (..., size, size) in the sample's order.

    The first matrix is the sample's, whose components have a mean of 0 or more; those of the others
    follow the ones that they overlap most, with their sign.
    """
    power, vectors = np.linalg.eigh(covariance)
    power, vectors = np.maximum(power[:, ::-1], 0.0), vectors[:, :, ::-1].copy()
    # Of the coefficients the first alone has a mean.
    vectors[0] *= np.where(vectors[0, 0] < 0.0, -1.0, 1.0)
    kept_power, kept_vectors = power.copy(), vectors.copy()
    for w in range(1, len(power)):
        overlap = vectors[0].T @ vectors[w]
        left = np.abs(overlap)
        for c in range(len(left)):
            best = int(np.argmax(left[c]))
            left[:, best] = -1.0
            sign = -1.0 if overlap[c, best] < 0.0 else 1.0
            kept_power[w, c], kept_vectors[w, :, c] = power[w, best], sign * vectors[w, :, best]
    return kept_power, kept_vectors
