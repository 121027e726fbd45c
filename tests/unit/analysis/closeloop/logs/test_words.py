"""Which words of a channel's name say what it is, where there are several."""

import numpy as np
import pytest

from analysis.closeloop.logs.arrays import log_of
from analysis.closeloop.logs.belief import Belief
from analysis.closeloop.logs.inspection import believe

TIME = np.arange(0.0, 8.0, 0.005)
POSITION = np.sin(TIME) + 0.3 * np.sin(2.3 * TIME)
VELOCITY = np.cos(TIME) + 0.69 * np.cos(2.3 * TIME)
TORQUE = np.sign(VELOCITY) + 3.0 * POSITION


def believed(**arrays: np.ndarray) -> dict[str, Belief]:
    """Return what is believed of each channel of a log with a clock."""
    log = log_of("CSV", {"time": TIME, **arrays}.items())
    return {belief.channel.name: belief for belief in believe(log)}


@pytest.mark.parametrize(
    ("name", "quantity"),
    [
        ("tau_q1", "effort"),
        ("q1_torque", "effort"),
        ("q1_measured_effort", "effort"),
        ("q1_current", "current"),
        ("q1_vel", "velocity"),
        ("q1_dot", "velocity"),
        ("theta_1_dot", "velocity"),
        ("q1_ddot", "acceleration"),
        ("vel_1_dot", "acceleration"),
        ("arm.state.q1.effort", "effort"),
        ("curr_q1", "position"),
        ("velocity_controller.q1", "position"),
    ],
)
def test_a_word_for_a_torque_or_a_rate_stands_before_a_joints_own_q(
    name: str, quantity: str
) -> None:
    """A stranger's `q1_torque` was the position of a second joint."""
    values = np.random.default_rng(0).normal(size=len(TIME))
    assert believed(**{name: values})[name].quantity == quantity


def test_such_names_are_of_the_joint_that_their_position_names() -> None:
    found = believed(q1_measured=POSITION, q1_dot=VELOCITY, q1_torque=TORQUE)
    assert [(b.quantity, b.joint) for b in found.values()] == [
        *(("time", None), ("position", 0), ("velocity", 0), ("effort", 0))
    ]


def test_a_wanted_torque_is_wanted() -> None:
    found = believed(q1=POSITION, q1_torque_cmd=TORQUE)["q1_torque_cmd"]
    assert (found.quantity, found.wanted, found.joint) == ("effort", True, 0)


def test_a_compensated_effort_is_said_to_be_perhaps_a_part_of_it() -> None:
    found = believed(q7=POSITION, dq7=VELOCITY, q7_tau_J_compensate=TORQUE)["q7_tau_J_compensate"]
    assert (found.quantity, found.joint) == ("effort", 0)
    assert "may be a part of the effort" in found.why


def test_beside_a_whole_effort_of_its_joint_a_compensated_one_is_none() -> None:
    found = believed(q7=POSITION, tau_q7=TORQUE, q7_tau_J_compensate=TORQUE**3)
    assert [b.quantity for b in found.values()] == ["time", "position", "effort", "unknown"]
