"""What intervals of ST promise: they see that the variance errs, and how far it may be off."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from analysis.sensitivity.estimators.intervals import Estimate, fieller, satterthwaite
from analysis.sensitivity.estimators.shares import (
    LOW,
    allowing_for_tails,
    kept_apart,
    lacking_a_tail,
    longer,
    share_of_squares,
)
from analysis.sensitivity.estimators.tails import FLOOR, heaviness

BLOCKS = 8
Array = NDArray[np.float64]


def without_blocks(squares: Array) -> Array:
    """Return means of squares (rows, columns) without each block, (BLOCKS, columns)."""
    blocks = squares.reshape(BLOCKS, -1, squares.shape[1]).mean(axis=1)
    return (blocks.sum(axis=0) - blocks) / (BLOCKS - 1)


def interval(part: Array, whole: Array, **given: object) -> tuple[Array, Array, Array]:
    """Return the share part / whole of means of squares, each (rows, columns), with its ends."""
    part_without, whole_without = without_blocks(part), without_blocks(whole)
    found = share_of_squares(
        part.mean(axis=0) / whole.mean(axis=0),
        part_without / whole_without,
        np.ones(part_without.shape, dtype=np.bool_),
        0.9,
        whole=np.concatenate([whole.mean(axis=0)[None], whole_without]),
        stretch=1.0,
        **given,  # type: ignore[arg-type]
    )
    return found.value, found.low, found.high


def heavy(columns: int, seed: int, rows: int = 256) -> tuple[Array, Array, float]:
    """Return a light part, a whole of it and a Pareto tail of 0.3, and the true share."""
    rng = np.random.default_rng(seed)
    light, tail = rng.random((rows, columns)) - 0.5, rng.random((rows, columns)) ** -0.3
    mean, variance = 1.0 / 0.7, 1.0 / 0.4 - 1.0 / 0.49
    share = 1.0 / 12.0 / (1.0 / 12.0 + variance)
    return light**2, (light + tail - mean) ** 2, share


def test_beside_a_heavy_tail_a_light_part_is_held_far_more_often_than_by_its_own_spread() -> None:
    part, whole, truth = heavy(2000, seed=3)
    value, low, high = interval(part, whole)
    part_without, whole_without = without_blocks(part), without_blocks(whole)
    plain = satterthwaite(
        value,
        part_without / whole_without,
        np.ones(part_without.shape, dtype=np.bool_),
        0.9,
        stretch=np.ones(2000),
    )
    assert np.mean((plain.low <= truth) & (truth <= plain.high)) < 0.76
    assert np.mean((low <= truth) & (truth <= high)) == pytest.approx(0.88, abs=0.03)


def test_a_part_that_balanced_blocks_know_well_errs_as_the_whole_does() -> None:
    """A leading additive factor beside an interaction, in eight Sobol sequences.

    Row by row part and whole go together, and block by block they do not.
    """
    rng = np.random.default_rng(5)
    each = rng.permutation(np.linspace(0.0, 1.0, 32))[:, None]
    part = np.tile(each, (BLOCKS, 2000))  # every block has the same values of the factor
    other = rng.normal(0.5, 0.5, part.shape)
    _, low, high = interval(part, part + other, times=1.0)
    truth = 0.5
    assert np.mean((low <= truth) & (truth <= high)) == pytest.approx(0.9, abs=0.02)


def test_the_share_of_the_tail_itself_may_be_larger_and_no_smaller_than_without() -> None:
    rng = np.random.default_rng(11)
    rows = 256, 600
    own = rng.random(rows) ** -0.3
    light = 1.2 * (rng.random(rows) - 0.5)
    tail = own - 1.0 / 0.7
    variance = 1.0 / 0.4 - 1.0 / 0.49
    truth = variance / (variance + 0.12)
    held, ends = {}, {}
    for times in (1.0, LOW):
        _, low, high = interval(tail**2, tail**2 + light**2, times=times)
        held[times], ends[times] = np.mean((low <= truth) & (truth <= high)), (low, high)
    assert held[LOW] > held[1.0] + 0.03
    steeper = ends[LOW][1] > ends[1.0][1]
    assert steeper.mean() > 0.9
    assert np.array_equal(ends[LOW][0][steeper], ends[1.0][0][steeper])


def test_a_part_that_is_the_whole_has_no_error_of_the_whole() -> None:
    """What both err in common cancels, so only what balance by chance may hide is left: nothing."""
    _, whole, _ = heavy(20, seed=4)
    value, low, high = interval(whole, whole)
    np.testing.assert_allclose(value, 1.0)
    np.testing.assert_allclose([low, high], 1.0, rtol=1e-8)


def test_blocks_that_agree_by_chance_leave_a_third_of_the_independent_error() -> None:
    """As far as the tail is heavy: half of it at a kurtosis of 10.5, nothing up to 7."""
    weighted = np.random.default_rng(5).normal(0.4, 0.1, size=(201, 4))
    weighted[7, 0] = np.nan
    still = Estimate(value=weighted[0], low=weighted[0], high=weighted[0])
    heavy = heaviness(np.array([20.0, 14.0, 10.5, np.nan]))
    assert heavy.tolist() == [1.0, 1.0, 0.5, 0.0]
    found = kept_apart(still, weighted, FLOOR * heavy, 0.9)
    least = heavy * FLOOR * stats.norm.ppf(0.95) * np.nanstd(weighted[1:], axis=0)
    np.testing.assert_allclose(found.high - found.value, least, atol=1e-12)
    np.testing.assert_allclose(found.value - found.low, least, atol=1e-12)
    wide = Estimate(value=weighted[0], low=weighted[0] - 9.0, high=weighted[0] + 9.0)
    assert np.array_equal(kept_apart(wide, weighted, FLOOR * heavy, 0.9).low, wide.low)


def test_of_an_independent_whole_both_errors_add_as_the_sides_of_a_right_angle() -> None:
    rng = np.random.default_rng(6)
    part = np.tile(1.0 + 1e-9 * rng.random((1, 3)), (256, 1))
    whole = 1.0 + 0.1 * rng.random((256, 3))
    value, low, high = interval(part, whole)
    without = without_blocks(whole)
    error = np.sqrt(7.0 * np.var(np.log(without), axis=0))
    t = stats.t.ppf(0.95, 7)
    np.testing.assert_allclose(np.log(value / low) / error, LOW * t, rtol=0.02)
    np.testing.assert_allclose(np.log(high / value) / error, t, rtol=0.02)


def test_a_part_that_is_nothing_is_nothing_and_an_unknown_whole_has_no_interval() -> None:
    nothing = np.zeros((64, 1))
    value, low, high = interval(nothing, np.random.default_rng(7).random((64, 1)))
    assert (value[0], low[0], high[0]) == (0.0, 0.0, 0.0)
    with np.errstate(invalid="ignore"):
        _, low, high = interval(nothing, nothing)
    assert np.isnan([low[0], high[0]]).all()


def test_a_side_is_longer_as_far_as_the_tail_is_heavier_than_a_normal_one() -> None:
    found = longer(np.array([1.8, 3.0, 3.5, 4.0, 40.0, np.nan]))
    np.testing.assert_allclose(found, [1.0, 1.0, 0.5 * (1.0 + LOW), LOW, LOW, LOW])


def signed(part: Array, whole: Array, times: float) -> tuple[Estimate, Estimate]:
    """Return part / whole, each (rows, columns), with Fieller's ends and with longer ones."""
    part_without, whole_without = without_blocks(part), without_blocks(whole)
    there, without = np.ones(part_without.shape, dtype=np.bool_), part_without / whole_without
    both = np.concatenate([whole.mean(axis=0)[None], whole_without])
    plain = fieller(part.mean(axis=0) / both[0], without, there, 0.9, both)
    factors = np.full(part.shape[1], times)
    return plain, allowing_for_tails(plain, without, there, 0.9, whole=both, times=factors)


def test_the_share_of_a_tail_may_be_larger_and_those_beside_it_smaller() -> None:
    light, whole, share = heavy(1500, seed=8)
    for part, truth, before in ((light, share, 0.78), (whole - light, 1.0 - share, 0.78)):
        plain, found = signed(part, whole, LOW)
        assert np.mean((plain.low <= truth) & (truth <= plain.high)) < before
        assert np.mean((found.low <= truth) & (truth <= found.high)) > before + 0.04
    plain, found = signed(light, whole, LOW)
    assert (found.low < plain.low).all() and np.array_equal(found.high, plain.high)
    plain, found = signed(light, whole, 1.0)
    assert np.array_equal([found.low, found.high], [plain.low, plain.high])


def test_an_unknown_share_stays_unknown_whatever_its_tail() -> None:
    with np.errstate(invalid="ignore", divide="ignore"):
        plain, found = signed(np.zeros((64, 1)), np.zeros((64, 1)), LOW)
    assert np.isnan([plain.low[0], found.low[0], found.high[0]]).all()


def test_the_root_of_a_mean_of_heavy_squares_may_be_larger_by_its_logarithms_error() -> None:
    rng = np.random.default_rng(9)
    squares = (rng.random((256, 1500)) ** -0.3 - 1.0 / 0.7) ** 2
    truth = np.sqrt(1.0 / 0.4 - 1.0 / 0.49)
    without = without_blocks(squares)
    value, there = np.sqrt(squares.mean(axis=0)), np.ones(without.shape, dtype=np.bool_)
    plain = satterthwaite(value, np.sqrt(without), there, 0.9, 2, np.ones(1500))
    once = lacking_a_tail(plain, np.sqrt(without), there, 0.9, power=2, times=np.ones(1500))
    found = lacking_a_tail(plain, np.sqrt(without), there, 0.9, power=2, times=np.full(1500, LOW))
    np.testing.assert_allclose(once.high, plain.high)
    assert np.array_equal(found.low, plain.low)
    held = [np.mean((one.low <= truth) & (truth <= one.high)) for one in (plain, found)]
    assert held[0] < 0.76 and held[1] > held[0] + 0.1
    error = np.minimum(np.sqrt(7.0 * np.var(np.log(np.sqrt(without)), axis=0)), 0.5)
    more = np.log(found.high / value) ** 2 - np.log(plain.high / value) ** 2
    np.testing.assert_allclose(more, (LOW**2 - 1.0) * (stats.t.ppf(0.95, 7) * error) ** 2)


def test_a_mean_that_one_block_makes_up_has_an_upper_end_of_its_own_size() -> None:
    """The error of its logarithm is then hundreds, which no end can show."""
    blocks = np.array([1.0, *[1e-200] * 7])[:, None]
    mean = blocks.mean(axis=0)
    without = np.array([np.delete(blocks, block, axis=0).mean(axis=0) for block in range(BLOCKS)])
    there, times = np.ones((8, 1), dtype=np.bool_), np.array([LOW])
    plain = satterthwaite(np.sqrt(mean), np.sqrt(without), there, 0.9, 2, np.ones(1))
    found = lacking_a_tail(plain, np.sqrt(without), there, 0.9, power=2, times=times)
    assert 1.0 < found.high[0] / plain.high[0] < 10.0
    share = share_of_squares(
        1.0 / mean,
        1.0 / without,
        there,
        0.9,
        whole=np.concatenate([mean[None], without]),
        stretch=1.0,
    )
    assert 1.0 < share.high[0] / share.value[0] < 200.0
    signed = Estimate(value=np.full(1, 2.0), low=np.full(1, 1.9), high=np.full(1, 2.1))
    both = np.concatenate([mean[None], without])
    found = allowing_for_tails(signed, np.full((8, 1), 2.0), there, 0.9, whole=both, times=times)
    assert -8.0 < found.low[0] < 1.9


def test_a_root_of_nothing_stays_nothing_whatever_its_tail() -> None:
    nothing, there = np.zeros((8, 1)), np.ones((8, 1), dtype=np.bool_)
    plain = Estimate(value=np.zeros(1), low=np.zeros(1), high=np.zeros(1))
    found = lacking_a_tail(plain, nothing, there, 0.9, power=2, times=np.array([LOW]))
    assert (found.low[0], found.high[0]) == (0.0, 0.0)
