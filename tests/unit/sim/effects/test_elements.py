"""An effect that was added to a MuJoCo model does there what its equation says."""

import mujoco
import numpy as np
import pytest

from sim.effects.applied import AppliedEffects
from sim.effects.catalogue import BY_NAME
from sim.effects.elements import add_spring
from tests.testbed.sessions.effects import Arm
from tests.testbed.sessions.synthetic import mjcf

PARAMETERS: dict[str, dict[str, float]] = {
    "stribeck_friction": {
        "torque": 1.0, "breakaway_excess": 2.0, "stribeck_velocity": 0.5, "stribeck_exponent": 2.0,
    },
    "asymmetric_friction": {"torque_positive": 2.0, "torque_negative": 1.0},
    "load_dependent_friction": {"torque": 0.5, "load_share": 0.1},
    "position_dependent_friction": {
        "torque_middle": 1.0, "torque_slope": 0.5, "torque_curvature": 0.1, "middle": 0.5,
    },
    "nonlinear_stiffness": {"cubic_stiffness": 3.0, "centre": 0.2},
    "end_range_torque": {"stiffness": 4.0, "onset": 0.5, "side": 1.0, "power": 2.0, "width": 0.2},
    "softening_stiffness": {"torque": 2.0, "centre": 0.2, "width": 0.5, "power": 0.0},
    "end_range_both": {"stiffness_positive": 4.0, "stiffness_negative": 3.0, "power": 2.0}
    | {"onset_positive": 0.5, "onset_negative": -0.5},
    "torque_ripple": {"cosine": 0.3, "sine": 0.4, "order": 7.0},
    "hysteresis": {"torque": 1.5, "distance": 0.1},
    "stretch_reflex": {"gain": 2.0, "delay": 0.0, "side": 1.0, "threshold_velocity": 0.2},
    "stretch_reflex_both": {"gain_positive": 2.0, "gain_negative": 1.5, "delay": 0.0}
    | {"threshold_velocity": 0.2},
    "thixotropy": {
        "torque": 0.7, "torque_moving": 0.3, "elastic_range": 1e-4, "exponent": 1.0,
        "recovery": 1.5, "distance": 0.5,
    },
    "thixotropic_stiffness": {
        "stiffness": 3.0, "torque_at_zero": -1.5, "recovery": 1.5, "distance": 0.5,
    },
    "stress_relaxation": {"stiffness": 3.0, "relaxation_time": 1.0},
    "drift": {"rate": 0.1, "time_constant": 100.0, "torque_at_start": 0.4},
    "coupled_motor": {
        "torque": 0.5, "damping": 0.2, "inertia": 0.0, "other_dof": 0.0, "sense": -1.0,
    },
    "cross_joint_coupling": {
        "stiffness": 2.0, "damping": 0.1, "torque_at_zero": -0.6, "other_dof": 0.0,
    },
}  # fmt: skip


def spec() -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(mjcf(Arm()))


def added(name: str, parameters: dict[str, float]) -> mujoco.MjModel:
    changed = spec()
    assert BY_NAME[name].add(changed, "elbow", parameters) is not None
    return mujoco.MjModel.from_xml_string(changed.to_xml())


def applied_torque(model: mujoco.MjModel, q: float, v: float) -> float:
    data = mujoco.MjData(model)
    data.qpos[1], data.qvel[1] = q, v
    mujoco.mj_forward(model, data)
    AppliedEffects(model).apply(data)
    mujoco.mj_forward(model, data)
    return float(data.qfrc_actuator[1])


def test_native_elements_are_where_mujoco_keeps_them() -> None:
    assert added("coulomb_friction", {"torque": 2.8}).dof_frictionloss[1] == 2.8
    assert added("viscous_friction", {"damping": 0.4}).dof_damping[1] == pytest.approx(0.4)
    assert added("added_inertia", {"inertia": 0.1}).dof_armature[1] == 0.1
    spring = added("joint_stiffness", {"stiffness": 4.0, "torque_at_zero": -2.0})
    assert spring.jnt_stiffness[1] == pytest.approx(4.0)
    assert spring.qpos_spring[1] == pytest.approx(0.5)


def test_two_springs_pull_as_their_sum() -> None:
    changed = spec()
    joint = changed.joint("elbow")
    add_spring(joint, 2.0, 0.3)
    add_spring(joint, 4.0, 0.9)
    model = changed.compile()
    data = mujoco.MjData(model)
    data.qpos[1] = 1.4
    mujoco.mj_forward(model, data)
    assert data.qfrc_passive[1] == pytest.approx(-2.0 * 1.1 - 4.0 * 0.5)


@pytest.mark.parametrize("aside", [0.0, 0.06])
@pytest.mark.parametrize("mass", [0.5, -0.5])
def test_a_payload_changes_what_holding_and_moving_take(mass: float, aside: float) -> None:
    torques = []
    parameters = {"mass": mass, "distance": 0.2, "aside": aside}
    for model in (spec().compile(), added("payload", parameters)):
        data = mujoco.MjData(model)
        data.qpos[:], data.qacc[:] = [0.3, 0.6], [0.0, 2.0]
        mujoco.mj_inverse(model, data)
        torques.append(float(data.qfrc_inverse[1]))
    weight = 9.81 * (0.2 * np.cos(0.9) - aside * np.sin(0.9))
    expected = mass * (weight + (0.2**2 + aside**2) * 2.0)
    assert torques[1] - torques[0] == pytest.approx(expected, rel=1e-5)


def test_more_mass_than_there_is_cannot_be_taken_away() -> None:
    with pytest.raises(ValueError, match="mass of"):
        BY_NAME["payload"].add(spec(), "elbow", {"mass": -5.0, "distance": 0.2})


def test_more_inertia_than_there_is_cannot_be_taken_away() -> None:
    with pytest.raises(ValueError, match="an inertia that no body has"):
        BY_NAME["payload"].add(spec(), "elbow", {"mass": -1.2, "distance": 0.3})


def test_a_torque_offset_needs_no_control() -> None:
    model = added("torque_offset", {"torque": 1.5})
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.qfrc_actuator[1] == pytest.approx(-1.5)


@pytest.mark.parametrize("name", ["actuator_lag", "time_delay"])
def test_a_late_actuator_is_late(name: str) -> None:
    model = added(name, {"time_constant": 0.05, "delay": 0.05})
    data = mujoco.MjData(model)
    data.ctrl[:] = 1.0
    mujoco.mj_step(model, data)
    assert abs(data.qfrc_actuator[1]) < 0.1
    for _ in range(400):
        mujoco.mj_step(model, data)
    assert data.qfrc_actuator[1] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(
    ("name", "q", "v", "torque"),
    [
        ("stribeck_friction", 0.0, 0.5, -(1.0 + 2.0 / np.e)),
        ("asymmetric_friction", 0.0, 1.0, -2.0),
        ("asymmetric_friction", 0.0, -1.0, 1.0),
        ("position_dependent_friction", 1.5, 1.0, -1.6),
        ("nonlinear_stiffness", 1.2, 0.0, -3.0),
        ("end_range_torque", 1.0, 0.0, -1.0),
        ("softening_stiffness", 0.7, 0.0, -2.0 * np.tanh(1.0)),
        ("end_range_both", 1.0, 0.0, -1.0),
        ("end_range_both", 0.4, 0.0, 0.0),
        ("end_range_both", -1.5, 0.0, 3.0),
        ("torque_ripple", 0.0, 0.0, -0.3),
        ("stretch_reflex", 0.0, 1.2, -2.0),
        ("stretch_reflex", 0.0, -1.2, 0.0),
        ("stretch_reflex_both", 0.0, 1.2, -2.0),
        ("stretch_reflex_both", 0.0, -1.2, 1.5),
        ("thixotropy", 0.0, 1.0, -1.0),
        ("thixotropic_stiffness", 1.2, 0.0, -2.1),
        ("stress_relaxation", 1.2, 0.0, 0.0),
        ("drift", 0.0, 0.0, -0.4),
        ("cross_joint_coupling", 0.0, 0.0, 0.6),
        ("coupled_motor", 0.0, 2.0, -(0.5 + 0.2 * 2.0)),
    ],
)
def test_an_applied_torque_is_its_equation(name: str, q: float, v: float, torque: float) -> None:
    found = applied_torque(added(name, PARAMETERS[name]), q, v)
    assert found == pytest.approx(torque, abs=5e-3)


def test_an_effect_of_another_version_is_refused_in_a_sentence() -> None:
    older = spec()
    BY_NAME["thixotropy"].add(older, "elbow", PARAMETERS["thixotropy"])
    text = older.texts[0]
    text.data = text.data.replace("elastic_range", "range")
    with pytest.raises(ValueError, match=r"thixotropy of elbow .* close the loop again"):
        AppliedEffects(mujoco.MjModel.from_xml_string(older.to_xml()))


@pytest.mark.parametrize("name", PARAMETERS)
def test_every_applied_effect_runs(name: str) -> None:
    model = added(name, PARAMETERS[name])
    data = mujoco.MjData(model)
    effects = AppliedEffects(model)
    data.qvel[1] = 0.5
    for _ in range(200):
        effects.apply(data)
        mujoco.mj_step(model, data)
    assert np.isfinite(data.qpos).all() and not any(w.number for w in data.warning)


def test_what_mujoco_cannot_hold_leaves_the_model_alone() -> None:
    changed = spec()
    before = changed.to_xml()
    assert BY_NAME["backlash"].add(changed, "elbow", {"gap": 0.01}) is None
    assert changed.to_xml() == before


@pytest.mark.parametrize(("v", "torque"), [(1.0, -2.7), (-1.0, 1.3)])
def test_asymmetric_friction_rubs_and_damps_each_direction_in_its_own_way(
    v: float, torque: float
) -> None:
    damped = {"viscous_difference": 0.4, "viscous_mean": 0.5}
    model = added("asymmetric_friction", PARAMETERS["asymmetric_friction"] | damped)
    assert applied_torque(model, 0.0, v) == pytest.approx(torque, abs=5e-3)


def test_a_load_hangs_in_the_model_though_no_joint_felt_one_of_its_ways() -> None:
    changed = spec()
    BY_NAME["payload"].add(changed, "elbow", {"mass": 2.7, "position_x": 0.16})
    body = mujoco.MjModel.body(changed.compile(), "forearm")
    before = mujoco.MjModel.body(spec().compile(), "forearm")
    assert body.mass[0] == pytest.approx(before.mass[0] + 2.7)
    own = spec()
    BY_NAME["payload"].add(own, "elbow", {"mass": 2.7, "position_x": 0.16, "inertia": 0.03})
    ball = mujoco.MjModel.body(own.compile(), "forearm")
    assert ball.inertia - body.inertia == pytest.approx([0.03] * 3)
    with pytest.raises(ValueError, match="nothing says where it hangs"):
        BY_NAME["payload"].add(spec(), "elbow", {"mass": 2.7})


def test_the_rotor_of_a_motor_of_two_joints_is_inertia_of_its_joint_and_takes_from_the_other() -> (
    None
):
    rotor = {"torque": 0.0, "damping": 0.0, "inertia": 0.02}
    model = added("coupled_motor", PARAMETERS["coupled_motor"] | rotor)
    assert model.dof_armature[1] == pytest.approx(0.02)
    data = mujoco.MjData(model)
    data.qpos[:], data.qacc[:] = [0.3, 0.6], [2.0, -1.0]
    mujoco.mj_inverse(model, data)
    data.qfrc_applied[:] = data.qfrc_inverse + np.array([0.0, -0.02 * 2.0])
    effects = AppliedEffects(model)
    for _ in range(20):
        mujoco.mj_forward(model, data)
        effects.apply(data)
    assert data.qacc == pytest.approx([2.0, -1.0], rel=1e-6)


def coupled(parameters: dict[str, float], *, motor: bool = False) -> mujoco.MjModel:
    """Return the arm whose elbow a coupling to the shoulder acts on."""
    changed = spec()
    if motor:
        at = mujoco.mjtTrn.mjTRN_JOINT
        changed.add_actuator(name="motor", trntype=at, target="shoulder").gear[0] = 3.0
    BY_NAME["cross_joint_coupling"].add(
        changed, "elbow", {"other_dof": 0.0, "torque_at_zero": 0.0, **parameters}
    )
    return mujoco.MjModel.from_xml_string(changed.to_xml())


def test_a_coupling_by_acceleration_is_inertia_that_the_other_joint_feels() -> None:
    """As MuJoCo has it: what the motors need for accelerations that the model then takes."""
    model = coupled({"inertia": 0.02})
    data = mujoco.MjData(model)
    data.qpos[:], data.qacc[:] = [0.3, 0.6], [2.0, -1.0]
    mujoco.mj_inverse(model, data)
    data.qfrc_applied[:] = data.qfrc_inverse + np.array([0.0, 0.02 * 2.0])
    effects = AppliedEffects(model)
    for _ in range(20):
        mujoco.mj_forward(model, data)
        effects.apply(data)
    assert data.qacc == pytest.approx([2.0, -1.0], rel=1e-6)


@pytest.mark.parametrize("motor", [True, False])
def test_a_coupling_by_effort_passes_on_what_the_other_motor_gives(motor: bool) -> None:
    """Where the model has no motor there, what is applied to that joint stands for it."""
    model = coupled({"effort_share": -0.4}, motor=motor)
    data = mujoco.MjData(model)
    if motor:
        data.ctrl[0] = 2.0
    else:
        data.qfrc_applied[0] = 6.0
    mujoco.mj_forward(model, data)
    AppliedEffects(model).apply(data)
    mujoco.mj_forward(model, data)
    assert data.qfrc_actuator[1] == pytest.approx(0.4 * 6.0)


def test_a_robots_spring_that_hardens_is_its_equation() -> None:
    model = added(
        "nonlinear_stiffness",
        {"cubic_stiffness": 3.0, "centre": 0.2, "stiffness": 0.5, "torque_at_zero": -0.1},
    )
    assert applied_torque(model, 1.2, 0.0) == pytest.approx(-(3.0 + 0.5 * 1.2 - 0.1))


def test_a_torque_that_begins_with_a_round_corner_goes_on_straight_beyond_it() -> None:
    """At the corner's angle it is its width times ln 2 and the stiffness; before it, soon none."""
    corner = {"stiffness": 4.0, "onset": 0.5, "side": 1.0, "power": -1.0, "width": 0.05}
    model = added("end_range_torque", corner)
    assert applied_torque(model, 0.5, 0.0) == pytest.approx(-4.0 * 0.05 * np.log(2.0))
    assert applied_torque(model, 1.5, 0.0) == pytest.approx(-4.0)
    assert applied_torque(model, -0.5, 0.0) == pytest.approx(0.0, abs=1e-6)
