"""Measures of given samples over many samples of chance, and one beside OpenTURNS."""

from typing import Any

import numpy as np
import pytest

from analysis.given import hdmr, measures
from analysis.given.hsic import hsic
from tests.testbed.given import ishigami


def test_hsic_and_its_test_are_those_of_openturns() -> None:
    ot = pytest.importorskip("openturns")
    x = np.random.default_rng(5).random((40, 3))
    y = ishigami(x)
    kernels = []
    for column in (*x.T, y):
        kernel = ot.SquaredExponential(1)
        kernel.setScale([float(column.std(ddof=1))])
        kernels.append(kernel)
    theirs = ot.HSICEstimatorGlobalSensitivity(
        kernels, ot.Sample(x), ot.Sample(y[:, None]), ot.HSICUStat()
    )
    ours = hsic(x, y)
    assert ours.r2 == pytest.approx(np.array(theirs.getR2HSICIndices()), abs=1e-6)
    assert ours.p_value == pytest.approx(np.array(theirs.getPValuesAsymptotic()), abs=1e-6)


def test_chance_adds_to_hdmr_beside_others_what_its_measure_says() -> None:
    rng = np.random.default_rng(3)

    def spread(signal: float) -> Any:
        found = []
        for _ in range(600):
            x = rng.random((120, 2))
            noise = rng.normal(0.0, np.sqrt(1.0 - signal), 120)
            found.append(hdmr.hdmr(x, np.sqrt(12.0 * signal) * x[:, 0] + noise)[1])
        return np.var(found)

    # Two estimates of a variance from 600 draws each are off by 8 %.
    for signal in (0.5, 0.8):
        said = measures._unexplained_by_all(np.array([signal, 0.0]), np.zeros(2))
        assert spread(signal) / spread(0.0) == pytest.approx(said[1], rel=0.3)


@pytest.mark.parametrize("name", ["rbd_fast", "hdmr"])
def test_of_a_factor_that_does_nothing_intervals_are_as_long_as_chance_is(name: str) -> None:
    (measure,) = (one for one in measures.MEASURES if one.name == name)
    rng = np.random.default_rng(4)
    found = []
    for _ in range(40):
        x = rng.random((128, 2))
        found.append(measure.estimate(x, rng.normal(size=128), 0.9, rng))
    value, low, high = (np.array([getattr(f, e) for f in found]) for e in ("value", "low", "high"))
    half = 1.746 * np.sqrt(value.var())
    # Chance taken off but for once; as if halves saw it twice, they were longer by a third.
    assert np.mean(high - low) / 2.0 == pytest.approx(half, rel=0.25)
