"""Straps that are pulled and closed on a loaded arm."""

import mujoco
import pytest

from sim.assessment.donning import close_straps, slacken_straps
from sim.interface.straps import segment_names
from sim.parameters.fidelity import CAMPAIGN
from sim.parameters.wearer import NOMINAL_WEARER
from sim.robot.device import NESM
from sim.system.build import build_system
from sim.system.start import reset_to_start


def test_sparse_and_dense_solvers_agree_on_a_loaded_arm() -> None:
    """MuJoCo 4.0.0 fails this: its sparse Newton factorises such trees wrongly."""
    system = build_system(NOMINAL_WEARER)
    data = reset_to_start(system)
    stiffness = system.model.tendon_stiffness[system.straps].copy()
    slacken_straps(system, data)
    data.ctrl[system.contraction_inputs] = 0.4
    mujoco.mj_step(system.model, data, 30)
    close_straps(system, data, stiffness)
    mujoco.mj_step(system.model, data, 30)
    accelerations = []
    for jacobian in (mujoco.mjtJacobian.mjJAC_SPARSE, mujoco.mjtJacobian.mjJAC_DENSE):
        system.model.opt.jacobian = jacobian
        system.model.opt.tolerance = 1e-12
        other = mujoco.MjData(system.model)
        other.qpos[:], other.qvel[:], other.act[:] = data.qpos, data.qvel, data.act
        other.eq_active[:], other.ctrl[:] = data.eq_active, data.ctrl
        mujoco.mj_forward(system.model, other)
        assert other.ncon > 20
        accelerations.append(other.qacc.copy())
    assert accelerations[0] == pytest.approx(accelerations[1], abs=1e-4)


def test_closed_straps_keep_the_tension_they_were_pulled_with() -> None:
    system = build_system(NOMINAL_WEARER)
    data = reset_to_start(system)
    stiffness = system.model.tendon_stiffness[system.straps].copy()
    slacken_straps(system, data)
    mujoco.mj_step(system.model, data, 30)
    close_straps(system, data, stiffness)
    rest = system.model.tendon_lengthspring[system.straps, 1]
    tension = stiffness * (data.ten_length[system.straps] - rest)
    assert len(tension) == sum(len(segment_names(cuff, CAMPAIGN)) for cuff in NESM.cuffs)
    assert tension == pytest.approx(30.0 / CAMPAIGN.strap_rows, abs=0.1)


def test_straps_pull_and_never_push() -> None:
    system = build_system(NOMINAL_WEARER)
    data = reset_to_start(system)
    slacken_straps(system, data)
    mujoco.mj_step(system.model, data, 5)
    close_straps(system, data, system.model.tendon_stiffness[system.straps].copy())
    # A metre too long.
    system.model.tendon_lengthspring[system.straps, 1] += 1.0
    mujoco.mj_forward(system.model, data)
    system.model.tendon_stiffness[system.straps] *= 100.0
    before = data.qfrc_spring.copy()
    mujoco.mj_forward(system.model, data)
    assert data.qfrc_spring == pytest.approx(before)
