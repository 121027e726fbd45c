"""What left-out groups of a joint are to miss, so that an effect is kept."""

from types import SimpleNamespace

import numpy as np
import pytest

from analysis.closeloop.identification.arms.agreed import missed, shared_by_joints
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from tests.testbed.sessions.coupled import in_trials, measured, moving


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


def test_what_one_group_alone_shows_is_not_kept() -> None:
    assert all(share is not None for share in shares(2, comes_back=False).values())


@pytest.mark.parametrize("groups", [3, 4])
def test_of_more_groups_three_are_enough_for_any_effect(groups: int) -> None:
    assert set(shares(groups).values()) == {None}


@pytest.mark.parametrize(("every_second", "kept"), [(True, False), (False, True)])
def test_a_joint_speaks_against_what_joints_share_by_more_than_one_standard_error(
    every_second: bool, kept: bool
) -> None:
    """A tenth of the second joint's loss is added to each second, or all of it to one of ten."""
    bare = moving()
    robot = measured(bare, bare.inverse)
    rows = select_rows(robot, robot.fit_trials)
    alone = np.array([rows.effort_power(joint) for joint in rows.joint_of_block])
    shared = np.where(rows.joint_of_block == 1, alone, 0.5 * alone)
    own = np.flatnonzero(rows.joint_of_block == 1)
    shared[own if every_second else own[:1]] *= 1.1 if every_second else 1.0 + 0.1 * len(own)
    first, other = (SimpleNamespace(losses=one, loss=one.sum()) for one in (alone, shared))
    assert shared_by_joints(first, other, rows) is kept
