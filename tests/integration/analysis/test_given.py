"""Measures of given samples over many samples of chance, and one beside OpenTURNS."""

import numpy as np
import pytest

from analysis.given.measures import hdmr
from analysis.given.measures.hsic import hsic
from analysis.given.measures.measure import MEASURES
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


@pytest.mark.parametrize("signal", [0.0, 0.5, 0.8])
def test_shares_of_hdmr_vary_as_leaving_out_says(signal: float) -> None:
    """Whether they lead, do nothing, or do so beside noise that goes with another factor."""
    rng = np.random.default_rng(3)
    values, variances = [], []
    for _ in range(600):
        x = rng.random((120, 2))
        noise = np.sqrt(3.0 * (1.0 - signal)) * x[:, 1] * rng.normal(size=120)
        value, spread = hdmr.leave_out(x, np.sqrt(12.0 * signal) * x[:, 0] + noise)
        values.append(value)
        variances.append(spread.variance)
    assert np.mean(values, axis=0) == pytest.approx([signal, 0.0], abs=0.02)
    # Told is no less than chance alone adds, so it is more in the mean where there is no more.
    ratio = np.sqrt(np.mean(variances, axis=0)) / np.std(values, axis=0)
    assert np.all((ratio > 0.9) & (ratio < 1.4))


@pytest.mark.parametrize("rho", [0.0, 0.7])
def test_intervals_of_hdmr_hold_shares_of_factors_that_depend_on_each_other(rho: float) -> None:
    """Of a + noise the share of a is half, and of its companion none (Li et al. 2010)."""
    (measure,) = (one for one in MEASURES if one.name == "hdmr")
    held = []
    for seed in range(200):
        rng = np.random.default_rng([seed, 31])
        a, other, noise = rng.normal(size=(3, 300))
        x = np.column_stack([a, rho * a + np.sqrt(1.0 - rho**2) * other])
        found = measure.estimate(x, a + noise, 0.9, rng)
        held.append((found.low <= [0.5, 0.0]) & (found.high >= [0.5, 0.0]))
    # Of 0.9 two standard errors are 0.04.
    assert np.all(np.abs(np.mean(held, axis=0) - 0.9) < 0.07)


@pytest.mark.parametrize("name", ["rbd_fast", "hdmr"])
def test_of_a_factor_that_does_nothing_intervals_are_as_long_as_chance_is(name: str) -> None:
    (measure,) = (one for one in MEASURES if one.name == name)
    rng = np.random.default_rng(4)
    found = []
    for _ in range(40):
        x = rng.random((128, 2))
        found.append(measure.estimate(x, rng.normal(size=128), 0.9, rng))
    value, low, high = (np.array([getattr(f, e) for f in found]) for e in ("value", "low", "high"))
    half = 1.746 * np.sqrt(value.var())
    # As if halves saw what chance adds but twice, they were longer by a third.
    assert np.mean(high - low) / 2.0 == pytest.approx(half, rel=0.25)
