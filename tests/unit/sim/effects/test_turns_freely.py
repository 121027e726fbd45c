"""At a motor that turns on and on nothing is offered that winds up or has an end."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import unfitted
from analysis.closeloop.identification.candidates import candidates
from analysis.closeloop.session.device import Device
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from sim.effects.effect import turns_freely
from tests.testbed.sessions.effects import Arm
from tests.testbed.sessions.rubbing import rubbing_robot
from tests.testbed.sessions.synthetic import mjcf

#: Effects of the position alone, without a period.
WOUND_UP = {"joint_stiffness", "nonlinear_stiffness", "position_dependent_friction"}


@pytest.fixture(scope="module")
def robot() -> Recording:
    return rubbing_robot()


def turning(robot: Recording, turns: float, range_in_turns: float | None = None) -> Recording:
    """Return the robot with an elbow that turns so often."""
    spec = mujoco.MjSpec.from_string(mjcf(Arm()))
    elbow = spec.joint("elbow")
    elbow.limited = range_in_turns is not None
    if range_in_turns is not None:
        elbow.range = np.array([-0.5, 0.5]) * range_in_turns * 2.0 * np.pi
    position = np.array(robot.position)
    position[:, 1] *= turns * 2.0 * np.pi / np.ptp(position[:, 1])
    return replace(robot, position=position, device=Device(spec, ()), cache={})


@pytest.mark.parametrize(
    ("turns", "declared", "free"),
    [(1.5, None, False), (3.0, None, True), (3.0, 4.0, False), (300.0, 2000.0, True)],
)
def test_a_joint_turns_freely_beyond_two_turns_or_beyond_ten_of_any_range(
    robot: Recording, turns: float, declared: float | None, free: bool
) -> None:
    assert turns_freely(turning(robot, turns, declared), 1) is free


def offered(recording: Recording) -> set[str]:
    return {one.effect.name for one in candidates(recording) if one.joint == 1}


def test_no_spring_is_offered_at_a_motor_that_turns_on_and_on(robot: Recording) -> None:
    assert offered(turning(robot, 1.5)) >= WOUND_UP
    there = offered(turning(robot, 300.0, 2000.0))
    assert not there & WOUND_UP
    assert there >= {"coulomb_friction", "torque_offset", "torque_ripple", "added_inertia"}


def test_nothing_winds_up_over_more_than_two_turns_of_it(robot: Recording) -> None:
    joint = unfitted(turning(robot, 300.0), 1)
    hysteresis = BY_NAME["hysteresis"]
    assert hysteresis.thetas(joint) == []
    assert hysteresis.beyond(joint, {"distance": 0.5, "exponent": 1.0}, {}) == "distance"


def test_no_other_joint_is_coupled_to_its_position(robot: Recording) -> None:
    free = turning(robot, 300.0)
    coupling = BY_NAME["cross_joint_coupling"]
    near = {theta["by"] for theta in coupling.thetas(unfitted(robot, 0))}
    far = {theta["by"] for theta in coupling.thetas(unfitted(free, 0))}
    assert 0.0 in near and near - far == {0.0}
