"""Comparisons of two models' losses: by their mean, and by how steadily one of them wins."""

import numpy as np
import pytest
from scipy import stats

from analysis.closeloop.identification.balance.regression import (
    compare,
    rank_z,
    ratio_z,
    select_rows,
    takes_all,
)
from tests.testbed.sessions.effects import Arm
from tests.testbed.sessions.rich import swung
from tests.testbed.sessions.synthetic import mjcf


def test_the_rank_statistic_is_wilcoxons() -> None:
    rng = np.random.default_rng(4)
    worse, better = 1.2 + rng.random(60), 1.0 + rng.random(60)
    found = stats.wilcoxon(worse, better, method="approx", correction=False)
    assert abs(rank_z(worse, better)) == pytest.approx(abs(float(found.zstatistic)))
    assert rank_z(worse, better) == -rank_z(better, worse) > 0


def test_a_gain_that_few_blocks_hold_is_steady_though_its_mean_is_not() -> None:
    better = np.full(40, 1.0)
    worse = better + np.where(np.arange(40) < 2, 1000.0, 0.5)
    gain, error = compare(worse, better)
    assert gain / error < 2.0
    assert rank_z(worse, better) > 5.0


def test_equal_losses_win_nothing() -> None:
    assert rank_z(np.ones(9), np.ones(9)) == 0.0


def test_what_differs_by_rounding_is_within_an_error() -> None:
    """One torque under two names: its last digits may lie to one side in every block."""
    better = np.full(40, 60.0)
    lost, error = compare(better + 5e-12, better)
    assert 0.0 < lost <= error < 1e-5


def test_one_block_wins_nothing_for_certain() -> None:
    """A session of one movement may have one second only: no spread is told, and none warned of."""
    assert compare(np.array([9.0]), np.array([1.0])) == (8.0, np.inf)


def test_what_takes_all_of_one_quick_second_and_of_most_others_is_no_luck() -> None:
    rng = np.random.default_rng(5)
    better = 1.0 + 0.1 * rng.random(40)
    quick = better + np.where(np.arange(40) == 3, 1000.0, 0.2)
    gain, error = compare(quick, better)
    assert gain / error < 2.0
    assert takes_all(quick, better)
    # One second alone, with the others as they were, may be anything.
    alone = better + np.where(np.arange(40) == 3, 1000.0, 0.1 * rng.standard_normal(40))
    assert not takes_all(alone, better)


def test_a_block_is_a_movement_of_a_quick_joint_and_a_second_of_a_slow_one() -> None:
    """In 7.5 s of a robot that turns around each 0.6 s no coupling could be told from luck."""
    recording = swung(mjcf(Arm()), (-0.5, 1.0), (0.8, 0.2), seconds=20)
    rows = select_rows(recording, (0,))
    clock = np.concatenate([recording.time[own] for own in rows.samples.values()])
    lengths: list[list[float]] = [[], []]
    for block in range(int(rows.block.max()) + 1):
        own = rows.block == block
        lengths[rows.joint_of_block[block]].append(np.ptp(clock[own]))
    quick, slow = (float(np.median(own)) for own in lengths)
    assert quick == pytest.approx(0.625, abs=0.1)
    assert slow == pytest.approx(1.0, abs=0.1)


def test_what_takes_nearly_all_of_each_of_a_few_blocks_is_no_luck() -> None:
    """Five movements of which a fast one holds most: ranks of five are never sure."""
    worse = np.array([45600.0, 137800.0, 36200.0, 73600.0, 52300.0])
    better = np.array([119.0, 150.0, 122.0, 91.0, 108.0])
    assert takes_all(worse, better) and rank_z(worse, better) < 2.5
    # As much in all, of two of them nothing.
    assert not takes_all(worse, np.where(worse > 60000.0, better, 1.2 * worse))


def test_a_factor_by_which_losses_fall_is_judged_by_student_s_t() -> None:
    rng = np.random.default_rng(3)
    worse, better = rng.lognormal(1.0, 0.5, 6), rng.lognormal(0.2, 0.5, 6)
    found = stats.ttest_rel(np.log(worse), np.log(better), alternative="greater")
    assert ratio_z(worse, better) == pytest.approx(float(stats.norm.isf(found.pvalue)))
    by_chance = [ratio_z(*rng.lognormal(0.0, 1.0, (2, 5))) > 2.5 for _ in range(4000)]
    assert np.mean(by_chance) == pytest.approx(stats.norm.sf(2.5), abs=0.004)
    assert ratio_z(np.ones(2), np.full(2, 1e-9)) == 0.0
