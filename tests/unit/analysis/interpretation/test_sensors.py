"""Readings that no sensor gives, or that no bank has."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from analysis.interpretation.bank.population import population_of
from analysis.interpretation.sensors import despiked, impossible, misread, posture, steps
from sim.assessment.summary import Motion
from sim.robot.device import NESM, load_device
from tests.testbed.bank import CONTENT, population

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
    for contact in (False, True):
        assert posture(movement(), DEVICE, contact=contact) is None
    assert steps(movement()).max() < 0.02


@pytest.mark.parametrize("contact", [False, True])
@pytest.mark.parametrize("joint", [0, 2])
@pytest.mark.parametrize("by", [-0.1, -0.035, 0.035, 0.1])
def test_a_joint_that_is_held_elsewhere_is_named(contact: bool, joint: int, by: float) -> None:
    said = posture(shifted(joint, by), DEVICE, contact=contact)
    assert said is not None
    assert f"J{joint + 1} is {by:+.3f} rad from" in said or "rad farther than J3" in said


def test_weight_that_moves_j1_and_j3_alike_or_j3_alone_where_j1_has_a_stop_is_familiar() -> None:
    both = shifted(0, -0.03)
    both = replace(both, theta=both.theta - 0.03 * np.eye(4)[2])
    assert posture(both, DEVICE, contact=False) is None
    assert "J1 is -0.030 rad from" in (posture(both, DEVICE, contact=True) or "")
    alone = shifted(2, -0.022)
    assert posture(alone, DEVICE, contact=True) is None
    said = posture(alone, DEVICE, contact=False)
    assert said is not None and "J1 is +0.022 rad farther than J3" in said


def test_j2_is_moved_by_its_wearers_weight_one_way() -> None:
    for contact in (False, True):
        assert posture(shifted(1, 0.03), DEVICE, contact=contact) is None
        for by in (-0.03, 0.06):
            said = posture(shifted(1, by), DEVICE, contact=contact)
            assert said is not None and said.startswith(f"J2 is {by:+.3f} rad")


def test_the_moved_joint_may_be_anywhere() -> None:
    assert posture(shifted(3, 0.3), DEVICE, contact=True) is None


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


def test_angles_in_degrees_are_named() -> None:
    said = impossible(replace(movement(), theta=np.degrees(movement().theta)))
    assert said is not None and said.endswith("angles are in radians, and these look like degrees")


def test_a_motor_at_its_limit_while_the_joint_moves_is_named() -> None:
    motion = movement()
    bell = 6.0 * np.exp(-((motion.time - 2.6) ** 2))
    torque = motion.torque.copy()
    torque[:, 3] = bell + 0.1 * np.random.default_rng(3).standard_normal(len(bell))
    assert impossible(replace(motion, torque=torque)) is None
    torque[:, 3] = np.minimum(torque[:, 3], 4.0)
    said = impossible(replace(motion, torque=torque))
    assert said is not None and "is saturated: it stays at 4 Nm while the joint moves" in said


@pytest.mark.parametrize("spoilt", [0.0, 1e-7])
def test_steps_of_a_torque_are_found_also_among_odd_samples(spoilt: float) -> None:
    """Whether written with single precision, or with a sample between two steps."""
    motion = movement()
    torque = motion.torque.copy()
    torque[:, 0] = np.round(torque[:, 0] / 0.3) * 0.3
    torque[:, 0] += spoilt * np.random.default_rng(2).standard_normal(400)
    torque[200, 0] += 0.013
    torque[:, 2] = -4.2
    found = steps(replace(motion, torque=torque))
    assert found[0] == pytest.approx(0.3, abs=1e-3)
    assert found[[1, 3]].max() < 0.02
    # It varies by less than a step.
    assert found[2] == found[0]


@pytest.mark.parametrize(
    ("channel", "size", "word"),
    [
        ("torque", 30.0, "torque of J4"),
        ("velocity", -2.0, "velocity of J4"),
        ("theta", 0.5, "angle of J4"),
    ],
)
@pytest.mark.parametrize("at", [0, 211, 399])
def test_a_single_sample_far_from_its_neighbours_is_replaced_and_counted(
    channel: str, size: float, word: str, at: int
) -> None:
    motion = movement()
    motion = replace(motion, torque=2.0 * motion.theta)
    assert despiked(motion)[1] == {}
    spoilt = getattr(motion, channel).copy()
    spoilt[at, 3] += size
    clean, counted = despiked(replace(motion, **{channel: spoilt}))
    assert counted == {word: 1}
    assert getattr(clean, channel) == pytest.approx(getattr(motion, channel), abs=0.03)


def test_noise_is_no_spike() -> None:
    # Of 3 Nm, white.
    assert despiked(movement())[1] == {}


def held(by: float = 0.0, integral: float = 1.0, noise: float = 0.0) -> Motion:
    """Return a movement whose J3 sinks under a weight, and J3's angle read with an offset."""
    motion = movement()
    gains, time = DEVICE.gains, motion.time
    off = -0.03 * time / 3.0 * np.exp(1.0 - time / 3.0)
    torque = 0.0 * motion.theta
    velocity = np.gradient(off, time)
    total = np.concatenate([[0.0], np.cumsum(0.5 * (off[1:] + off[:-1]) * np.diff(time))])
    torque[:, 2] = 4.0 - gains.kp * off - gains.kv * velocity - integral * gains.ki * total
    torque += noise * np.random.default_rng(3).standard_normal(torque.shape)
    theta, speed = motion.theta.copy(), motion.velocity.copy()
    theta[:, 2] += off + by
    speed[:, 2] += velocity
    return replace(motion, theta=theta, velocity=speed, torque=torque)


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_an_angle_that_its_motor_does_not_hold_is_read_wrong(noise: float) -> None:
    assert misread(held(noise=noise), DEVICE, population()) is None
    for by in (-0.0175, 0.0175):
        said = misread(held(by, noise=noise), DEVICE, population())
        assert said is not None and said.startswith("J3 is recorded")
        # Where the weight has moved it to, nothing else shows this.
        assert posture(held(by), DEVICE, contact=True) is None or by < 0.0
    said = misread(held(0.018), DEVICE, population())
    assert said is not None and "J3 is recorded +0.018 rad from" in said


def test_a_population_may_have_other_gains() -> None:
    content = {**CONTENT, "fixed": {"integral_gain": 2.0}}
    twice = population_of(content, "made up")
    assert misread(held(integral=2.0), DEVICE, twice) is None
    assert misread(held(), DEVICE, twice) is not None
    none = population_of({**CONTENT, "fixed": {"integral_gain": 0.0}}, "made up")
    assert misread(held(0.05), DEVICE, none) is None
    drawn = {
        "distribution": {"kind": "uniform", "low": 0.5, "high": 2.0},
        "source": "made up",
    }
    factors = {**CONTENT["factors"], "integral_gain": drawn}
    assert misread(held(0.05), DEVICE, population_of({**CONTENT, "factors": factors}, "")) is None
