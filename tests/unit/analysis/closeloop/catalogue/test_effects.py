"""What every effect passes: it is found again in rich data, and MuJoCo's element is its torque."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from analysis.closeloop.identification.candidates import _try, refined
from analysis.closeloop.identification.model import Candidate, Channel, Model, evaluate, no_estimate
from analysis.closeloop.identification.regression import select_rows
from analysis.closeloop.session.recording import Recording
from sim.effects.applied import AppliedEffects
from sim.effects.catalogue import BY_NAME, EFFECTS
from sim.effects.effect import AppliedEffect, Theta
from sim.effects.motion import Estimate
from tests.testbed.effects import Arm
from tests.testbed.sessions import mjcf

ELBOW = 1
APPLIED = [
    effect.name
    for effect in EFFECTS
    if isinstance(effect, AppliedEffect) and effect.element == "applied torque"
]
#: For every effect, a place in its grid and its coefficients.
TRUTH: dict[str, tuple[dict[str, float], tuple[float, ...]]] = {
    "coulomb_friction": ({"smooth": 0.02}, (0.8,)),
    "viscous_friction": ({}, (0.5,)),
    "stribeck_friction": ({"smooth": 0.004, "speed": 0.24}, (0.6, 0.9)),
    "asymmetric_friction": ({"smooth": 0.004, "viscous": 1.0}, (0.9, 0.3, 0.1)),
    "load_dependent_friction": ({"smooth": 0.004, "load": 0}, (0.3, 0.2)),
    "position_dependent_friction": ({"smooth": 0.004}, (0.9, 0.3, 0.2)),
    "torque_offset": ({}, (0.7,)),
    "torque_gain": ({}, (-0.1,)),
    "payload": ({"distance": 1.6}, (0.4,)),
    "added_inertia": ({}, (0.05,)),
    "position_offset": ({"offset": 0.1}, (0.1,)),
    "joint_stiffness": ({}, (3.0, -2.0)),
    "nonlinear_stiffness": ({"centre": 1.0}, (5.0,)),
    "end_range_torque": ({"side": 1.0, "onset": 1.15, "power": 2.0}, (9.0,)),
    "torque_ripple": ({"order": 23.6}, (0.4, 0.3)),
    "time_delay": ({"delay": 0.02}, ()),
    "actuator_lag": ({"time_constant": 0.03}, ()),
    "series_elasticity": ({}, (0.02,)),
    "backlash": ({"width": 0.06, "late": 0.0}, (0.05,)),
    "hysteresis": ({"distance": 0.25}, (1.2,)),
    "stretch_reflex": ({"side": 1.0, "delay": 0.06, "speed": 0.15, "angle": -2.0}, (1.5,)),
    "thixotropy": ({"distance": 1.0}, (1.5,)),
    "drift": ({"level_off": 0.6}, (0.3,)),
    "cross_joint_coupling": ({}, (2.0, 0.4)),
}
#: In the loop of a simulation the load holds Coriolis torques too, and a joint at rest has no
#: share of its fastest motion to be smoothed over.
TOLERANCE = {"load_dependent_friction": 0.1, "hysteresis": 0.1}


def torque(recording: Recording, name: str, estimate: Estimate) -> np.ndarray:
    """Return what the motor has to add for the effect's truth, (n, joints)."""
    theta, coefficients = TRUTH[name]
    out = np.zeros_like(recording.position)
    for joint, columns in BY_NAME[name].columns(recording, ELBOW, theta, estimate).items():
        out[:, joint] = columns @ coefficients
    return out


def values(recording: Recording, name: str) -> dict[str, float]:
    """Return the physical parameters of the effect's truth."""
    theta, coefficients = TRUTH[name]
    readings = BY_NAME[name].readings(recording, ELBOW, theta)
    return {key: float(r.of(dict(enumerate(coefficients)))) for key, r in readings.items()}


def test_there_is_a_truth_for_every_effect() -> None:
    assert set(TRUTH) == {effect.name for effect in EFFECTS}


@pytest.mark.parametrize("name", [effect.name for effect in EFFECTS])
def test_an_effect_is_found_again_in_rich_data(name: str, recording: Recording) -> None:
    effect, (theta, coefficients) = BY_NAME[name], TRUTH[name]
    candidate = Candidate(effect=effect, joint=ELBOW)
    estimate = no_estimate(recording)
    if effect.channel:
        channel = Channel(candidate=candidate, theta=theta)
        known = Model(recording, channels=(channel,)).known()
        effort = np.column_stack([known[joint][:, 0] for joint in (0, 1)])
    else:
        effort = recording.inverse + torque(recording, name, estimate)
    noise = 0.01 * np.random.default_rng(1).standard_normal(effort.shape)
    measured = replace(recording, effort=recording.filtered(effort + noise), cache={})
    rows = select_rows(measured, (0,))
    model = Model(measured)
    option = _try(model, rows, candidate, no_estimate(measured), evaluate(model, rows))
    assert option is not None and option.gain > 0.9 * evaluate(model, rows).loss
    better, scored = refined(option, rows)
    last: Theta = better.channels[-1].theta if effect.channel else better.terms[-1].theta
    if not effect.uses_estimate:
        for key, value in theta.items():
            # Some widths and levels are choices of the grid that hardly change the torque.
            if key in ("delay", "time_constant", "distance", "centre", "onset"):
                assert last[key] == pytest.approx(value, rel=0.15)
    expected = effort - recording.inverse
    left = better.target(rows) - better.base(rows)[0] @ scored.coefficients
    assert np.sqrt(np.mean(left**2)) < 0.1 * np.sqrt(np.mean(expected**2)) + 0.01
    if coefficients and name in ("viscous_friction", "added_inertia", "torque_offset", "drift"):
        assert scored.coefficients == pytest.approx(coefficients, rel=0.05)


@pytest.mark.parametrize("name", APPLIED)
def test_an_applied_torque_is_the_catalogues_torque(name: str, recording: Recording) -> None:
    spec = mujoco.MjSpec.from_string(mjcf(Arm()))
    spec.option.timestep = 1.0 / recording.rate
    assert BY_NAME[name].add(spec, "elbow", values(recording, name)) is not None
    model = mujoco.MjModel.from_xml_string(spec.to_xml())
    effects, data = AppliedEffects(model), mujoco.MjData(model)
    felt = np.empty(len(recording.time))
    for i, (q, v) in enumerate(zip(recording.position, recording.velocity, strict=True)):
        data.qpos[:], data.qvel[:], data.time = q, v, recording.time[i]
        mujoco.mj_forward(model, data)
        effects.apply(data)
        felt[i] = data.ctrl[0]
    needed = torque(recording, name, no_estimate(recording))[:, ELBOW]
    # The joint feels the opposite of what the motor must add; both are smoothed at a reversal.
    moving = np.abs(recording.velocity[:, ELBOW]) > 0.1 * recording.top_speed[ELBOW]
    # What was before the recording reaches into it by a reflex's delay.
    moving &= recording.time > 0.1
    rms = float(np.sqrt(np.mean(needed**2)))
    assert np.abs(felt + needed)[moving].max() < TOLERANCE.get(name, 0.05) * rms


@pytest.mark.parametrize(
    "name",
    ["viscous_friction", "joint_stiffness", "added_inertia", "payload", "position_offset"],
)
def test_a_native_element_is_the_catalogues_torque(name: str, recording: Recording) -> None:
    needed = torque(recording, name, no_estimate(recording))
    torques = []
    for change in (False, True):
        spec = mujoco.MjSpec.from_string(mjcf(Arm()))
        if change:
            assert BY_NAME[name].add(spec, "elbow", values(recording, name)) is not None
        model = mujoco.MjModel.from_xml_string(spec.to_xml())
        data, out = mujoco.MjData(model), np.empty((50, 2))
        for row, i in enumerate(range(0, 1000, 20)):
            data.qpos[:] = recording.position[i]
            if name != "position_offset":  # known for its gravity only
                data.qvel[:], data.qacc[:] = recording.velocity[i], recording.acceleration[i]
            mujoco.mj_inverse(model, data)
            out[row] = data.qfrc_inverse
        torques.append(out)
    assert torques[1] - torques[0] == pytest.approx(needed[::20], abs=2e-3)
