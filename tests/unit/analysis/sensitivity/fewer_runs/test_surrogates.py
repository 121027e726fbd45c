"""What is known of a fitted function: its parts, and how much they vary."""

from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import qmc

from analysis.sensitivity.fewer_runs.expansion import Expansions
from analysis.sensitivity.fewer_runs.gaussian_process import (
    Processes,
    Scales,
    _misfit,
    find_scales,
)
from analysis.sensitivity.fewer_runs.parts import MIDDLES, Parts, Surrogate

Array = NDArray[np.float64]
RUNS, NODES = 32, 24
SCALES = Scales(lengths=np.array([0.4, 1.5]), noise=1e-4)
NONE, FIRST = np.zeros(2, dtype=bool), np.array([True, False])


def f(x: Array) -> Array:
    """A polynomial of two factors that act together."""
    return np.asarray(1.0 + 3.0 * x[:, 0] ** 2 * x[:, 1] + x[:, 1])


@pytest.fixture(scope="module")
def runs() -> Array:
    return np.asarray(qmc.Sobol(2, rng=np.random.default_rng(1)).random(RUNS))


def fit(kind: str, x: Array, normal: NDArray[np.bool_] = NONE) -> Surrogate:
    return Expansions(x, normal) if kind == "chaos" else Processes(x, SCALES, normal)


def on_a_grid(kind: str, runs: Array) -> tuple[Parts, Array, Array]:
    """Fit to the runs; return the parts on a grid, its weights, and the parts' shape on it."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    grid = np.array(list(product(0.5 * (nodes + 1.0), repeat=2)))
    x = np.concatenate([runs, grid])
    away = np.arange(len(x)) >= RUNS
    y = np.where(away, np.nan, f(x))
    return fit(kind, x).without(y, away), np.outer(weights, weights).ravel() / 4.0, grid


@pytest.mark.parametrize("kind", ["chaos", "process"])
def test_parts_are_what_integrals_of_the_function_say(kind: str, runs: Array) -> None:
    parts, weights, grid = on_a_grid(kind, runs)
    np.testing.assert_allclose(parts.value, f(grid), atol=1e-9 if kind == "chaos" else 0.15)
    mean = weights @ parts.value
    np.testing.assert_allclose(parts.centred, parts.value - mean, atol=1e-5)
    assert parts.variance == pytest.approx(weights @ parts.centred**2, abs=1e-5)
    along = weights.reshape(NODES, NODES).sum(axis=0)
    plane = parts.value.reshape(NODES, NODES)
    over_first = np.tile(along @ plane, NODES)
    over_second = np.repeat(plane @ along, NODES)
    np.testing.assert_allclose(parts.total[:, 0], parts.value - over_first, atol=1e-5)
    np.testing.assert_allclose(parts.total[:, 1], parts.value - over_second, atol=1e-5)
    np.testing.assert_allclose(parts.first[:, 0], over_second - mean, atol=1e-5)
    np.testing.assert_allclose(parts.first[:, 1], over_first - mean, atol=1e-5)
    np.testing.assert_allclose(parts.first_squares, weights @ parts.first**2, atol=1e-5)
    np.testing.assert_allclose(parts.total_squares, weights @ parts.total**2, atol=1e-5)


@pytest.mark.parametrize("kind", ["chaos", "process"])
def test_what_two_factors_do_together_is_what_neither_does_alone(kind: str, runs: Array) -> None:
    """Of f = 1 + 3 x^2 y + y: 3 (x^2 - 1/3) (y - 1/2)."""
    x, y = MIDDLES[:, None], MIDDLES
    expected = 3.0 * (x**2 - 1.0 / 3.0) * (y - 0.5)
    (found,) = fit(kind, runs).pairs(f(runs))
    np.testing.assert_allclose(found, expected, atol=1e-9 if kind == "chaos" else 0.1)


@pytest.mark.parametrize("kind", ["chaos", "process"])
def test_of_a_normal_factor_parts_have_the_variance_of_its_whole_range(kind: str) -> None:
    """Of z + z u - z / 2 + u with a normal z: 1 and 1/12 alone, and 1/12 together."""
    x = np.asarray(qmc.Sobol(2, rng=np.random.default_rng(1)).random(128))
    z, u = ndtri(x[:, 0]), x[:, 1]
    fitted = fit(kind, x, FIRST)
    y = z * (u + 0.5) + u
    parts = fitted.without(y, np.arange(128) < 8)
    close = {"rtol": 1e-9} if kind == "chaos" else {"rtol": 0.05}
    np.testing.assert_allclose(parts.first_squares, [1.0, 1.0 / 12.0], **close)
    np.testing.assert_allclose(parts.total_squares, [13.0 / 12.0, 2.0 / 12.0], **close)
    (found,) = fitted.pairs(y)
    expected = ndtri(MIDDLES)[:, None] * (MIDDLES - 0.5)
    np.testing.assert_allclose(found, expected, atol=1e-9 if kind == "chaos" else 0.05)


def test_pairs_are_in_the_order_of_combinations() -> None:
    x = np.asarray(qmc.Sobol(3, rng=np.random.default_rng(2)).random(64))
    none, scales = np.zeros(3, dtype=bool), Scales(lengths=np.full(3, 2.0), noise=1e-6)
    for fitted in (Expansions(x, none), Processes(x, scales, none)):
        sizes = np.abs(fitted.pairs(x[:, 0] * x[:, 2])).max(axis=(1, 2))
        assert sizes[1] == pytest.approx(0.25 * (15.0 / 16.0) ** 2, rel=0.02)
        assert sizes[0] < 0.01 and sizes[2] < 0.01


def test_a_polynomial_is_found_as_it_is(runs: Array) -> None:
    """Of f = 1 + 3 x^2 y + y, with E[x^2] = 1/3 and E[x^4] = 1/5."""
    parts, _, _ = on_a_grid("chaos", runs)
    second = 4.0 / 12.0  # E[f | y] = 1 + 2 y
    first = 9.0 / 4.0 * (1.0 / 5.0 - 1.0 / 9.0)  # E[f | x] = 1 + 3 x^2 / 2 + 1 / 2
    np.testing.assert_allclose(parts.first_squares, [first, second], rtol=1e-9)
    both = 9.0 / 12.0 * (1.0 / 5.0 - 1.0 / 9.0)
    np.testing.assert_allclose(parts.total_squares, [first + both, second + both], rtol=1e-9)


def test_the_gradient_of_the_likelihood_is_its_slope(runs: Array) -> None:
    pairs = np.tril_indices(RUNS, -1)
    apart = np.abs(runs[pairs[0]] - runs[pairs[1]]).T
    y = f(runs)
    y = (y - y.mean()) / y.std()
    at = np.log([0.3, 2.0, 1e-2])
    slope = [
        (
            _misfit(at + 1e-5 * step, apart, pairs, y, 2.0)[0]
            - _misfit(at - 1e-5 * step, apart, pairs, y, 2.0)[0]
        )
        / 2e-5
        for step in np.eye(3)
    ]
    np.testing.assert_allclose(_misfit(at, apart, pairs, y, 2.0)[1], slope, rtol=1e-5, atol=1e-5)


def test_scales_tell_a_factor_that_does_nothing_from_one_that_does(runs: Array) -> None:
    x = np.column_stack([runs, runs[::-1, 0]])
    scales = find_scales(x, np.sin(6.0 * x[:, 0]) + x[:, 1], np.zeros(3, dtype=bool))
    assert scales.lengths[0] < scales.lengths[1] < scales.lengths[2]
    assert scales.noise < 1e-3


def test_a_process_tells_the_whole_share_of_a_peak_that_it_knows() -> None:
    """Integrated at 48 points, which stood further apart than the peak is wide, it was 0.41."""
    x = qmc.Sobol(3, seed=1).random(512)
    y = 6.0 * np.exp(-(((x[:, 0] - 0.5) / 0.012) ** 2)) + x[:, 1]
    scales = Scales(lengths=np.array([0.054, 23.0, 65.0]), noise=1e-7)
    along = np.linspace(0.0, 1.0, 20001)
    of_peak = float(np.var(6.0 * np.exp(-(((along - 0.5) / 0.012) ** 2))))
    nothing = np.zeros(3, dtype=np.bool_)
    parts = Processes(x, scales, nothing).without(y, np.arange(512) < 1)
    share = parts.first_squares[0] / parts.variance
    assert share == pytest.approx(of_peak / (of_peak + 1.0 / 12.0), abs=0.005)
