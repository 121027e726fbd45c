"""Effects in the simulated assessment: each acts, and native, stepped and rolled-out agree."""

import pytest

from sim.assessment.assess import assess
from sim.effects.catalogue import ASSESSED
from tests.testbed.assessments import Assess

#: One setting of every effect that is large enough to be seen in an assessment.
SETTINGS = {
    "coulomb_friction": {"torque": 2.0},
    "viscous_friction": {"damping": 1.0},
    "stribeck_friction": {"torque": 1.5, "breakaway_excess": 0.5},
    "asymmetric_friction": {"torque_positive": 1.0, "torque_negative": 2.0},
    "load_dependent_friction": {"torque": 1.0, "load_share": 0.1},
    "position_dependent_friction": {"torque_middle": 1.5, "torque_slope": 0.5},
    "torque_offset": {"torque": 1.0},
    "torque_gain": {"gain": 1.1},
    "added_inertia": {"inertia": 0.1},
    "payload": {"mass": 0.5, "distance": 0.2},
    "torque_ripple": {"sine": 0.5},
    "nonlinear_stiffness": {"cubic_stiffness": 2.0},
    "end_range_torque": {"stiffness": 5.0, "onset": 0.6, "side": -1.0},
    "stretch_reflex": {"gain": 3.0, "side": -1.0, "threshold_velocity": 0.5, "delay": 0.04},
}


def factors(name: str, parameters: dict[str, float]) -> dict[str, float]:
    return {f"effect.{name}.{parameter}": value for parameter, value in parameters.items()}


@pytest.mark.parametrize("name", ASSESSED)
def test_every_effect_changes_the_torque_that_the_clinic_sees(assessed: Assess, name: str) -> None:
    plain = assessed({}, fidelity="bushing")
    other = assessed(factors(name, SETTINGS[name]), fidelity="bushing")
    assert other.outcome == "ok", other.reason
    assert plain.record is not None and other.record is not None
    change = other.record.motor_torque[:, 3] - plain.record.motor_torque[:, 3]
    assert abs(change).max() > 0.05


@pytest.mark.parametrize("fidelity", ["bushing", "screening"])
def test_friction_by_any_name_is_the_same_friction(assessed: Assess, fidelity: str) -> None:
    """The condition, the native element, and a level set anew at each step."""
    ways = [
        {"robot_friction": 2.0},
        factors("coulomb_friction", {"torque": 2.0}),
        factors("stribeck_friction", {"torque": 2.0}),
        factors("asymmetric_friction", {"torque_positive": 2.0, "torque_negative": 2.0}),
        factors("load_dependent_friction", {"torque": 2.0}),
        factors("position_dependent_friction", {"torque_middle": 2.0}),
    ]
    found = [assessed(way, fidelity=fidelity).outputs["stiffness_estimate"] for way in ways]
    assert found[1:] == pytest.approx([found[0]] * 5, abs=1e-9)


def test_stepping_in_python_gives_what_the_engine_rolls_out() -> None:
    rolled = assess({}, fidelity="bushing").outputs
    stepped = assess(factors("torque_ripple", {"sine": 1e-12}), fidelity="bushing").outputs
    assert stepped == pytest.approx(dict(rolled), abs=1e-8)


def test_a_torque_gain_scales_what_the_motor_reports(assessed: Assess) -> None:
    plain, scaled = (
        assessed(factors("torque_gain", {"gain": gain}), fidelity="screening").record
        for gain in (1.0, 1.25)
    )
    assert plain is not None and scaled is not None
    # At rest before the movement the joint needs the same torque either way.
    assert plain.motor_torque[0, 3] / scaled.motor_torque[0, 3] == pytest.approx(1.25, rel=0.01)
    assert plain.motor_torque[:, 3].std() > 1.2 * scaled.motor_torque[:, 3].std()


def test_a_reflex_of_the_limb_is_no_part_of_the_true_stiffness(assessed: Assess) -> None:
    plain = assessed({}, fidelity="bushing").outputs
    reflex = assessed(
        factors("stretch_reflex", SETTINGS["stretch_reflex"]), fidelity="bushing"
    ).outputs
    assert reflex["stiffness_true"] == pytest.approx(plain["stiffness_true"], rel=0.02)
    assert reflex["damping_estimate"] < plain["damping_estimate"] - 0.5


def test_a_spring_at_the_end_of_the_range_resists_extension(assessed: Assess) -> None:
    plain = assessed({}, fidelity="bushing").record
    ended = assessed(
        factors("end_range_torque", SETTINGS["end_range_torque"]), fidelity="bushing"
    ).record
    assert plain is not None and ended is not None
    # Extension lowers the angle; a limb that pulls back makes the motor push it down harder.
    assert ended.motor_torque[-1, 3] < plain.motor_torque[-1, 3] - 0.5
