"""The declared model of equation 20."""

import mujoco
import numpy as np
import pytest

from sim.nominal import nominal_model


def energies(angles: np.ndarray) -> np.ndarray:
    """Potential energy (J) of the declared bodies over elbow angles (rad)."""
    model = nominal_model().model
    data = mujoco.MjData(model)
    energy = []
    for angle in angles:
        data.qpos[:] = [0.0, -np.pi / 2, 0.0, angle]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_energyPos(model, data)
        energy.append(data.energy[0])
    return np.array(energy)


def test_holding_still_takes_the_slope_of_potential_energy() -> None:
    angles = np.radians([20.0, 60.0, 100.0])
    position = np.column_stack([np.zeros(3), np.full(3, -np.pi / 2), np.zeros(3), angles])
    still = np.zeros((3, 4))
    torque = nominal_model().inverse_dynamics(position, still, still)
    h = 1e-5
    slope = (energies(angles + h) - energies(angles - h)) / (2 * h)
    assert torque == pytest.approx(slope, rel=1e-6)


def test_moving_takes_the_declared_damper_and_motor_inertia_too() -> None:
    position = np.array([[0.0, -np.pi / 2, 0.0, 1.0]])
    velocity, acceleration = np.array([[0, 0, 0, 2.0]]), np.array([[0, 0, 0, 3.0]])
    nominal = nominal_model()
    still = np.zeros((1, 4))
    at_rest = nominal.inverse_dynamics(position, still, still)
    damper = nominal.inverse_dynamics(position, velocity, still) - at_rest
    inertia = nominal.inverse_dynamics(position, still, acceleration) - at_rest
    assert damper == pytest.approx(2.0)
    assert inertia[0] / 3.0 > 0.15 + 1.3 * 0.1**2


def test_a_joint_beyond_its_stop_adds_no_limit_force() -> None:
    inside, beyond = (np.array([[0.0, -np.pi / 2, 0.0, angle]]) for angle in (-0.34, -0.36))
    still = np.zeros((1, 4))
    nominal = nominal_model()
    difference = nominal.inverse_dynamics(beyond, still, still) - nominal.inverse_dynamics(
        inside, still, still
    )
    assert abs(difference[0]) < 0.2


def test_bias_is_the_inverse_of_a_motion_without_acceleration_or_damping() -> None:
    position = np.array([[0.0, -np.pi / 2, 0.0, 0.7]])
    velocity, still = np.array([[0.0, 0.0, 0.0, 1.5]]), np.zeros((1, 4))
    nominal = nominal_model()
    full = nominal.inverse_dynamics(position, velocity, still)
    assert full - 1.5 == pytest.approx(nominal.bias(position, velocity))


def test_the_published_nominal_arm_lacks_tissue_and_straps() -> None:
    declared, bare = nominal_model().model, nominal_model(attachments=False).model
    missing = declared.body_subtreemass[0] - bare.body_subtreemass[0]
    assert missing == pytest.approx(0.489 + 0.351 + 2 * 0.05)
