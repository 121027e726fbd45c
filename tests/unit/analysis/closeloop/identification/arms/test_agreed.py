"""What left-out groups of a joint are to miss, so that an effect is kept."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from analysis.closeloop.identification.arms.agreed import missed, shared_by_joints
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from tests.testbed.sessions.coupled import in_trials, measured


def shares(groups: int, *, comes_back: bool = True) -> dict[str, float | None]:
    """Return what is missed of friction and of a coupling that a few seconds of each group show.

    By 2.5 to 4 errors and three quarters of what is left, as of two runs of a KUKA KR300.
    """
    bare = in_trials(np.ones((groups, 3), dtype=bool))
    robot = measured(bare, bare.inverse)
    rows: Rows = select_rows(robot, robot.fit_trials).of_joint(0)
    loud = np.random.default_rng(5).exponential(1.0, int(rows.block.max()) + 1) ** 2
    if not comes_back:
        loud[rows.fold_of_block == 0] = 0.0
    size = 1e3 * rows.effort_power(0) / len(rows.block)
    left = np.sqrt(size * (0.3 + (loud / loud.mean())[rows.block]))
    found = np.full(len(rows.block), np.sqrt(0.5 * size))
    without, whole = (
        SimpleNamespace(left=own, losses=(one := np.bincount(rows.block, own**2)), loss=one.sum())
        for own in (left, found)
    )
    return {
        name: missed(without, whole, 0, rows, name)
        for name in ("viscous_friction", "cross_joint_coupling")
    }


def test_of_two_groups_both_are_enough_for_friction_and_not_for_what_is_rare() -> None:
    friction, coupling = shares(2).values()
    assert friction is None
    assert coupling is not None


def five_seconds(after: tuple[float, ...]) -> dict[str, float | None]:
    """Return the same where two groups have five seconds and what is left of each."""
    block = np.repeat(np.arange(5), 20)
    rows = cast(
        Rows,
        SimpleNamespace(
            joint_of_block=np.zeros(5, dtype=int),
            fold_of_block=np.array([0, 0, 0, 1, 1]),
            folds=(0, 1),
            parts={0: slice(0, 100)},
            block=block,
            recording=SimpleNamespace(limbs=()),
            effort_power=lambda joint: 1.0,
            smoothing_power=lambda joint: 1.0,
        ),
    )
    before = np.array([2.0, 130.0, 8.0, 5.0, 55.0])
    without, whole = (
        SimpleNamespace(left=np.sqrt(own[block] / 20.0), losses=own, loss=own.sum())
        for own in (before, before * np.array(after))
    )
    return {
        name: missed(without, whole, 0, rows, name)
        for name in ("coulomb_friction", "cross_joint_coupling")
    }


def test_few_seconds_are_enough_for_friction_that_takes_most_of_every_group() -> None:
    """Five seconds told no error of a KUKA LBR's, which took four fifths of both groups."""
    friction, coupling = five_seconds((0.5, 0.2, 1.2, 0.9, 0.3)).values()
    assert friction is None
    assert coupling is not None
    less_than_half, _ = five_seconds((0.9, 0.6, 1.2, 0.9, 0.6)).values()
    of_one_group, _ = five_seconds((0.5, 0.2, 1.2, 0.9, 1.0)).values()
    assert less_than_half is not None
    assert of_one_group is not None


def test_what_one_group_alone_shows_is_not_kept() -> None:
    assert all(share is not None for share in shares(2, comes_back=False).values())


@pytest.mark.parametrize("groups", [3, 4])
def test_of_more_groups_three_are_enough_for_any_effect(groups: int) -> None:
    assert set(shares(groups).values()) == {None}


@pytest.mark.parametrize(
    ("blocks", "worse", "times", "kept"),
    [(20, 20, 1.1, False), (20, 1, 1.1, True), (1, 1, 1.1, False), (20, 1, 11.0, False)],
)
def test_a_joint_speaks_against_what_joints_share_by_more_than_chance_or_by_much(
    blocks: int, worse: int, times: float, kept: bool
) -> None:
    """The second joint loses a tenth: in all of its seconds alike, in one, or in its only one.

    And ten times all that it lost before in one, as of a KUKA KR300: its error is as large.
    """
    own = np.repeat([0, 1], [600, blocks])
    alone = np.where(own == 1, 1.0, 10.0)
    shared = np.where(own == 1, 0.9, 5.0)
    shared[600 : 600 + worse] += (times - 0.9) * blocks / worse
    rows = SimpleNamespace(
        joints=(0, 1),
        joint_of_block=own,
        recording=SimpleNamespace(limbs=()),
        fold_of_block=np.arange(len(own)) % 4,
        effort_power=lambda _: 1.0,
    )
    first, other = (SimpleNamespace(losses=one, loss=one.sum()) for one in (alone, shared))
    assert bool(shared_by_joints(first, other, cast(Rows, rows))) is kept


@pytest.mark.parametrize(("times", "kept"), [(0.3, True), (0.999, False)])
def test_a_joint_that_feels_nothing_of_it_asks_for_nothing(times: float, kept: bool) -> None:
    """A slide measured without noise that counts kept an opponent's arm from its load.

    Of the joint that feels it less than a hundredth of the effort is smoothing's.
    """
    own = np.repeat([0, 1], [40, 40])
    alone = np.full(80, 10.0)
    shared = np.where(own == 0, times * alone, alone)
    rows = SimpleNamespace(
        joints=(0, 1),
        joint_of_block=own,
        recording=SimpleNamespace(limbs=()),
        fold_of_block=np.arange(80) % 4,
        effort_power=lambda joint: 1e6 if joint == 0 else 1e12,
        smoothing_power=lambda _: 1.0,
    )
    first, other = (SimpleNamespace(losses=o, loss=o.sum()) for o in (alone, shared))
    assert bool(shared_by_joints(first, other, cast(Rows, rows))) is kept


@pytest.mark.parametrize(("left", "kept"), [(0.1, True), (0.5, False)])
def test_what_takes_nearly_all_that_is_left_need_not_be_much_of_the_effort(
    left: float, kept: bool
) -> None:
    """Of arms with little noise, a load on two of three joints: seven hundredths of the effort."""
    own = np.repeat([0, 1], [40, 40])
    alone = np.full(80, 10.0) + np.random.default_rng(1).random(80)
    rows = SimpleNamespace(
        joints=(0, 1),
        joint_of_block=own,
        recording=SimpleNamespace(limbs=()),
        fold_of_block=np.arange(80) % 4,
        effort_power=lambda _: 1e7,
        smoothing_power=lambda _: 1.0,
    )
    first, other = (SimpleNamespace(losses=o, loss=o.sum()) for o in (alone, left * alone))
    assert bool(shared_by_joints(first, other, cast(Rows, rows))) is kept
