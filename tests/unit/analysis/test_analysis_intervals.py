"""What intervals promise: the textbook's where there is one, and a number wherever one is due."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from analysis.estimators.intervals import satterthwaite, student

BLOCKS = 8


def leave_out(blocks: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the mean of all blocks (blocks, columns) but each."""
    return np.asarray((blocks.sum(axis=0) - blocks) / (len(blocks) - 1))


def everywhere(shape: tuple[int, ...]) -> NDArray[np.bool_]:
    return np.ones(shape, dtype=np.bool_)


def test_of_a_mean_it_is_students_interval_of_the_blocks() -> None:
    blocks = np.random.default_rng(1).normal(3.0, 2.0, size=(BLOCKS, 4))
    found = student(blocks.mean(axis=0), leave_out(blocks), everywhere(blocks.shape), 0.9)
    oracle = stats.ttest_1samp(blocks, 0.0).confidence_interval(0.9)
    np.testing.assert_allclose(found.low, oracle.low, rtol=1e-12)
    np.testing.assert_allclose(found.high, oracle.high, rtol=1e-12)


def test_a_block_without_rows_is_no_block() -> None:
    blocks = np.random.default_rng(1).normal(3.0, 2.0, size=(BLOCKS, 1))
    present = everywhere(blocks.shape)
    present[[2, 5]] = False
    some = blocks[present[:, 0]]
    without = np.full(blocks.shape, np.nan)
    without[present] = leave_out(some)[:, 0]
    found = student(some.mean(axis=0), without, present, 0.9)
    expected = student(some.mean(axis=0), leave_out(some), everywhere(some.shape), 0.9)
    assert (found.low, found.high) == (expected.low, expected.high)


def test_of_a_variance_of_many_normal_numbers_it_is_nearly_the_chi_square_interval() -> None:
    """Half the width of both, at any skewness: 8 blocks of 25 squares, of many samples."""
    squares = np.random.default_rng(2).normal(size=(BLOCKS, 25, 4000)) ** 2
    blocks = squares.mean(axis=1)
    value = blocks.mean(axis=0)
    found = satterthwaite(value, leave_out(blocks), everywhere(blocks.shape), 0.9)
    low, high = 200 / stats.chi2.ppf([0.95, 0.05], 200)
    # Student's quantile of seven degrees of freedom in place of the normal one.
    wider = stats.t.ppf(0.95, 7) / stats.norm.ppf(0.95)
    assert np.median(found.low / value) == pytest.approx(1.0 - wider * (1.0 - low), abs=0.01)
    assert np.median(found.high / value) == pytest.approx(1.0 + wider * (high - 1.0), abs=0.01)
    covered = np.mean((found.low <= 1.0) & (found.high >= 1.0))
    assert covered == pytest.approx(0.9, abs=0.015)


def test_the_root_of_a_mean_of_squares_has_the_roots_of_its_ends() -> None:
    blocks = np.random.default_rng(3).gamma(2.0, size=(BLOCKS, 5))
    value, without, present = blocks.mean(axis=0), leave_out(blocks), everywhere(blocks.shape)
    plain = satterthwaite(value, without, present, 0.9)
    root = satterthwaite(np.sqrt(value), np.sqrt(without), present, 0.9, power=2)
    np.testing.assert_allclose(root.low**2, plain.low, rtol=1e-12)
    np.testing.assert_allclose(root.high**2, plain.high, rtol=1e-12)
    np.testing.assert_allclose(root.value**2, plain.value, rtol=1e-12)


def test_what_one_block_holds_all_of_has_a_wide_and_finite_interval() -> None:
    blocks = np.zeros((BLOCKS, 2))
    blocks[3] = 8.0
    blocks[:, 1] += 1e-12
    found = satterthwaite(blocks.mean(axis=0), leave_out(blocks), everywhere(blocks.shape), 0.9)
    tail = stats.norm.cdf(stats.t.ppf(0.05, 7))
    np.testing.assert_allclose(found.low, 2.0 / stats.chi2.ppf(1.0 - tail, 2), rtol=1e-9)
    np.testing.assert_allclose(found.high, 2.0 / stats.chi2.ppf(tail, 2), rtol=1e-9)


def test_what_is_the_same_in_every_block_has_an_interval_of_no_width() -> None:
    blocks = np.tile([0.0, 4.0], (BLOCKS, 1))
    value, without, present = blocks.mean(axis=0), leave_out(blocks), everywhere(blocks.shape)
    for found in (
        student(value, without, present, 0.9),
        satterthwaite(value, without, present, 0.9),
        satterthwaite(value, without, present, 0.9, power=2),
    ):
        assert np.array_equal(found.low, value) and np.array_equal(found.high, value)


def test_one_block_or_an_undefined_index_has_no_interval() -> None:
    value, without = np.array([0.0, 1.0, 1.0]), np.full((BLOCKS, 3), np.nan)
    present = everywhere(without.shape)
    present[1:, :2] = False
    without[:, 2] = 1.0
    without[4, 2] = np.nan
    for found in (
        student(value, without, present, 0.9),
        satterthwaite(value, without, present, 0.9),
    ):
        assert np.all(np.isnan(found.low)) and np.all(np.isnan(found.high))


@pytest.mark.parametrize("level", [0.0, 1.0, 90.0])
def test_a_level_is_a_probability(level: float) -> None:
    one = np.ones((BLOCKS, 1))
    for interval in (student, satterthwaite):
        with pytest.raises(ValueError, match="level of an interval must be between 0 and 1"):
            interval(one[0], one, one > 0.0, level)
