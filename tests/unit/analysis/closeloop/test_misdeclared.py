"""What a robot's trials contradict is told before any effect is made of it."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from analysis.closeloop.errors import SessionError
from analysis.closeloop.misdeclared import check_declared, doubtful_gravity
from analysis.closeloop.session.device import Device
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.signs import check_signs
from tests.testbed.sessions.effects import Arm
from tests.testbed.sessions.moved import moved
from tests.testbed.sessions.rich import rich_recording
from tests.testbed.sessions.synthetic import mjcf

#: Nm and Nm s/rad, of both joints; the model declares neither.
COULOMB, VISCOUS = 0.8, 0.3


def with_efforts(robot: Recording, efforts: np.ndarray) -> Recording:
    session = replace(robot.session, limb_joints=())
    robot = replace(robot, session=session, joints=(0, 1), cache={})
    return replace(robot, effort=robot.filtered(efforts), cache={})


@pytest.fixture(scope="module")
def robot() -> Recording:
    """Two joints that rub, without a limb, in motion of three frequencies each."""
    t = np.arange(2000) / 200.0
    waves = np.sin(2 * np.pi * t[:, None, None] * np.array([[0.2, 0.5, 1.1], [0.3, 0.7, 1.3]]))
    rich = moved(rich_recording(10), waves @ [0.9, 0.4, 0.1] + [-0.5, 1.0], 200.0)
    rubbing = COULOMB * np.tanh(rich.velocity / 0.01) + VISCOUS * rich.velocity
    noise = 0.05 * np.random.default_rng(6).standard_normal(rich.position.shape)
    return with_efforts(rich, rich.inverse + rubbing + noise)


def refused(robot: Recording) -> SessionError:
    with pytest.raises(SessionError) as caught:
        check_declared(robot)
    return caught.value


def test_nothing_is_said_of_a_robot_that_is_as_declared(robot: Recording) -> None:
    check_declared(robot)
    assert doubtful_gravity(robot) == []


@pytest.mark.parametrize("joint", [0, 1])
def test_an_effort_that_is_turned_round_is_refused(robot: Recording, joint: int) -> None:
    sign = np.where(np.arange(2) == joint, -1.0, 1.0)
    error = refused(replace(robot, effort=robot.effort * sign, cache={}))
    assert error.column == f"{robot.name(joint)}.effort" and error.file == "a.csv"
    assert "has the opposite sign" in str(error)


def test_two_efforts_that_are_exchanged_are_refused(robot: Recording) -> None:
    error = refused(replace(robot, effort=robot.effort[:, ::-1], cache={}))
    assert error.column == "shoulder.effort" and "exchanged with that of elbow" in str(error)


def test_a_counterweight_is_no_wrong_sign(robot: Recording) -> None:
    # It pulls twice as hard as the links, and friction and inertia still resist.
    balanced = robot.effort - 2.0 * robot.filtered(robot.static)
    check_declared(replace(robot, effort=balanced, cache={}))


def test_another_gravity_is_said_and_is_no_wrong_sign(robot: Recording) -> None:
    hung = np.array(robot.effort)
    for joint in robot.joints:
        hung[:, joint] -= 2.0 * robot.filtered(robot.weight(joint) @ robot.gravity[:, None])[:, 0]
    upside_down = replace(robot, effort=hung, cache={})
    check_declared(upside_down)
    (said,) = doubtful_gravity(upside_down)
    assert said.startswith("the joints move as in a gravity of [0, 0, 9.81] m/s2")
    assert said.endswith('say "gravity": [0, 0, 9.81] in session.json')


def test_a_spring_is_no_other_gravity(robot: Recording) -> None:
    # Of an opponent: 4 Nm/rad about an axis were gravity along x.
    pulled = robot.effort + robot.filtered(6.0 * (robot.position - robot.position.mean(axis=0)))
    assert doubtful_gravity(replace(robot, effort=pulled, cache={})) == []


def test_of_a_joint_that_hardly_moves_no_sign_is_asked(robot: Recording) -> None:
    # Of an opponent: a tool beside the roll axis of a SCARA, which moved by 0.01 rad.
    small = np.array(robot.position)
    small[:, 1] = 1.0 + 0.05 * (small[:, 1] - 1.0)
    still = with_efforts(moved(robot, small, 200.0), robot.effort)
    sign = np.array([1.0, -1.0])
    turned = replace(still, effort=still.filtered(still.inverse * sign), cache={})
    check_declared(turned)


def test_declared_friction_that_is_too_high_is_no_wrong_sign(robot: Recording) -> None:
    spec = mujoco.MjSpec.from_string(mjcf(Arm()))
    for name in ("shoulder", "elbow"):
        spec.joint(name).frictionloss = 3.0 * COULOMB
    rubbing = replace(robot, device=Device(spec, ()), cache={})
    check_declared(rubbing)
    check_signs(rubbing)


def test_a_model_that_holds_its_own_links_is_pointed_at(robot: Recording) -> None:
    spec = mujoco.MjSpec.from_string(mjcf(Arm()))
    spec.body("forearm").gravcomp = 1.0
    compensated = replace(robot, device=Device(spec, ()), cache={})
    said = doubtful_gravity(compensated)
    assert "(gravcomp of forearm)" in said[-1]


def test_of_a_limb_nothing_is_asked() -> None:
    limb = rich_recording(10)
    turned = replace(limb, effort=limb.filtered(-limb.inverse), cache={})
    check_declared(turned)
    assert doubtful_gravity(turned) == []
