"""Bones follow the wearer."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sim.body.skeleton import (
    AUTHORS_ELBOW_OFFSET,
    HAND_BOXES,
    HUMAN_JOINTS,
    HUMERUS_SHRINK,
    PRONATION,
    add_arm,
    add_extension_stop,
    empty_spec,
    extension_stop_torque,
)
from sim.parameters.wearer import NOMINAL_WEARER, Wearer
from sim.robot.device import NESM


def arm_of(wearer: Wearer) -> mujoco.MjModel:
    spec = empty_spec()
    add_arm(spec, wearer)
    return spec.compile()


def test_the_arm_has_five_degrees_of_freedom() -> None:
    model = arm_of(NOMINAL_WEARER)
    names = {model.joint(i).name for i in range(model.njnt)}
    assert names == {*HUMAN_JOINTS, PRONATION}
    assert model.nv == 5


def test_the_nominal_elbow_lies_on_the_exoskeletons_axis() -> None:
    """Within a tenth of a millimetre across it; along it both may slide."""
    robot, arm = NESM.spec().compile(), arm_of(NOMINAL_WEARER)
    link, elbow = mujoco.MjData(robot), arm.body("ulna").pos
    # The robot's own pose, its elbow straight: the upper arm forward, as the arm's.
    link.qpos = NESM.start("elbow").angles
    link.joint("J4").qpos = 0.0
    mujoco.mj_kinematics(robot, link)
    away = elbow - link.joint("J4").xanchor
    assert np.abs(away[[0, 2]]).max() < 1e-4
    assert np.abs(link.joint("J4").xaxis) == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)


def test_a_wearer_may_be_off_the_robots_axis_as_the_authors_are() -> None:
    """Their elbow is 4.2 mm below it, on a humerus 0.8 mm longer."""
    scale = 0.86267 / HUMERUS_SHRINK
    theirs = replace(
        NOMINAL_WEARER,
        elbow_offset=AUTHORS_ELBOW_OFFSET,
        nominal_upper_arm_length=NOMINAL_WEARER.nominal_upper_arm_length / scale,
    )
    expected = 0.86267 * np.array([0.2907, -0.0058, -0.0049])
    assert arm_of(theirs).body("ulna").pos == pytest.approx(expected, abs=1e-9)


def test_lengths_move_the_joints() -> None:
    longer = replace(NOMINAL_WEARER, upper_arm_length=0.3337 * 1.1, forearm_length=0.319 * 0.9)
    nominal, scaled = arm_of(NOMINAL_WEARER), arm_of(longer)
    assert scaled.body("ulna").pos == pytest.approx(1.1 * nominal.body("ulna").pos)
    assert scaled.body("hand").pos == pytest.approx(0.9 * nominal.body("hand").pos)


def test_masses_change_inertia() -> None:
    model = arm_of(replace(NOMINAL_WEARER, upper_arm_mass=3.0, forearm_mass=1.5))
    assert model.body("humerus").mass[0] == 3.0
    forearm = model.body("ulna").mass[0] + model.body("radius").mass[0]
    assert forearm == pytest.approx(1.5)
    assert model.body("hand").mass[0] == pytest.approx(sum(mass for _, mass, _, _ in HAND_BOXES))
    ratio = model.body("humerus").inertia / arm_of(NOMINAL_WEARER).body("humerus").inertia
    assert ratio == pytest.approx([3.0 / 1.761] * 3)


def test_an_extension_stop_hardens_beyond_its_angle_and_does_nothing_before() -> None:
    spec = empty_spec()
    add_arm(spec, NOMINAL_WEARER)
    add_extension_stop(spec, 30.0)
    model = spec.compile()
    data = mujoco.MjData(model)
    elbow = model.joint(HUMAN_JOINTS[3])
    for angle, torque in (
        (90.0, 0.0),
        (5.0, 0.0),
        (0.0, 2.0 * 30.0 * np.radians(5.0)),
        (-5.0, 5.0 * 30.0 * np.radians(10.0)),
    ):
        data.qpos[elbow.qposadr[0]] = np.radians(angle)
        mujoco.mj_forward(model, data)
        assert data.qfrc_passive[elbow.dofadr[0]] == pytest.approx(torque, abs=1e-9)
        assert extension_stop_torque(np.radians(angle), 30.0) == pytest.approx(torque, abs=1e-9)
