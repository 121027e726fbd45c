"""What heavy tails promise: nothing is added to light ones, and what is added helps."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import integrate, special, stats

from analysis.designs import unit_rows
from analysis.sensitivity.estimators import MorrisEstimator
from analysis.sensitivity.estimators.intervals import satterthwaite
from analysis.sensitivity.estimators.tails import (
    BEND,
    Tail,
    heaviness,
    lopsidedness,
    of_draws,
    of_leading,
    raw_kurtosis,
    tail,
)
from analysis.sensitivity.remarks import FEWEST_ROWS

BLOCKS = 8
Array = NDArray[np.float64]


def tail_of(size: Array, axis: int = 0) -> Tail:
    """Return the tail of differences of these sizes."""
    moments = [np.mean(size**p, axis=axis) for p in (0.5, 1.0, 2.0, 4.0)]
    half, first, second, fourth = moments
    n = np.full(second.shape, size.shape[axis])
    return tail(half=half, first=first, second=second, fourth=fourth, n=n)


def bend(moment: dict[float, float]) -> float:
    """Return by what share of what it rose before the slope of log E|d|^p rises beyond p = 2."""
    curve = {p: np.log(value) for p, value in moment.items()}
    slopes = [(curve[b] - curve[a]) / (b - a) for a, b in ((0.5, 1.0), (1.0, 2.0), (2.0, 4.0))]
    return float((slopes[2] - slopes[1]) / (slopes[1] - slopes[0]))


POWERS = (0.5, 1.0, 2.0, 4.0)


@pytest.mark.parametrize(
    ("moment", "bends"),
    [
        # |u - v| of two uniform numbers has the density 2 (1 - x).
        ({p: integrate.quad(lambda x, p=p: 2 * (1 - x) * x**p, 0, 1)[0] for p in POWERS}, 0.95),
        ({p: stats.halfnorm.expect(lambda x, p=p: x**p) for p in POWERS}, 1.1),
        ({p: (1.0 + p) ** -20.0 for p in POWERS}, 0.9),
        ({p: np.exp(0.5 * p**2) for p in POWERS}, 2.0),
        ({p: special.gamma(1.0 + p) for p in POWERS}, 1.2),
    ],
    ids=["two uniform numbers", "normal", "product of 20 uniform", "lognormal", "exponential"],
)
def test_moments_bend_at_least_as_much_as_is_taken_for_granted(
    moment: dict[float, float], bends: float
) -> None:
    """So that of many rows of these nothing is stretched."""
    assert bend(moment) == pytest.approx(bends, abs=0.06)
    assert bend(moment) > BEND
    half, first, second, fourth = (np.array([moment[p]]) for p in POWERS)
    found = tail(half=half, first=first, second=second, fourth=fourth, n=np.array([1000]))
    assert found.stretch == 1.0
    assert found.rows == pytest.approx(1000 * second**2 / fourth)


def test_a_difference_that_is_mostly_zero_and_else_of_one_size_is_counted_and_not_stretched() -> (
    None
):
    size = np.zeros((200, 2))
    size[:7, 0], size[:1, 1] = 3.0, 1e-20
    found = tail_of(size)
    np.testing.assert_allclose(found.rows, [7.0, 1.0], rtol=1e-9)
    np.testing.assert_allclose(found.stretch, 1.0, rtol=1e-6)


def test_few_rows_of_a_heavy_tail_show_less_of_it_than_their_lower_moments_tell() -> None:
    """Of a product of six uniform numbers: the ratio of moments is (9/5)^6 = 34."""
    size = np.random.default_rng(1).random((64, 6, 2000)).prod(axis=1)
    seen = np.mean(size**4, axis=0) / np.mean(size**2, axis=0) ** 2
    found = tail_of(size)
    assert np.median(seen) < 0.5 * 1.8**6
    assert np.median(64 / found.rows) > 1.2 * np.median(seen)
    assert 0.5 < np.mean(found.stretch > 1.0) < 0.95


def test_nothing_moves_or_one_row_is_no_tail() -> None:
    found = tail_of(np.array([[0.0, 2.0], [0.0, 2.0]]))
    assert np.array_equal(found.stretch, [1.0, 1.0])
    assert np.isnan(found.rows[0]) and found.rows[1] == pytest.approx(2.0)
    nothing = np.full(1, np.nan)
    none = tail(half=nothing, first=nothing, second=nothing, fourth=nothing, n=np.array([0]))
    assert none.stretch == 1.0 and np.isnan(none.rows)


def test_intervals_of_the_mean_square_of_a_product_hold_the_truth_where_they_did_not() -> None:
    """Products of five uniform numbers and a difference, as in Bratley's last factor: 64 rows."""
    rng = np.random.default_rng(3)
    size = rng.random((64, 5, 4000)).prod(axis=1) * np.abs(
        np.diff(rng.random((64, 2, 4000)), axis=1)[:, 0]
    )
    truth = 3.0**-5 / 6.0
    blocks = (size**2).reshape(BLOCKS, -1, 4000).mean(axis=1)
    value, without = blocks.mean(axis=0), (blocks.sum(axis=0) - blocks) / (BLOCKS - 1)
    there = np.ones(blocks.shape, dtype=np.bool_)
    held = [
        np.mean((found.low <= truth) & (truth <= found.high))
        for found in (
            satterthwaite(value, without, there, 0.9),
            satterthwaite(value, without, there, 0.9, stretch=tail_of(size).stretch),
        )
    ]
    assert held[0] < 0.86
    assert held[1] == pytest.approx(0.9, abs=0.03)


def test_a_rare_event_is_told_by_the_number_of_rows_where_no_interval_is_honest() -> None:
    """Squares of what a normal number exceeds 2 by, which 1 in 44 does: 64 rows, where any does."""
    size = np.maximum(np.random.default_rng(4).normal(size=(64, 6000)) - 2.0, 0.0) ** 2
    size = size[:, size.any(axis=0)]
    truth = integrate.quad(lambda x: (x - 2.0) ** 4 * stats.norm.pdf(x), 2.0, 12.0)[0]
    blocks = (size**2).reshape(BLOCKS, 8, -1).mean(axis=1)
    value, without = blocks.mean(axis=0), (blocks.sum(axis=0) - blocks) / (BLOCKS - 1)
    tails = tail_of(size)
    there = np.ones(blocks.shape, dtype=np.bool_)
    found = satterthwaite(value, without, there, 0.9, stretch=tails.stretch)
    few = tails.rows < FEWEST_ROWS
    assert np.mean(few) > 0.9
    assert np.mean(((found.low <= truth) & (truth <= found.high))[few]) < 0.7


def test_a_tail_that_bends_more_than_is_taken_for_granted_is_held_less_often() -> None:
    """Squares of lognormal numbers, 64 rows: what a study of such differences may expect."""
    size = np.exp(np.random.default_rng(5).normal(size=(64, 4000)))
    blocks = (size**2).reshape(BLOCKS, 8, -1).mean(axis=1)
    value, without = blocks.mean(axis=0), (blocks.sum(axis=0) - blocks) / (BLOCKS - 1)
    found = satterthwaite(
        value, without, np.ones(blocks.shape, dtype=np.bool_), 0.9, stretch=tail_of(size).stretch
    )
    assert np.mean((found.low <= np.exp(2.0)) & (np.exp(2.0) <= found.high)) == pytest.approx(
        0.80, abs=0.03
    )


def test_heaviness_goes_from_a_heavy_kurtosis_to_twice_that() -> None:
    kurtosis = np.array([np.nan, 1.0, 4.0, 5.0, 6.0, 8.0, 80.0])
    assert heaviness(kurtosis, 4.0).tolist() == [0.0, 0.0, 0.0, 0.25, 0.5, 1.0, 1.0]


def test_the_kurtosis_of_what_differences_are_of_is_told_by_them() -> None:
    draws = np.random.default_rng(6).exponential(size=(2, 2_000_000))
    size = draws[0] - draws[1]
    found = of_draws(raw_kurtosis(np.mean(size**2), np.mean(size**4)))
    assert found == pytest.approx(9.0, abs=0.3)


def test_nothing_that_moves_has_no_kurtosis_and_leads_nothing() -> None:
    second = np.array([[0.0, 2.0, np.nan], [0.0, 0.0, np.nan]])
    fourth = np.array([[0.0, 12.0, np.nan], [0.0, 0.0, np.nan]])
    raw = raw_kurtosis(second, fourth)
    np.testing.assert_array_equal(raw, [[np.nan, 3.0, np.nan], [np.nan] * 3])
    np.testing.assert_array_equal(of_leading(raw, fourth), [3.0, np.nan])


def test_a_power_beyond_all_numbers_is_a_tail_as_heavy_as_any() -> None:
    """One result of 1e80 ended the analysis of every study: its square's square was infinite."""
    second, fourth = np.array([1e200, 1e100, 0.0]), np.array([1e300, np.inf, 0.0])
    np.testing.assert_array_equal(raw_kurtosis(second, fourth), [np.inf, np.inf, np.nan])


def test_blocks_are_lopsided_as_far_as_the_skewness_of_what_each_adds() -> None:
    rng, every = np.random.default_rng(1), np.ones((BLOCKS, 50), dtype=np.bool_)
    added = rng.exponential(size=(BLOCKS, 50))
    without = (added.sum(axis=0) - added) / (BLOCKS - 1)
    expected = np.clip(stats.skew(added, axis=0, bias=False), 0.0, 1.0)
    for size in (1.0, 1e-200, 1e150):
        assert lopsidedness(size * without, every) == pytest.approx(expected)
    five = every & (np.arange(BLOCKS) < 5)[:, None]
    expected = np.clip(stats.skew(added[:5], axis=0, bias=False), 0.0, 1.0)
    assert lopsidedness(np.where(five, without, np.nan), five) == pytest.approx(expected)


def test_blocks_that_are_the_same_or_two_are_not_lopsided() -> None:
    every = np.ones((BLOCKS, 2), dtype=np.bool_)
    two = np.arange(BLOCKS)[:, None] < np.array([2, 1])
    with np.errstate(all="raise"):
        assert np.all(lopsidedness(np.ones((BLOCKS, 2)), every) == 0.0)
        assert np.all(lopsidedness(np.ones((0, 2)), every[:0]) == 0.0)
        assert np.all(lopsidedness(np.arange(2.0 * BLOCKS).reshape(BLOCKS, 2), two) == 0.0)


def test_intervals_of_effects_of_moderate_tails_hold_the_truth_where_they_did_not() -> None:
    """The sum of three exponential factors, 128 rows: sigma was held in 0.77, mu* in 0.86."""
    # By quadrature over base and step of -log(1 - u).
    truth = {"mu_star": 2.9927, "sigma": 2.4946}
    held: dict[str, list[Array]] = {name: [] for name in truth}
    for seed in range(60):
        estimator = MorrisEstimator(
            sampling="owen_blocks", seed=seed, factors=3, outputs=1, weightings=1 + BLOCKS
        )
        points = unit_rows("morris", "owen_blocks", seed, range(128), 3)
        estimator.add_rows(range(128), -np.log1p(-points).sum(axis=-1, keepdims=True))
        for name, index in estimator.indices(0.9).items():
            if name in truth:
                held[name].append((index.low <= truth[name]) & (truth[name] <= index.high))
    assert np.mean(held["sigma"]) > 0.83 and np.mean(held["mu_star"]) > 0.88
