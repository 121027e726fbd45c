"""Trials that alone show something are left out by halves."""

from dataclasses import replace

import numpy as np

from analysis.closeloop.identification.arms.robot import traced_robot, weighed
from analysis.closeloop.identification.balance.halves import lone_movers
from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.balance.uncertainty import partitions
from analysis.closeloop.identification.tracing import trace
from analysis.closeloop.session.recording import Recording
from tests.testbed.sessions.coupled import in_trials, measured

TRIALS, ALONE = 5, 2


def movers(*travel: tuple[float, ...]) -> set[str]:
    """Return which of some groups alone move a joint; the second and third have a balance."""
    return lone_movers({str(n): [np.array(own)] for n, own in enumerate(travel)}, (1, 2))


def first_joint_in(*moved: int) -> Recording:
    """Return the robot in trials of 4 s, of which some alone move the first joint."""
    moves = np.ones((TRIALS, 3), dtype=bool)
    moves[:, 0] = np.isin(np.arange(TRIALS), moved)
    return in_trials(moves)


def named(robot: Recording, effort: np.ndarray) -> set[tuple[str, int]]:
    """Return the effects, with their joints, that are found in a noisy effort."""
    loud = measured(robot, effort)
    rows = select_rows(loud, loud.fit_trials)
    found = traced_robot(Model(loud), weighed(Model(loud), rows), lambda _: None)
    return {step.key for step in found.steps}


def folds_by_trial(robot: Recording) -> list[int]:
    """Return over how many folds the rows of each trial are spread."""
    rows = select_rows(robot, robot.fit_trials)
    return [len(set(rows.fold[rows.trial == number])) for number in range(TRIALS)]


def test_a_group_that_alone_moves_a_joint_is_told_whether_the_joint_has_a_balance_or_not() -> None:
    assert movers((0.0, 1.0, 1.0), (0.3, 0.8, 0.6), (0.001, 1.0, 1.0)) == {"1"}
    assert movers((0.2, 1.0, 0.0), (0.3, 0.8, 0.6), (0.3, 1.0, 0.0)) == {"1"}
    # As a controller holds it while another joint moves.
    assert movers((0.08, 1.0, 1.0), (0.67, 0.8, 0.6), (0.09, 1.0, 1.0)) == {"1"}
    assert movers((0.3, 1.0, 0.0), (0.0, 0.8, 0.0), (0.0, 1.0, 0.7)) == {"0", "2"}


def test_what_two_groups_move_and_last_digits_of_a_held_joint_are_not_alone() -> None:
    assert movers((0.1, 1.0, 1.0), (0.3, 0.8, 0.6), (0.001, 1.0, 1.0)) == set()
    assert movers((0.004, 1.0, 1.0), (0.0, 0.8, 0.6), (0.0, 1.0, 1.0)) == set()


def test_a_group_that_alone_moves_two_joints_at_once_is_told() -> None:
    """What one does at the other is known from no other group, though each moves in several."""
    one, other, both = (0.1, 1.0, 0.0), (0.1, 0.0, 0.8), (0.1, 0.7, 0.9)
    assert movers(one, other, one, other, both) == {"4"}
    assert movers(one, other, both, both) == set()


def test_joints_that_one_trial_of_a_group_moves_after_another_do_not_move_at_once() -> None:
    apart = [np.array((0.1, 1.0, 0.0)), np.array((0.1, 0.0, 0.8))]
    both = [np.array((0.1, 0.7, 0.9))]
    assert lone_movers({"a": apart, "b": both, "c": apart}, (1, 2)) == {"b"}


def test_beside_a_group_that_holds_every_joint_with_a_balance_no_other_is_alone() -> None:
    assert movers((0.0, 0.001, 0.0), (0.3, 0.8, 0.6), (0.2, 0.0, 0.0)) == set()


def test_the_trial_that_alone_moves_a_joint_is_left_out_by_halves() -> None:
    assert folds_by_trial(first_joint_in(ALONE)) == [1, 1, 2, 1, 1]
    assert folds_by_trial(first_joint_in(ALONE, ALONE + 1)) == [1, 1, 1, 1, 1]


def test_a_trial_that_alone_moves_a_joint_since_somebody_pushes_it_is_not_halved() -> None:
    robot = first_joint_in(ALONE)
    pushed = (robot.trial == ALONE)[:, None] & (np.arange(3) == 0)
    assert 2 not in folds_by_trial(replace(robot, disturbed=pushed, cache={}))


def test_a_coupling_is_found_though_one_trial_alone_moves_the_neighbour() -> None:
    robot = first_joint_in(ALONE)
    effort = np.array(robot.inverse)
    effort[:, 1] += 0.5 * (robot.position[:, 0] - 0.1)
    assert named(robot, effort) == {("cross_joint_coupling", 1)}


def test_friction_is_found_where_each_trial_moves_one_joint_alone() -> None:
    """As robots are often identified. Left out whole, a trial's friction is known from no other."""
    robot = in_trials(np.eye(3, dtype=bool))
    friction = 0.3 * np.tanh(robot.velocity / 0.01) + 0.2 * robot.velocity
    effects = ("coulomb_friction", "viscous_friction")
    wanted = {(name, joint) for name in effects for joint in range(3)}
    assert named(robot, robot.inverse + friction) == wanted


def test_seconds_of_a_trial_that_alone_moves_a_joint_are_left_out_for_its_interval() -> None:
    robot = first_joint_in(ALONE)
    rows = select_rows(robot, robot.fit_trials)
    left_out = partitions(rows)[0]
    alone = rows.trial == ALONE
    assert len(np.unique(left_out[~alone])) == TRIALS - 1
    assert len(np.unique(left_out[alone])) == len(np.unique(rows.block[alone]))


def test_of_four_trials_that_move_a_joint_each_friction_keeps_its_name() -> None:
    """Each was found, and then dropped: without its trial its size might be anything."""
    moves = np.eye(3, dtype=bool)[[0, 1, 2, 2]]
    robot = in_trials(moves)
    friction = 0.3 * np.tanh(robot.velocity / 0.01) + 0.2 * robot.velocity
    loud = measured(robot, robot.inverse + friction)
    found = trace(loud)
    effects = ("coulomb_friction", "viscous_friction")
    assert {step.key for step in found.steps} == {(n, j) for n in effects for j in range(3)}
