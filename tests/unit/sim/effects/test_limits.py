"""What no effect can be, whatever a fit says."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import unfitted
from analysis.closeloop.identification.candidates import candidates
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME, EFFECTS
from sim.effects.effect import Effect
from sim.effects.laws.inertia import PlacedPayload
from tests.testbed.sessions.rich import ELBOW, TRUTH

SHOULDER = 0
#: Estimates that were reported once: effect, non-linear parameters, coefficients, what is wrong.
NONSENSE: list[tuple[str, dict[str, float], tuple[float, ...], str]] = [
    ("position_offset", {"offset": -0.3}, (-118.7,), "offset"),
    ("payload", {"distance": 30.0}, (0.4,), "distance"),
    ("payload", {"distance": 1.0}, (-1.9,), "mass"),
    ("payload", {"distance": 1.0, "aside": -30.0}, (0.4,), "aside"),
    # As far beside the line as it is looked for: a search that ends there found no place.
    ("payload", {"distance": 1.0, "aside": -1.0}, (0.4,), "aside"),
    ("drift", {"level_off": -0.1}, (0.1, 0.0), "time_constant"),
    ("actuator_lag", {"time_constant": -0.013}, (), "time_constant"),
    ("actuator_lag", {"time_constant": -0.077}, (), "time_constant"),
    ("actuator_lag", {"time_constant": 0.4}, (), "time_constant"),
    ("time_delay", {"delay": 1.2}, (), "delay"),
    ("time_delay", {"delay": -0.4}, (), "delay"),
    # Less than half of the 5 ms between two samples.
    ("time_delay", {"delay": 0.0021}, (), "delay"),
    ("actuator_lag", {"time_constant": 0.0021}, (), "time_constant"),
    ("torque_gain", {}, (4.0,), "gain"),
    ("load_dependent_friction", {"smooth": 0.02, "load": 0}, (0.1, 0.8), "load_share"),
    ("backlash", {"crossed": 0.8}, (1.5,), "gap"),
    # Faster than the monosynaptic arc.
    (
        "stretch_reflex",
        {"side": 1.0, "delay": 0.0, "activation_time": 0.0, "speed": 0.1, "angle": -2.0},
        (1.5,),
        "delay",
    ),
    # Drag that grows with speed, both ways and at once.
    (
        "stretch_reflex_both",
        {"delay": 0.0205, "activation_time": 0.0, "speed": 0.1},
        (1.5, 1.5),
        "delay",
    ),
    ("hysteresis", {"distance": 0.008, "exponent": 1.0}, (0.5,), "distance"),
    # None of it is left when fast, or at all.
    ("stribeck_friction", {"speed": 0.2, "smooth": 0.01, "power": 2.0}, (0.0, 0.5), "torque"),
    ("thixotropic_stiffness", {"recovery": 0.7, "distance": 0.5}, (0.0, 0.1), "stiffness"),
]


def robot(recording: Recording) -> Recording:
    """Return the same recording of a robot without a limb."""
    return replace(recording, session=replace(recording.session, limb_joints=()))


@pytest.mark.parametrize(("name", "theta", "found", "wrong"), NONSENSE)
def test_what_cannot_be_is_no_estimate(
    name: str,
    theta: dict[str, float],
    found: tuple[float, ...],
    wrong: str,
    recording: Recording,
) -> None:
    joint = unfitted(recording, ELBOW)
    assert BY_NAME[name].beyond(joint, theta, dict(enumerate(found))) == wrong


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_what_can_be_is_within_its_limits(effect: Effect, recording: Recording) -> None:
    theta, found = TRUTH[effect.name]
    joint = unfitted(recording, ELBOW)
    assert effect.beyond(joint, theta, dict(enumerate(found))) == ""
    assert effect.limits(joint).keys() == effect.parameters.keys()


def test_an_industrial_robot_has_no_reflex(recording: Recording) -> None:
    of_limbs = {
        "stretch_reflex",
        "stretch_reflex_both",
        "thixotropy",
        "thixotropic_stiffness",
        "stress_relaxation",
        "end_range_torque",
        "nonlinear_stiffness",
        "softening_stiffness",
        "end_range_both",
        "gravity_torque",
    }
    assert {effect.name for effect in EFFECTS if effect.limb} == of_limbs
    asked = [candidate.effect for candidate in candidates(robot(recording))]
    assert not any(effect.limb for effect in asked)
    # Its springs harden, too, by a law of their own.
    assert of_limbs & {effect.name for effect in asked} == {"nonlinear_stiffness"}
    found = {c.key for c in candidates(recording) if c.effect.limb}
    assert found == {(name, ELBOW) for name in of_limbs}


def test_a_load_hangs_where_the_robot_reaches(recording: Recording) -> None:
    """The elbow lies 0.3 m from the shoulder."""
    forearm = float(np.linalg.norm(recording.centre_of_mass(ELBOW)))
    assert recording.reach(ELBOW) == pytest.approx(2.0 * forearm + 0.15)
    assert recording.reach(SHOULDER) == pytest.approx(0.3 + 2.0 * forearm + 0.15)


def test_only_a_limb_may_have_less_mass_and_inertia_than_declared(recording: Recording) -> None:
    arm, machine = unfitted(recording, ELBOW), unfitted(robot(recording), ELBOW)
    for name, theta, less, parameter in (
        ("added_inertia", {}, -0.01, "inertia"),
        ("payload", {"distance": 1.0}, -0.2, "mass"),
    ):
        effect = BY_NAME[name]
        assert effect.beyond(arm, theta, {0: less}) == ""
        assert effect.beyond(machine, theta, {0: less}) == parameter


def test_a_load_with_a_place_hangs_where_the_robot_reaches(recording: Recording) -> None:
    placed = PlacedPayload()
    joint = unfitted(robot(recording), ELBOW)
    here = dict.fromkeys(("position_x", "position_y", "position_z"), 0.0)
    assert placed.limits(joint).keys() == placed.parameters.keys()
    assert placed.beyond(joint, here, {0: 2.0, 1: 0.2, 2: 0.0, 3: 0.0}) == ""
    assert placed.beyond(joint, here, {0: 2.0, 1: 3.7, 2: 0.0, 3: 0.0}) == "position_x"


def test_a_slide_is_off_by_less_than_its_travel(recording: Recording) -> None:
    joint = unfitted(recording, ELBOW)
    offset = BY_NAME["position_offset"]
    assert offset.limits(joint)["offset"] == pytest.approx((-np.pi / 2, np.pi / 2))


def test_a_correction_of_declared_friction_may_take_away(recording: Recording) -> None:
    joint, coulomb = unfitted(recording, ELBOW), BY_NAME["coulomb_friction"]
    assert coulomb.beyond(joint, {"smooth": 0.02}, {0: -0.5}) == "torque"
    assert coulomb.beyond(joint, {"smooth": 0.02}, {0: -0.5}, difference=True) == ""
