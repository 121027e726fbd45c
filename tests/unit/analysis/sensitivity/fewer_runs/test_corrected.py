"""Held-out runs make of any surrogate, right or wrong, intervals that hold the truth."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.sensitivity.fewer_runs.corrected import FOLDS, HeldOut, corrected, folds, held_out
from analysis.sensitivity.fewer_runs.parts import CELLS, Parts

Array = NDArray[np.float64]
N = 200


class Linear:
    """Says that f is a sum of slopes, whatever the runs say."""

    def __init__(self, x: Array, *slopes: float) -> None:
        self.terms = (x - 0.5) * np.array(slopes)
        self.squares = np.array(slopes) ** 2 / 12.0

    def without(self, y: Array, away: NDArray[np.bool_]) -> Parts:
        terms = self.terms[away]
        return Parts(
            value=terms.sum(axis=1),
            centred=terms.sum(axis=1),
            first=terms,
            total=terms,
            variance=float(self.squares.sum()),
            first_squares=self.squares,
            total_squares=self.squares,
        )

    def pairs(self, y: Array) -> Array:
        return np.zeros((1, CELLS, CELLS))


@pytest.fixture(scope="module")
def x() -> Array:
    return np.random.default_rng(5).random((N, 2))


def test_every_run_is_held_out_once_and_the_seed_decides_with_which() -> None:
    every = folds(3, 25)
    assert len(every) == FOLDS
    np.testing.assert_array_equal(np.sum(every, axis=0), np.ones(25))
    np.testing.assert_array_equal(every, folds(3, 25))
    assert not np.array_equal(every, folds(4, 25))


def test_a_surrogate_that_misses_nothing_leaves_no_doubt(x: Array) -> None:
    found = corrected(
        x @ [2.0, 1.0] - 1.5, held_out(Linear(x, 2.0, 1.0), x @ [2.0, 1.0] - 1.5, 1), 0.9
    )
    for indices in (found.first_order, found.total_order):
        np.testing.assert_allclose(indices.low, [0.8, 0.2], atol=1e-9)
        np.testing.assert_allclose(indices.high, [0.8, 0.2], atol=1e-9)
    assert found.explained == pytest.approx(1.0)


@pytest.mark.parametrize("slopes", [(0.0, 0.0), (1.0, 2.0), (-2.0, 3.0), (2.0, 0.5)])
def test_a_wrong_surrogate_is_corrected(x: Array, slopes: tuple[float, float]) -> None:
    y = x @ [2.0, 1.0] - 1.5
    found = corrected(y, held_out(Linear(x, *slopes), y, 1), 0.9)
    for indices in (found.first_order, found.total_order):
        assert np.all(indices.low <= [0.8, 0.2]) and np.all(indices.high >= [0.8, 0.2])
        assert np.all(indices.high - indices.low > 0.05)


def test_what_is_missed_may_belong_to_any_factor_or_to_none(x: Array) -> None:
    """Noise of a tenth of the variance: every interval is as wide, and so is its total."""
    noise = np.random.default_rng(6).normal(size=N) * np.sqrt(5.0 / 12.0 / 9.0)
    y = x @ [2.0, 1.0] - 1.5 + noise
    found = corrected(y, held_out(Linear(x, 2.0, 1.0), y, 1), 0.9)
    for indices in (found.first_order, found.total_order):
        assert np.all(indices.low < [0.72, 0.18]) and np.all(indices.high > [0.82, 0.28])
    assert found.explained == pytest.approx(0.9, abs=0.03)


def test_one_run_that_is_far_off_widens_all(x: Array) -> None:
    y = x @ [2.0, 1.0] - 1.5
    held = held_out(Linear(x, 2.0, 1.0), y, 1)
    missed = held.missed.copy()
    missed[7] = 3.0
    found = corrected(y, replace(held, missed=missed), 0.9)
    assert np.all(found.total_order.high - found.total_order.low > 0.1)


@pytest.mark.parametrize(
    ("part", "variance", "least", "most"),
    [
        (lambda u: u - 0.5, 1.0 / 12.0, 0.0, 0.01),
        (lambda u: (1.0 - u) ** -0.3 - 1.0 / 0.7, 2.5 - 1.0 / 0.49, 0.05, 0.4),
        (lambda u: u**-0.4 - 1.0 / 0.6, 5.0 - 1.0 / 0.36, 0.1, 0.6),
    ],
    ids=["a slope", "a heavy tail above", "a heavier one below"],
)
def test_how_a_part_grows_tells_what_lies_beyond_the_outermost_run(
    part: Callable[[Array], Array], variance: float, least: float, most: float
) -> None:
    assert least <= known(part, variance).beyond(EVEN) <= most


EVEN = (np.arange(256.0) + 0.5)[:, None] / 256.0


def known(part: Callable[[Array], Array], variance: float) -> HeldOut:
    """Return what is said of a function of one factor that is known at even points."""
    zero = np.zeros_like(EVEN)
    return HeldOut(
        missed=zero[:, 0],
        centred=part(EVEN[:, 0]),
        first=part(EVEN),
        total=part(EVEN),
        variance=np.full(256, variance),
        first_squares=zero,
        total_squares=zero,
    )


def pole(u: Array) -> Array:
    """Return |u - 0.4|^-0.15 less its mean."""
    return np.asarray(np.abs(u - 0.4) ** -0.15 - (0.4**0.85 + 0.6**0.85) / 0.85)


def two_poles(u: Array) -> Array:
    """Return |u - 0.3|^-0.15 + |u - 0.7|^-0.15 less its mean."""
    mean = 2.0 * (0.3**0.85 + 0.7**0.85) / 0.85
    return np.asarray(np.abs(u - 0.3) ** -0.15 + np.abs(u - 0.7) ** -0.15 - mean)


@pytest.mark.parametrize(
    ("part", "variance", "least", "most"),
    [
        (lambda u: u - 0.5, 1.0 / 12.0, 0.0, 0.001),
        (lambda u: np.sin(2.0 * np.pi * u), 0.5, 0.0, 0.001),
        (lambda u: np.where(u < 0.4, -0.6, 0.4), 0.24, 0.0, 0.001),
        (lambda u: np.sin(6.0 * np.pi * u), 0.5, 0.0, 0.01),
        (pole, 0.0563, 0.05, 0.2),
        (two_poles, 0.0779, 0.05, 0.2),
        # Ends have a look of their own.
        (lambda u: (1.0 - u) ** -0.3 - 1.0 / 0.7, 2.5 - 1.0 / 0.49, 0.0, 0.0),
        (lambda u: 0.0 * u, 1.0, 0.0, 0.0),
    ],
    ids=[
        "a slope",
        "a wave",
        "a jump",
        "three waves",
        "a pole",
        "two poles",
        "a tail at an end",
        "nothing",
    ],
)
def test_how_a_part_rises_inside_a_factor_tells_what_lies_between_the_runs(
    part: Callable[[Array], Array], variance: float, least: float, most: float
) -> None:
    assert least <= known(part, variance).between(EVEN) <= most
