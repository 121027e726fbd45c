"""The declared model of equation 20."""

import mujoco
import numpy as np
import pytest

from sim.assessment.nominal import nominal_model
from sim.body.skeleton import add_arm, empty_spec
from sim.body.soft_tissue import add_soft_tissue, soft_tissues
from sim.parameters.wearer import NOMINAL_WEARER


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


def test_the_declared_limbs_weigh_and_balance_as_the_simulated_nominal_ones() -> None:
    """Two models built by different code; the simulated limbs carry their tissue as 97 bodies."""
    spec = empty_spec()
    add_arm(spec, NOMINAL_WEARER)
    for tissue in soft_tissues(NOMINAL_WEARER):
        add_soft_tissue(spec, tissue)
    simulated, declared = spec.compile(), nominal_model().model
    arm, forearm = moment_of(simulated, "humerus"), moment_of(simulated, "ulna")
    # In the nominal model the forearm hangs on the robot's link, not on the humerus.
    elbow = simulated.body("ulna").pos
    upper_mass = arm[0] - forearm[0]
    upper_moment = arm[1] - (forearm[1] + forearm[0] * elbow)
    for expected, bone in (((upper_mass, upper_moment), "humerus"), (forearm, "ulna")):
        mass, moment = moment_of(declared, bone)
        assert mass == pytest.approx(expected[0])
        assert moment == pytest.approx(expected[1], abs=1e-6)


def moment_of(model: mujoco.MjModel, bone: str) -> tuple[float, np.ndarray]:
    """Return mass (kg) of a bone and what hangs on it, and mass x centre in its frame (kg m)."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    body = data.body(bone)
    mass = float(model.body_subtreemass[model.body(bone).id])
    return mass, mass * (body.xmat.reshape(3, 3).T @ (body.subtree_com - body.xpos))
