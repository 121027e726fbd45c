"""Joints of a device that no motor turns: what the nominal model makes of them, and the motors."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from sim.assessment.assess import assess
from sim.assessment.nominal import nominal_model, nominal_spec
from sim.body.skeleton import empty_spec
from sim.robot.device import FOLDER, JOINTS, NESM, add_exoskeleton, load_device
from sim.system.solver import set_solver

DEVICE = load_device("nesm_passive")
TEXT = (FOLDER / "nesm_passive.xml").read_text()
ALONG = '<joint name="passive_along" class="slide" axis="0 1 0" range="-0.05 0.05"/>'


def variant(tmp_path: Path, old: str, new: str) -> str:
    """Return the path of the device's file with `old` replaced by `new`."""
    assert old in TEXT
    path = tmp_path / "variant.xml"
    path.write_text(TEXT.replace(old, new))
    return str(path)


def test_passive_joints_have_no_motor_and_nothing_records_them() -> None:
    assert DEVICE.joints == JOINTS
    assert DEVICE.passive == tuple(
        f"passive_{name}" for name in ("cuff", "along", "across", "frontal")
    )
    assert DEVICE.starts.keys() == NESM.starts.keys()
    assert DEVICE.start("elbow") == NESM.start("elbow")
    assert DEVICE.spec().compile().nu == len(JOINTS)
    found = assess({}, device="nesm_passive", fidelity="bushing")
    assert found.record is not None
    assert found.record.theta.shape[1] == found.record.motor_torque.shape[1] == len(JOINTS)


def test_it_weighs_what_the_nesm_does() -> None:
    own, nesm = (device.spec().compile().body_mass.sum() for device in (DEVICE, NESM))
    assert own == pytest.approx(nesm, abs=0.011)


def needed(slides: float, motion: np.ndarray) -> np.ndarray:
    """Return what an aligned arm in the whole device needs of the motors, Nm, shape (n, joints).

    Args:
        slides: where its passive slides rest, m.
        motion: of the driven joints, shape (3, n, joints).
    """
    model = nominal_spec(replace(DEVICE, passive=())).compile()
    assert model.nv == len(JOINTS) + len(DEVICE.passive)
    driven = [int(model.joint(name).dofadr[0]) for name in JOINTS]
    rest = [int(model.joint(f"passive_{name}").dofadr[0]) for name in ("cuff", "along", "across")]
    data = mujoco.MjData(model)
    torques = []
    for position, velocity, acceleration in motion.transpose(1, 0, 2):
        data.qpos[driven], data.qpos[rest] = position, slides
        data.qvel[driven], data.qacc[driven] = velocity, acceleration
        mujoco.mj_inverse(model, data)
        torques.append(data.qfrc_inverse[driven])
    return np.array(torques)


def test_the_nominal_model_is_exact_where_passive_joints_rest_at_0() -> None:
    motion = np.random.default_rng(0).normal(size=(3, 6, len(JOINTS)))
    assert needed(0.0, motion) == pytest.approx(nominal_model(DEVICE).torques(*motion), rel=1e-6)


def test_what_the_elbow_needs_is_exact_wherever_slides_rest() -> None:
    """They move its axis with all that is beyond it."""
    motion = np.random.default_rng(0).normal(size=(3, 6, len(JOINTS)))
    motion[1:, :, :3] = 0.0
    exact = nominal_model(DEVICE).torques(*motion)
    displaced = needed(0.01, motion)
    assert displaced[:, 3] == pytest.approx(exact[:, 3], rel=1e-6)
    assert np.abs(displaced[:, 1] - exact[:, 1]).max() > 0.01


def test_motors_and_what_gives_way_give_together_what_the_free_robot_needs(tmp_path: Path) -> None:
    """The robot without an arm turns its elbow while springs hold its slides."""
    sprung = variant(
        tmp_path,
        '<joint type="slide" damping="20" armature="0" frictionloss="2"/>',
        '<joint type="slide" damping="20" armature="0" stiffness="3000"/>',
    )
    Path(sprung).write_text(
        Path(sprung).read_text().replace('armature="0" frictionloss="0.05"', 'stiffness="50"')
    )
    device = load_device(sprung)
    spec = empty_spec()
    set_solver(spec, 0.002)
    add_exoskeleton(spec, device.gains, device=device)
    # J1 begins at its stop.
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    model = spec.compile()
    data = mujoco.MjData(model)
    motors = [model.actuator(f"{name}_motor").id for name in JOINTS]
    driven = [int(model.joint(name).dofadr[0]) for name in JOINTS]
    passive = [int(model.joint(name).dofadr[0]) for name in device.passive]
    data.qpos[driven] = device.start("elbow").angles
    inputs = model.actuator_ctrladr[motors]
    data.ctrl[inputs] = data.qpos[driven]
    moved, mass = 0.0, np.empty((model.nv, model.nv))
    for step in range(400):
        data.ctrl[inputs[3]] = device.start("elbow").angles[3] - min(1.0, step / 300)
        mujoco.mj_forward(model, data)
        assert not data.nefc
        mujoco.mj_fullM(model, data, mass)
        force, position, before = data.qfrc_bias.copy(), data.qpos.copy(), data.qvel.copy()
        torque = data.actuator_force[motors].copy()
        mujoco.mj_step(model, data)
        acceleration = (data.qvel - before) / model.opt.timestep
        force += mass @ acceleration + model.dof_damping * data.qvel
        # What a robot's sensors report of a step (`sim.assessment.record`).
        reported = torque - device.gains.kv * model.opt.timestep * acceleration[driven]
        assert force[driven] == pytest.approx(reported, abs=1e-6)
        springs = -model.jnt_stiffness[passive] * position[passive]
        assert force[passive] == pytest.approx(springs, abs=1e-6)
        moved = max(moved, float(np.abs(position[passive]).max()))
    assert moved > 5e-4


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('<motor name="J3_motor" joint="J3"/>', "", "its actuators must be"),
        (
            "passive_along",
            "along",
            "and passive ones passive_..., not J1, J2, J3, passive_cuff, al",
        ),
        (ALONG, ALONG.replace(' range="-0.05 0.05"', ""), "must be a hinge with a range"),
        (ALONG, ALONG.replace("range", 'ref="0.01" range'), "must stand at 0"),
        ("0 0 0 0 0 1.9198", "0 0 0 0.01 0 1.9198", "must stand at 0, also in keyframes"),
    ],
)
def test_a_file_whose_passive_joints_cannot_be_is_told_so(
    tmp_path: Path, old: str, new: str, sentence: str
) -> None:
    with pytest.raises(ValueError, match=sentence):
        load_device(variant(tmp_path, old, new))
