"""What every effect of the catalogue promises, and the bench it is fitted on."""

import numpy as np
import pytest

from analysis.closeloop.identification.least_squares import keep_independent, solve
from analysis.closeloop.identification.model import no_estimate
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.signals import lagged, shifted
from sim.effects.catalogue import BY_NAME, EFFECTS
from tests.testbed.effects import Arm

CONTRACT = """
coulomb_friction viscous_friction stribeck_friction asymmetric_friction load_dependent_friction
position_dependent_friction torque_offset torque_gain payload added_inertia position_offset
joint_stiffness nonlinear_stiffness end_range_torque torque_ripple time_delay actuator_lag
series_elasticity backlash hysteresis stretch_reflex thixotropy drift cross_joint_coupling
"""


def test_the_catalogue_has_the_names_of_the_contract() -> None:
    assert sorted(e.name for e in EFFECTS) == sorted(CONTRACT.split())


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_an_effect_has_finite_columns_parameters_with_units_and_words(
    effect: object, recording: Recording
) -> None:
    effect = BY_NAME[effect.name]  # type: ignore[attr-defined]
    assert effect.complexity >= 1 and effect.signature and effect.separating_trial
    estimate = no_estimate(recording)
    thetas = effect.thetas(recording, 1, estimate)
    if effect.name != "torque_ripple":  # it looks for orders in a residual, and here is none
        assert thetas
    for theta in thetas[:3]:
        parameters = effect.readings(recording, 1, theta)
        assert all(effect.unit(name, theta) for name in parameters)
        if effect.channel:
            continue
        columns = effect.columns(recording, 1, theta, estimate)
        assert all(np.isfinite(column).all() for column in columns.values())
        width = next(iter(columns.values())).shape[1]
        used = {p.column for p in parameters.values() if p.column is not None}
        assert used <= set(range(width))


@pytest.mark.parametrize("name", ["coulomb_friction", "viscous_friction", "hysteresis"])
def test_friction_takes_energy_from_the_motor(name: str, recording: Recording) -> None:
    effect, estimate = BY_NAME[name], no_estimate(recording)
    theta = effect.thetas(recording, 1, estimate)[0]
    torque = effect.columns(recording, 1, theta, estimate)[1][:, 0]
    assert float((torque * recording.velocity[:, 1]).mean()) > 0


def test_a_payload_is_the_torque_of_a_point_mass_on_both_joints(recording: Recording) -> None:
    effect, estimate = BY_NAME["payload"], no_estimate(recording)
    columns = effect.columns(recording, 1, {"distance": 2.0}, estimate)
    lever, upper = 2.0 * Arm().lever, 0.3
    angle = recording.position.sum(axis=1)
    spin = recording.acceleration.sum(axis=1)
    q1, q2 = recording.position.T
    v1 = recording.velocity[:, 0]
    a1 = recording.acceleration[:, 0]
    elbow = lever**2 * spin + 9.81 * lever * np.cos(angle)
    elbow += upper * lever * (a1 * np.cos(q2) + v1**2 * np.sin(q2))
    # The point is a sphere of a millimetre to MuJoCo.
    assert columns[1][:, 0] == pytest.approx(elbow, abs=1e-5)
    assert set(columns) == {0, 1}
    assert np.ptp(columns[0]) > 0 and np.ptp(q1) > 0


def test_a_delay_and_its_opposite_cancel() -> None:
    t = np.arange(1000) / 200.0
    signal = np.sin(3 * t)[:, None]
    back = shifted(shifted(signal, 0.031, 200.0), -0.031, 200.0)
    assert back[20:-20] == pytest.approx(signal[20:-20], abs=2e-4)


def test_a_lag_is_behind_by_its_time_constant() -> None:
    ramp = np.arange(2000)[:, None] / 1000.0
    assert lagged(ramp, 0.05, 1000.0)[-1] == pytest.approx(ramp[-1] - 0.05, abs=1e-3)


def test_columns_that_others_explain_are_dropped() -> None:
    rng = np.random.default_rng(1)
    base = rng.standard_normal((500, 2))
    new = rng.standard_normal(500)
    columns = np.column_stack([base @ [1.0, 2.0], new, new + 1e-4 * base[:, 0]])
    assert keep_independent(base, columns)[1] == (1,)


def test_a_bounded_coefficient_stays_at_zero() -> None:
    rng = np.random.default_rng(2)
    x = rng.standard_normal((300, 2))
    table = np.column_stack([x, x @ [2.0, -1.0]])
    assert solve(table.T @ table, np.array([-np.inf, -np.inf])) == pytest.approx([2.0, -1.0])
    held = solve(table.T @ table, np.array([-np.inf, 0.0]))
    assert held[1] == 0.0 and held[0] == pytest.approx(
        float(x[:, 0] @ table[:, 2] / (x[:, 0] @ x[:, 0]))
    )
