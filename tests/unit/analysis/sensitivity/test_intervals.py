"""What intervals promise: the textbook's where there is one, and a number wherever one is due."""

from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import optimize, stats

from analysis.designs import unit_row, unit_rows
from analysis.sensitivity.estimators import MorrisEstimator
from analysis.sensitivity.estimators.intervals import fieller, satterthwaite, student

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


def ratio(
    parts: NDArray[np.float64], wholes: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the ratio of the means of blocks, that without each block, and the wholes of both."""
    whole = np.concatenate([wholes.mean(axis=0)[None], leave_out(wholes)])
    return parts.mean(axis=0) / whole[0], leave_out(parts) / whole[1:], whole


def test_of_a_ratio_it_is_what_a_t_test_of_part_minus_share_times_whole_does_not_reject() -> None:
    """Of blocks that lie symmetrically about their mean, so that skewness adds nothing."""
    apart = np.random.default_rng(4).normal(size=(2, BLOCKS // 2))
    parts, wholes = np.concatenate([apart, -apart], axis=1) * [[0.3], [0.6]] + [[0.4], [2.0]]
    value, without, whole = ratio(parts[:, None], wholes[:, None])
    found = fieller(value, without, everywhere(without.shape), 0.9, whole)

    def rejected(share: float) -> float:
        return float(stats.ttest_1samp(parts - share * wholes, 0.0).pvalue) - 0.1

    np.testing.assert_allclose(found.low, optimize.brentq(rejected, -2.0, value[0]), rtol=1e-9)
    np.testing.assert_allclose(found.high, optimize.brentq(rejected, value[0], 3.0), rtol=1e-9)


def test_of_a_whole_that_is_known_it_is_johnsons_interval_of_the_blocks() -> None:
    parts = np.random.default_rng(5).gamma(0.5, size=(BLOCKS, 4))
    value, without, whole = ratio(parts, np.full((BLOCKS, 1), 2.0))
    found = fieller(value, without, everywhere(without.shape), 0.9, whole)
    oracle = stats.ttest_1samp(parts, 0.0).confidence_interval(0.9)
    shift = stats.kstat(parts, 3, axis=0) / (6.0 * BLOCKS * parts.var(axis=0, ddof=1))
    np.testing.assert_allclose(found.low, (oracle.low + shift) / 2.0, rtol=1e-12)
    np.testing.assert_allclose(found.high, (oracle.high + shift) / 2.0, rtol=1e-12)


def test_a_ratio_holds_the_truth_as_often_on_either_side_where_a_jackknife_of_it_does_not() -> None:
    """Of eight normal parts of 0.5 and wholes of 1 that err by a half each, independently."""
    rng = np.random.default_rng(6)
    parts = 0.5 + 0.1 * rng.normal(size=(BLOCKS, 20000))
    wholes = 1.0 + 0.5 * rng.normal(size=(BLOCKS, 20000))
    value, without, whole = ratio(parts, wholes)
    there = everywhere(without.shape)
    students, ours = (
        (np.mean(found.high < 0.5), np.mean(found.low > 0.5))
        for found in (
            student(value, without, there, 0.9),
            fieller(value, without, there, 0.9, whole),
        )
    )
    assert students[0] > 0.08
    assert ours == (pytest.approx(0.05, abs=0.01), pytest.approx(0.05, abs=0.01))


def test_blocks_of_which_few_err_much_do_not_make_a_ratio_s_interval_hold_too_much() -> None:
    """Student's t with two degrees of freedom, as errors of Sobol points of a linear function."""
    parts = np.random.default_rng(7).standard_t(2, size=(BLOCKS, 20000))
    value, without, whole = ratio(parts, np.ones((BLOCKS, 1)))
    there = everywhere(without.shape)
    student_s, ours = (
        np.mean((found.low <= 0.0) & (found.high >= 0.0))
        for found in (
            student(value, without, there, 0.9),
            fieller(value, without, there, 0.9, whole),
        )
    )
    assert 0.9 < ours < student_s - 0.004


def test_a_share_of_a_whole_that_may_be_nothing_has_an_interval_with_ends_about_it() -> None:
    rng = np.random.default_rng(8)
    parts, wholes = rng.normal(size=(2, BLOCKS, 500))
    value, without, whole = ratio(parts, wholes)
    found = fieller(value, without, everywhere(without.shape), 0.9, whole)
    assert np.all((found.low < value) & (value < found.high))
    assert np.all(np.isfinite(found.low) & np.isfinite(found.high))


def test_a_tail_that_blocks_lack_widens_their_spread_and_takes_degrees_of_freedom() -> None:
    blocks = np.random.default_rng(9).gamma(20.0, size=(BLOCKS, 3))
    value, without = blocks.mean(axis=0), leave_out(blocks)
    stretch = np.array([1.0, 1.3, 4.0])
    found = satterthwaite(value, without, everywhere(blocks.shape), 0.9, stretch=stretch)
    variation = np.sqrt(7.0 * np.var(np.log(without), axis=0)) * stretch
    freedom = [7.0, 7.0 / 1.69, 3.0]  # no fewer than three
    for j in range(3):
        tail = stats.norm.cdf(stats.t.ppf(0.05, freedom[j]))
        rows = 2.0 / variation[j] ** 2
        assert variation[j] < 1.0
        assert found.low[j] == pytest.approx(value[j] * rows / stats.chi2.isf(tail, rows))
        assert found.high[j] == pytest.approx(value[j] * rows / stats.chi2.ppf(tail, rows))


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
    whole = np.ones((1 + BLOCKS, 1))
    found = fieller(some.mean(axis=0), without, present, 0.9, whole)
    expected = fieller(
        some.mean(axis=0), leave_out(some), everywhere(some.shape), 0.9, whole[: 1 + len(some)]
    )
    assert found.low == pytest.approx(expected.low) and found.high == pytest.approx(expected.high)


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


def test_two_blocks_tell_no_end_of_a_mean_of_squares_at_any_level() -> None:
    """Bands of curves ask for levels at which Student's quantile of one degree is a thousand."""
    blocks = np.array([[1.0], [1.2]])
    value, without, present = blocks.mean(axis=0), leave_out(blocks), everywhere(blocks.shape)
    found = satterthwaite(value, without, present, 1.0 - 1e-4)
    assert np.isnan(found.low).all() and np.isnan(found.high).all()


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
        fieller(value, without, present, 0.9, np.arange(1.0, 2.0 + BLOCKS)[:, None]),
        satterthwaite(value, without, present, 0.9),
        satterthwaite(value, without, present, 0.9, stretch=np.ones(2)),
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
        fieller(value, without, present, 0.9, np.ones((1 + BLOCKS, 1))),
        satterthwaite(value, without, present, 0.9),
        satterthwaite(value, without, present, 0.9, stretch=np.ones(3)),
    ):
        assert np.all(np.isnan(found.low)) and np.all(np.isnan(found.high))


@pytest.mark.parametrize("level", [0.0, 1.0, 90.0])
def test_a_level_is_a_probability(level: float) -> None:
    one = np.ones((BLOCKS, 1))
    for interval in (student, satterthwaite, partial(fieller, whole=np.ones((1 + BLOCKS, 1)))):
        with pytest.raises(ValueError, match="level of an interval must be between 0 and 1"):
            interval(one[0], one, one > 0.0, level)


def test_the_spread_of_effects_of_balanced_points_is_held_though_n_minus_1_is_too_few() -> None:
    """The effect of one factor is the other, uniform one: eight sequences know its spread."""
    held = []
    for seed in range(6):
        rows = range(256)
        points = unit_rows("morris", "owen_blocks", seed, rows, 2)
        estimator = MorrisEstimator(sampling="owen_blocks", seed=seed, factors=2, outputs=1)
        estimator.add_rows(rows, points.prod(axis=-1)[..., None])
        sigma = estimator.indices(0.9)["sigma"]
        truth = np.sqrt(1.0 / 12.0)
        held += (
            (sigma.low <= truth) & (truth <= sigma.high) & (sigma.value <= sigma.high)
        ).tolist()
    assert np.mean(held) >= 0.75


def test_a_mean_of_squares_has_no_interval_from_fewer_than_four_rows() -> None:
    """Of two rows it reached to 1.5e9 where the effects were 10: a number that says nothing."""
    estimator = MorrisEstimator(sampling="owen_blocks", seed=2, factors=2, outputs=1)
    for row in range(4):
        found = estimator.indices()
        assert all(np.isnan(found[name].high).all() for name in ("mu_star", "sigma")), row
        assert all(np.isnan(found[name].low).all() for name in ("mu_star", "sigma")), row
        points = unit_row("morris", "owen_blocks", 2, row, 2)
        estimator.add_rows([row], 10.0 * (points[:, :1] + points[:, 1:] ** 2)[None])
    found = estimator.indices()
    largest = found["mu_star"].value.max()
    assert largest > 5.0
    assert (found["mu_star"].low >= 0.0).all() and (found["mu_star"].high < 110.0 * largest).all()


@pytest.mark.parametrize(("rows", "kept"), [(32, 0.75), (128, 0.0)])
def test_ends_from_few_rows_of_effects_keep_a_share_of_what_independent_rows_err(
    rows: int, kept: float
) -> None:
    """Rows that differ while their blocks agree: four rows of a block tell little of its error."""
    estimator = MorrisEstimator(sampling="owen_blocks", seed=3, factors=1, outputs=1)
    points = unit_rows("morris", "owen_blocks", 3, range(rows), 1)
    size = np.where(np.arange(rows) // BLOCKS % 2, 1.0, 3.0)[:, None]
    estimator.add_rows(range(rows), size[..., None] * points)
    mu = estimator.statistics()["mu"]
    found, error = mu.estimate(0.9), mu.weighted[1:].std(axis=0)
    np.testing.assert_allclose(found.value, 2.0)
    least = kept * stats.norm.ppf(0.95) * error
    np.testing.assert_allclose(found.high - found.value, least, atol=1e-9)
    np.testing.assert_allclose(found.value - found.low, least, atol=1e-9)
