"""What a robot's trials contradict is told before any effect is made of it."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from analysis.closeloop.errors import SessionError
from analysis.closeloop.misdeclared import (
    Joint,
    _wrong_columns,
    check_declared,
    doubtful_gravity,
)
from analysis.closeloop.remedies import scaled, with_motions_exchanged
from analysis.closeloop.session.device import Device
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.signs import check_signs
from tests.testbed.sessions.effects import Arm
from tests.testbed.sessions.moved import moved
from tests.testbed.sessions.rich import rich_recording
from tests.testbed.sessions.rubbing import COULOMB, rubbing_robot, with_efforts
from tests.testbed.sessions.synthetic import mjcf


@pytest.fixture(scope="module")
def robot() -> Recording:
    return rubbing_robot()


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


def test_every_effort_that_is_turned_round_is_named_at_once(robot: Recording) -> None:
    error = refused(replace(robot, effort=-robot.effort, cache={}))
    assert error.column == "shoulder.effort"
    assert "what shoulder needs (so have those of elbow; turn all of them)" in str(error)


def test_declared_damping_that_nobody_measured_hides_no_turned_effort(robot: Recording) -> None:
    """Of a stranger's KUKA, whose file has 10 Nm s/rad at every joint, of whatever size."""
    spec = mujoco.MjSpec.from_string(mjcf(Arm()))
    for name in ("shoulder", "elbow"):
        spec.joint(name).damping[0] = 20.0
    guessed = replace(robot, device=Device(spec, ()), cache={})
    check_signs(guessed)
    check_declared(guessed)
    turned = replace(guessed, effort=-robot.effort, cache={})
    assert "(so have those of elbow; turn all of them)" in str(refused(turned))
    with pytest.raises(SessionError, match="so have those of elbow; turn all of them"):
        check_signs(turned)


def felt(name: str, effort: np.ndarray, declared: np.ndarray, velocity: np.ndarray) -> Joint:
    one, none = np.ones(len(effort)), np.zeros((len(effort), 3))
    return Joint(
        number=ord(name),
        name=name,
        effort=effort,
        declared=declared,
        static=none[:, 0],
        weight=none,
        position=np.linspace(-1.0, 1.0, len(effort)),
        unknown=np.column_stack([velocity, one, -one]),
    )


def test_beside_most_that_are_turned_round_a_joint_that_hardly_tells_is_named_too() -> None:
    """Efforts have one convention: friction of a light joint alone would not be enough."""
    links, velocity, noise = np.random.default_rng(2).standard_normal((3, 5, 1000))
    heavy = [felt(n, -links[i], links[i], velocity[i]) for i, n in enumerate("abc")]
    light = felt("d", -velocity[3] + 1.2 * noise[3], 0.0 * links[3], velocity[3])
    (column, why), *others = _wrong_columns([*heavy, light])[0]
    assert column == "a.effort" and "(so have those of b, c, d; turn all of them)" in why
    assert not others and _wrong_columns([light])[0] == []
    right = [felt(n, links[i], links[i], velocity[i]) for i, n in enumerate("abc")]
    assert _wrong_columns([*right, light])[0] == []


def test_where_all_are_turned_round_no_two_are_said_to_be_exchanged() -> None:
    """A stranger's first and fifth joints, of nearly one torque, would have passed for that."""
    links, velocity = np.random.default_rng(3).standard_normal((2, 4, 1000))
    common, own = links[:2]
    joints = [felt(n, -links[i], links[i], velocity[i]) for i, n in enumerate("abcd")]
    joints[0] = felt("a", -common + 0.9 * own, common, velocity[0])
    joints[1] = felt("b", common - 0.3 * own, own - common, velocity[1])
    (column, why), (_, other) = _wrong_columns(joints)[0]
    assert column == "a.effort" and "(so have those of b, c, d; turn all of them)" in why
    assert "looks exchanged with that of b" in other


def test_two_efforts_that_are_exchanged_are_refused(robot: Recording) -> None:
    error = refused(replace(robot, effort=robot.effort[:, ::-1], cache={}))
    assert error.column == "shoulder.effort" and "exchanged with that of elbow" in str(error)


def test_two_positions_that_are_exchanged_are_refused(robot: Recording) -> None:
    # Of parallel joints the farther one feels the sum of both: its effort tells nothing.
    error = refused(with_motions_exchanged(robot, (0, 1)))
    assert error.column == "shoulder.position" and "exchanged with that of elbow" in str(error)
    assert "exchange their columns of position" in str(error)


@pytest.mark.parametrize(
    ("both", "what"), [(False, "position and of velocity"), (True, "position, of velocity and of")]
)
def test_a_joint_that_is_counted_the_other_way_round_is_refused(
    robot: Recording, both: bool, what: str
) -> None:
    """It had offsets and a delay at four joints of a stranger's arm."""
    sign = np.array([1.0, -1.0])
    turned = scaled(robot, sign)
    if both:
        turned = replace(turned, effort=robot.effort * sign, cache={})
    error = refused(turned)
    assert error.column == "elbow.position" and "is counted the other way round" in str(error)
    assert f"turn the sign of elbow's {what}" in str(error)


def test_efforts_that_are_exchanged_are_not_told_to_be_turned_round() -> None:
    # Of an opponent's arm with axes the other way round: one torque is much of the other's reverse.
    one, other = np.random.default_rng(1).standard_normal((2, 1000))
    needed = np.column_stack([one, other - one])
    none = np.zeros((1000, 3))
    joints = [
        Joint(
            number=number,
            name=f"j{number}",
            effort=needed[:, 1 - number],
            declared=needed[:, number],
            static=needed[:, number],
            weight=none,
            position=np.linspace(-1.0, 1.0, 1000),
            unknown=np.column_stack([none, np.ones(1000), -np.ones(1000)]),
        )
        for number in (0, 1)
    ]
    assert joints[0].left(-joints[0].effort) < 0.6
    (column, why), *_ = _wrong_columns(joints)[0]
    assert column == "j0.effort" and "looks exchanged with that of j1" in why


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


def test_an_effort_of_one_joint_without_its_weight_is_pointed_at(robot: Recording) -> None:
    """The other joint holds its links: another gravity for all would explain no more."""
    effort = np.array(robot.effort)
    effort[:, 0] -= 0.97 * robot.filtered(robot.weight(0) @ robot.gravity[:, None])[:, 0]
    (said,) = doubtful_gravity(replace(robot, effort=effort, cache={}))
    assert said.startswith(f"the effort of {robot.name(0)} shows 6% of the weight")
    assert "gravity compensation" in said


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
