"""What every effect promises, from its words to its torque in MuJoCo."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import unfitted
from analysis.closeloop.session.recording import Recording
from sim.effects.applied import AppliedEffects
from sim.effects.catalogue import ASSESSED, BY_NAME, EFFECTS, VISCOELASTIC
from sim.effects.effect import AppliedEffect, Effect, Law
from sim.effects.motion import SimulatedMotion
from sim.effects.parameter import PERIODS, unit_at
from tests.testbed.sessions.effects import Arm
from tests.testbed.sessions.rich import ELBOW, TRUTH, asked, torque, values
from tests.testbed.sessions.synthetic import mjcf

CONTRACT = """
coulomb_friction viscous_friction stribeck_friction asymmetric_friction load_dependent_friction
position_dependent_friction torque_offset torque_gain payload added_inertia position_offset
joint_stiffness nonlinear_stiffness end_range_torque torque_ripple time_delay actuator_lag
series_elasticity backlash hysteresis stretch_reflex thixotropy drift cross_joint_coupling
"""
#: Names that came later.
LATER = """
stribeck_load_friction directional_load_friction quadratic_load_friction thixotropic_stiffness
gravity_torque coupled_motor stress_relaxation softening_stiffness end_range_both
stretch_reflex_both
"""
#: What a law is written with: another joint and its sense, the middle of the range, the width of an
#: exponential.
CONVENTIONS = {"other_dof", "sense", "middle", "width"}
every_effect = pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
#: Effects whose torque an actuator applies at every step.
APPLIED = [
    effect.name
    for effect in EFFECTS
    if isinstance(effect, AppliedEffect) and effect.element == AppliedEffect.element
]
#: In the loop of a simulation the load holds Coriolis torques too, and a joint at rest has no
#: share of its fastest motion to be smoothed over.
TOLERANCE = {"load_dependent_friction": 0.1, "hysteresis": 0.1} | dict.fromkeys(LATER.split(), 0.15)


def turns(recording: Recording) -> np.ndarray:
    """Return how fast the elbow turns, or a motor that turns with both joints, the slower, (n,)."""
    both = np.abs(recording.velocity.sum(axis=1))
    return np.minimum(np.abs(recording.velocity[:, ELBOW]), both)


def spec() -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(mjcf(Arm()))


def test_the_catalogue_has_the_names_of_the_contract_simplest_first() -> None:
    names = {*CONTRACT.split(), *LATER.split()}
    assert sorted(effect.name for effect in EFFECTS) == sorted(names)
    assert EFFECTS[0].complexity == 1 and EFFECTS[-1].complexity == 5
    assert set(BY_NAME) == {VISCOELASTIC.name, *names} == {VISCOELASTIC.name, *TRUTH}


@pytest.mark.parametrize("name", ["joint_stiffness", "cross_joint_coupling", "drift"])
def test_what_has_no_zero_of_its_own_leaves_no_offset(name: str, recording: Recording) -> None:
    columns = BY_NAME[name].columns(unfitted(recording, ELBOW), TRUTH[name][0])[ELBOW]
    constant = np.ones(len(columns))
    held = np.linalg.lstsq(columns, constant, rcond=None)[0]
    np.testing.assert_allclose(columns @ held, constant, atol=1e-9)
    assert "torque_offset" in BY_NAME[name].includes


@every_effect
def test_an_effect_says_what_to_look_for_and_where_it_is(effect: Effect) -> None:
    assert effect.complexity >= 1
    assert effect.signature and effect.element and effect.separating_trial
    assert {*effect.includes, *effect.twins} <= set(BY_NAME)
    for other in effect.not_beside:
        assert other in effect.grows_from or effect.name in BY_NAME[other].not_beside
    assert set(effect.coefficients) <= set(effect.parameters)
    assert (effect.owner is not None) == (effect.name in ASSESSED)


@every_effect
def test_a_parameter_has_a_unit_a_description_and_limits_that_hold_its_range(
    effect: Effect,
) -> None:
    assert effect.parameters
    for name, parameter in effect.parameters.items():
        assert parameter.unit and parameter.description, name
        assert parameter.floor <= parameter.neutral <= parameter.ceiling, name
        if effect.owner is not None:
            assert parameter.floor <= parameter.low < parameter.high <= parameter.ceiling, name
            assert parameter.within_limits(parameter.low) == parameter.low, name
    if effect.owner is not None:
        assert any(parameter.switches for parameter in effect.parameters.values())


@pytest.mark.parametrize(
    ("unit", "slide"),
    [
        ("Nm", "N"),
        ("Nm s/rad", "N s/m"),
        ("rad/Nm", "m/N"),
        ("kg m2", "kg"),
        (PERIODS, "rad/m"),
    ],
)
def test_a_slide_has_newtons_and_metres(unit: str, slide: str) -> None:
    assert unit_at(unit, hinge=True) == unit and unit_at(unit, hinge=False) == slide


@pytest.mark.parametrize("name", ["torque_ripple", "position_dependent_friction"])
def test_an_order_counts_the_periods_of_a_turn_as_its_unit_says(name: str) -> None:
    """Reports called it 1/rad, which a reader takes for 6.28 times as many."""
    assert BY_NAME[name].parameters["order"].unit == PERIODS
    model = mujoco.MjModel.from_xml_string(mjcf(Arm()))
    data = mujoco.MjData(model)
    given = dict.fromkeys(BY_NAME[name].parameters, 0.0) | {"order": 5.0}
    given |= {"sine": 1.0} if name == "torque_ripple" else {"torque_slope": 1.0}
    found = []
    for angle in np.radians(np.arange(360.0)):
        data.qpos[ELBOW], data.qvel[ELBOW] = angle, 1.0
        mujoco.mj_forward(model, data)
        found.append(BY_NAME[name].torque(given, SimulatedMotion(data, ELBOW, ELBOW)))
    assert int(np.argmax(np.abs(np.fft.rfft(np.array(found))))) == 5


@every_effect
def test_columns_are_finite_and_the_same_again_and_parameters_name_them(
    effect: Effect, recording: Recording
) -> None:
    recording = asked(recording, effect.name)
    joint = unfitted(recording, ELBOW)
    assert effect.applies(recording, ELBOW)
    thetas = [TRUTH[effect.name][0], *effect.thetas(joint)]
    for theta in thetas:
        # What begins without a parameter is searched with it.
        begun = {name for begin, _ in effect.searches(theta) for name in begin}
        assert set(theta) <= set(thetas[0]) <= set(theta) | begun
    for theta in thetas[:4]:
        readings = effect.readings(joint, theta)
        assert set(readings) <= set(effect.parameters)
        assert all(effect.unit(name, theta) for name in readings)
        values = effect.fixed(joint, theta)
        assert set(values) == {name for name, r in readings.items() if r.column is None}
        used = set().union(*(reading.columns for reading in readings.values()))
        columns = effect.columns(joint, theta)
        again = effect.columns(joint, theta)
        for number, column in columns.items():
            assert column.shape == (len(recording.time), len(used))
            assert np.isfinite(column).all() and np.array_equal(column, again[number])
        assert bool(columns) != effect.channel


@every_effect
def test_what_refines_an_effect_stays_near_and_finite(effect: Effect, recording: Recording) -> None:
    theta = TRUTH[effect.name][0]
    for near in effect.neighbours(theta, 0.12):
        assert set(near) == set(theta) and near != theta
        assert all(abs(near[key] - theta[key]) <= 0.05 * max(1.0, abs(theta[key])) for key in theta)
    assert all(parameter.name in theta for parameter in effect.nonlinear)


@every_effect
def test_a_parameter_that_has_an_interval_is_refined_off_its_grid(effect: Effect) -> None:
    for parameter in effect.nonlinear:
        if parameter.step is not None and parameter.usual is None:
            below, above = parameter.near(1.0, 1.0)
            assert below < 1.0 < above, parameter.name


@every_effect
def test_a_quantity_that_is_no_coefficient_has_an_interval(
    effect: Effect, recording: Recording
) -> None:
    joint, theta = unfitted(asked(recording, effect.name), ELBOW), TRUTH[effect.name][0]
    values = effect.fixed(joint, theta)
    sloped = [parameter.name for parameter in effect.nonlinear if parameter.step is not None]
    chosen = {name for name in values if effect.parameters[name].choice} | CONVENTIONS
    for name in values.keys() - chosen:
        moved = [effect.fixed(joint, {**theta, one: theta[one] + 1e-3})[name] for one in sloped]
        assert any(value != values[name] for value in moved), name


@pytest.mark.parametrize("effect", [e for e in EFFECTS if e.filters], ids=lambda e: e.name)
def test_what_filters_the_motion_has_no_frequency_that_the_motion_lacks(
    effect: Effect, recording: Recording
) -> None:
    # So little that the slope of gravity is one all over it.
    angle = 2 * np.pi * 2.0 * recording.time
    still, one = np.zeros_like(recording.position), np.array([0.0, 0.01])
    shaken = replace(
        recording,
        position=np.array([-0.5, 1.0]) + one * np.sin(angle)[:, None],
        velocity=still + one * 4 * np.pi * np.cos(angle)[:, None],
        acceleration=still - one * (4 * np.pi) ** 2 * np.sin(angle)[:, None],
        cache={},
    )
    theta = TRUTH[effect.name][0]
    if effect.channel:
        column = effect.through(shaken, shaken.inverse[:, [ELBOW]], theta)
    else:
        column = effect.columns(unfitted(shaken, ELBOW), theta)[ELBOW]
    # Beside its beginning and end.
    inside = slice(400, 800)
    wave = np.column_stack([np.sin(angle), np.cos(angle), np.ones_like(angle)])[inside]
    left = column[inside] - wave @ np.linalg.lstsq(wave, column[inside], rcond=None)[0]
    assert np.linalg.norm(left) < 0.02 * np.linalg.norm(column[inside] - column[inside].mean())


@pytest.mark.parametrize(
    "effect", [e for e in BY_NAME.values() if e.includes], ids=lambda e: e.name
)
def test_an_effect_absorbs_what_it_includes(effect: Effect, recording: Recording) -> None:
    joint = unfitted(recording, ELBOW)
    for name in effect.includes:
        simple = BY_NAME[name].columns(joint, BY_NAME[name].thetas(joint)[0])[ELBOW]
        left = []
        for theta in effect.thetas(joint):
            columns = effect.columns(joint, theta)[ELBOW]
            fit = columns @ np.linalg.lstsq(columns, simple, rcond=None)[0]
            left.append(np.linalg.norm(simple - fit) / np.linalg.norm(simple))
        assert min(left) < 1e-9, name


@pytest.mark.parametrize("effect", [e for e in EFFECTS if e.rubs or e.name == "viscous_friction"])
def test_friction_takes_energy_from_the_motor(effect: Effect, recording: Recording) -> None:
    needed = torque(recording, effect.name)[:, ELBOW]
    assert float((needed * recording.velocity[:, ELBOW]).mean()) > 0


@pytest.mark.parametrize("effect", [e for e in EFFECTS if isinstance(e, Law)], ids=lambda e: e.name)
def test_a_law_is_the_same_for_a_step_and_for_a_recording(
    effect: Law, recording: Recording
) -> None:
    """Away from reversals and with its own load, which a simulation knows otherwise."""
    model = spec().compile()
    data, theta = mujoco.MjData(model), TRUTH[effect.name][0]
    motion = effect.motion(unfitted(recording, ELBOW), theta)
    whole = np.broadcast_to(
        effect.torque(values(recording, effect.name), motion), recording.time.shape
    )
    for i in range(3, 1000, 50):
        data.qpos[:], data.qvel[:] = recording.position[i], recording.velocity[i]
        data.qacc[:], data.time = recording.acceleration[i], recording.time[i]
        mujoco.mj_fwdPosition(model, data)
        data.qfrc_bias[ELBOW] = np.broadcast_to(motion.load, recording.time.shape)[i]
        if turns(recording)[i] > 0.2 * recording.top_speed[ELBOW]:
            step = effect.torque(
                values(recording, effect.name), SimulatedMotion(data, ELBOW, ELBOW)
            )
            assert isinstance(step, float)
            assert step == pytest.approx(whole[i], rel=1e-9)


@pytest.mark.parametrize("aside", [0.0, 0.4, -0.4])
def test_a_payload_is_the_torque_of_a_point_mass_on_both_joints(
    aside: float, recording: Recording
) -> None:
    theta = {"distance": 2.0, "aside": aside}
    columns = BY_NAME["payload"].columns(unfitted(recording, ELBOW), theta)
    lever, upper = Arm().lever * np.hypot(2.0, aside), 0.3
    q1, q2 = recording.position.T
    turned = q2 + np.arctan2(aside, 2.0)
    spin = recording.acceleration.sum(axis=1)
    v1 = recording.velocity[:, 0]
    a1 = recording.acceleration[:, 0]
    elbow = lever**2 * spin + 9.81 * lever * np.cos(q1 + turned)
    elbow += upper * lever * (a1 * np.cos(turned) + v1**2 * np.sin(turned))
    # The point is a sphere of a millimetre to MuJoCo.
    assert columns[1][:, 0] == pytest.approx(elbow, abs=1e-5)
    assert set(columns) == {0, 1}
    assert np.ptp(columns[0]) > 0 and np.ptp(q1) > 0


@pytest.mark.parametrize("name", APPLIED)
def test_an_applied_torque_is_the_catalogues_torque(name: str, recording: Recording) -> None:
    changed = spec()
    changed.option.timestep = 1.0 / recording.rate
    element = BY_NAME[name].add(changed, "elbow", values(recording, name))
    assert element is not None and element.startswith("applied torque: actuator effect_")
    model = mujoco.MjModel.from_xml_string(changed.to_xml())
    effects, data = AppliedEffects(model), mujoco.MjData(model)
    felt = np.empty(len(recording.time))
    for i, (q, v) in enumerate(zip(recording.position, recording.velocity, strict=True)):
        data.qpos[:], data.qvel[:], data.time = q, v, recording.time[i]
        mujoco.mj_forward(model, data)
        effects.apply(data)
        felt[i] = data.ctrl[0]
    needed = torque(recording, name)[:, ELBOW]
    # The joint feels the opposite of what the motor must add; both are smoothed at a reversal.
    moving = turns(recording) > 0.1 * recording.top_speed[ELBOW]
    # What was before the recording reaches into it by a reflex's delay.
    moving &= recording.time > 0.1
    rms = float(np.sqrt(np.mean(needed**2)))
    assert np.abs(felt + needed)[moving].max() < TOLERANCE.get(name, 0.05) * rms


@pytest.mark.parametrize(
    "name",
    ["viscous_friction", "joint_stiffness", "added_inertia", "payload", "position_offset"],
)
def test_a_native_element_is_the_catalogues_torque(name: str, recording: Recording) -> None:
    needed = torque(recording, name)
    torques = []
    for change in (False, True):
        changed = spec()
        if change:
            found = BY_NAME[name].add(changed, "elbow", values(recording, name))
            assert found == BY_NAME[name].element
        model = mujoco.MjModel.from_xml_string(changed.to_xml())
        data, out = mujoco.MjData(model), np.empty((50, 2))
        for row, i in enumerate(range(0, 1000, 20)):
            data.qpos[:] = recording.position[i]
            data.qvel[:], data.qacc[:] = recording.velocity[i], recording.acceleration[i]
            mujoco.mj_inverse(model, data)
            out[row] = data.qfrc_inverse
        torques.append(out)
    assert torques[1] - torques[0] == pytest.approx(needed[::20], abs=2e-3)


@pytest.mark.parametrize("stiffness", [-1.5, 0.8])
def test_what_a_spring_over_two_joints_does_by_its_own_is_a_spring_of_the_joint_as_well(
    stiffness: float, recording: Recording
) -> None:
    """As of a belt, which both stretch by their difference, or of a muscle, by their sum."""
    coupling, joint = BY_NAME["cross_joint_coupling"], unfitted(recording, ELBOW)
    theta = {"other_dof": 0.0, "between": 0.0, "by": 0.0}
    (form,) = coupling.forms(theta, {0: stiffness})
    assert form["between"] == -np.sign(stiffness)
    plain, other = (coupling.columns(joint, one)[ELBOW][:, 0] for one in (theta, form))
    own = stiffness * (plain - other)
    np.testing.assert_allclose(own, -abs(stiffness) * joint.position, atol=1e-12)
