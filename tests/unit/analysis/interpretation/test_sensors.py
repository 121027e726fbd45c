"""Readings that no sensor gives, or that no bank has."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from analysis.interpretation.sensors import coarse, impossible, posture
from sim.assessment.summary import Motion
from sim.robot.device import NESM, load_device

DEVICE = load_device(NESM.name)
#: Where an assessment of the elbow holds J1 to J3.
START = np.array(DEVICE.start("elbow").angles)


def movement() -> Motion:
    time = np.linspace(0.0, 6.0, 400)
    theta = np.tile(START, (400, 1))
    theta[:, 3] = 1.9 - 1.7 / (1.0 + np.exp(-2.0 * (time - 2.6)))
    torque = np.random.default_rng(1).normal(0.0, 3.0, (400, 4))
    velocity = np.gradient(theta, time, axis=0)
    return Motion(time=time, theta=theta, velocity=velocity, torque=torque, joint=3)


def shifted(joint: int, by: float) -> Motion:
    motion = movement()
    return replace(motion, theta=motion.theta + by * np.eye(4)[joint])


def test_a_movement_as_of_an_assessment_is_possible_and_held_in_its_place() -> None:
    assert impossible(movement()) is None
    assert posture(movement(), DEVICE) is None
    assert coarse(movement(), DEVICE, 0.1) is None


@pytest.mark.parametrize(("joint", "down"), [(0, -0.03), (1, 0.03), (2, -0.03)])
def test_a_joint_that_is_held_elsewhere_is_named(joint: int, down: float) -> None:
    # Its wearer's weight moves it one way.
    assert posture(shifted(joint, down), DEVICE) is None
    for by in (-down, 2.0 * down, -0.1, 0.1):
        said = posture(shifted(joint, by), DEVICE)
        assert said is not None and said.startswith(f"J{joint + 1} is {by:+.3f} rad")


def test_the_moved_joint_may_be_anywhere() -> None:
    assert posture(shifted(3, 0.3), DEVICE) is None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda torque: 0.0 * torque, "0 Nm in every sample: it was not recorded"),
        (lambda torque: 0.0 * torque + 2.5, "2.5 Nm in every sample"),
        (lambda torque: 1e200 * torque, r"torque has values above 1e\+06"),
    ],
)
def test_what_no_sensor_reads_is_one_sentence(
    change: Callable[[np.ndarray], np.ndarray], words: str
) -> None:
    motion = movement()
    said = impossible(replace(motion, torque=change(motion.torque)))
    assert said is not None
    with pytest.raises(ValueError, match=words):
        raise ValueError(said)


def test_steps_of_a_torque_may_be_as_large_as_zero_errors_are() -> None:
    motion = movement()

    def in_steps(of: float) -> Motion:
        torque = motion.torque.copy()
        torque[:, 3] = np.round(torque[:, 3] / of) * of
        return replace(motion, torque=torque)

    assert coarse(in_steps(0.3), DEVICE, 0.1) is None
    said = coarse(in_steps(0.5), DEVICE, 0.1)
    assert said is not None and "J4 is recorded in steps of 0.5 Nm" in said
