"""OpenTURNS and SALib say the same of the same runs, where a definition is the same.

(What SALib says of S, ST, pairs, groups and trajectories is beside what it is compared with, and of
given samples in `tests/unit/analysis/given`.)
"""

from typing import Any

import numpy as np
import pytest
from SALib.analyze import radial_ee

from analysis.designs import row_width, unit_row
from analysis.sensitivity.estimators import estimator_class

ROWS, K = 32, 4
PROBLEM = {"num_vars": K, "names": list("abcd"), "bounds": [[0.0, 1.0]] * K}


def sampled(method: str) -> tuple[Any, Any, Any]:
    """Return points (rows, width, factors), outputs (rows, width) and the indices of them."""
    points = np.stack([unit_row(method, "owen_blocks", 6, row, K) for row in range(ROWS)])
    y = points[..., 0] * np.exp(points[..., 1]) + np.sin(5.0 * points[..., 2])
    estimator = estimator_class(method)(sampling="owen_blocks", seed=6, factors=K, outputs=1)
    estimator.add_rows(range(ROWS), y[..., None])
    return points, y, {name: one.value[0] for name, one in estimator.indices().items()}


def test_total_order_is_jansens_of_openturns() -> None:
    """It divides squares by 2 n - 1 and by the variance of A alone."""
    ot = pytest.importorskip("openturns")
    points, y, ours = sampled("saltelli")
    blocks = np.concatenate([points[:, i] for i in range(row_width("saltelli", K))])
    outputs = np.concatenate([y[:, i] for i in range(y.shape[1])])[:, None]
    theirs = ot.JansenSensitivityAlgorithm(ot.Sample(blocks), ot.Sample(outputs), ROWS)
    scale = (1.0 - 0.5 / ROWS) * y[:, 0].var(ddof=1) / y[:, :2].var()
    expected = np.array(theirs.getTotalOrderIndices()) * scale
    assert ours["total_order"] == pytest.approx(expected, abs=1e-10)


def test_radial_effects_are_salibs() -> None:
    points, y, ours = sampled("morris")
    theirs = radial_ee.analyze(
        PROBLEM, points.reshape(-1, K), y.ravel(), sample_sets=ROWS, num_resamples=2
    )
    for name in ("mu", "mu_star", "sigma"):
        assert ours[name] == pytest.approx(np.array(theirs[name], dtype=float), abs=1e-10)


def test_shapley_effects_of_independent_factors_are_salibs() -> None:
    """A row goes from A to B one factor after the other, as Goda's trajectory from A does."""
    theirs_of = pytest.importorskip("SALib.analyze.shapley", reason="SALib is older than 1.6")
    points, y, ours = sampled("shapley")
    order = [0, *range(K, 0, -1)]
    theirs = theirs_of.analyze(PROBLEM, points[:, order].reshape(-1, K), y[:, order].ravel())
    assert ours["shapley"] == pytest.approx(theirs["shapley_normalized"], abs=1e-10)
