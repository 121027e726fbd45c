"""The kernel's parameters are those that scikit-learn finds."""

from warnings import catch_warnings, simplefilter

import numpy as np
import pytest
from sklearn.exceptions import ConvergenceWarning
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, DotProduct, WhiteKernel

from analysis.interpretation.inference.marginal_likelihood import (
    BOUNDS,
    JITTER,
    likelihood,
    tuned,
)

RNG = np.random.default_rng(1)
X = RNG.standard_normal((60, 3))
Y = np.column_stack([np.sin(X[:, 0]) + X[:, 1], X[:, 1] + 0.1 * RNG.standard_normal(60)])
Y = (Y - Y.mean(axis=0)) / Y.std(axis=0)


def model() -> GaussianProcessRegressor:
    smooth, length, linear, noise = BOUNDS
    kernel = (
        ConstantKernel(1.0, smooth) * RBF(np.full(3, 6.0), length)
        + ConstantKernel(0.1, linear) * DotProduct(1.0, "fixed")
        + WhiteKernel(0.05, noise)
    )
    with catch_warnings():
        # A length that ends at its bound says that the input does not matter.
        simplefilter("ignore", ConvergenceWarning)
        return GaussianProcessRegressor(kernel, alpha=JITTER).fit(X, Y)


@pytest.mark.parametrize("shift", [-0.5, 0.0, 0.7])
def test_the_likelihood_and_its_slope_are_scikit_learns(shift: float) -> None:
    at = np.log([1.0, 6.0, 6.0, 6.0, 0.1, 0.05]) + shift
    value, slope = likelihood(at, X, Y)
    expected, expected_slope = model().log_marginal_likelihood(at, eval_gradient=True)
    assert value == pytest.approx(expected)
    assert slope == pytest.approx(expected_slope, rel=1e-6, abs=1e-6)


def test_the_greatest_likelihood_is_scikit_learns() -> None:
    lengths, variances = tuned(X, Y)
    at = np.log([variances[0], *lengths, variances[1], variances[2] - JITTER])
    best = model().log_marginal_likelihood_value_
    assert likelihood(at, X, Y)[0] == pytest.approx(best, abs=1e-3)


def test_rows_without_an_inverse_are_never_the_likeliest() -> None:
    value, slope = likelihood(np.log([1e3, 1e3, 1e3, 1e3, 1e-5, 1e-300]), np.ones((60, 3)), Y)
    assert value == -np.inf or np.isfinite(slope).all()
