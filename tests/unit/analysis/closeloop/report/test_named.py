"""An estimate whose interval spans what it cannot be is refused, as is what no body can be."""

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

from analysis.closeloop.contract import Verdict
from analysis.closeloop.identification.balance.declared import PLACED
from analysis.closeloop.identification.balance.model import Model, evaluate, unfitted
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.identification.balance.uncertainty import Fits, leave_out
from analysis.closeloop.identification.parameters import beside_its_like, parameters_of
from analysis.closeloop.report.named import (
    _if_it_can_be,
    if_they_can_be,
    late_efforts,
    only_held,
    refused_values,
    supposed,
    turns_all,
    undetermined,
    with_places,
    with_tilt,
)
from analysis.closeloop.report.repaired import repaired_model
from analysis.closeloop.session.device import Device
from sim.effects.catalogue import BY_NAME
from sim.effects.laws.inertia import PLACE
from tests.testbed.sessions.effects import Arm
from tests.testbed.sessions.rich import ELBOW, TRUTH, rich_recording
from tests.testbed.sessions.synthetic import mjcf

MASS = (0.0, float("inf"))


def test_only_the_zero_of_what_turns_all_is_a_base_that_stands_askew() -> None:
    arm = rich_recording()
    assert turns_all(arm, 0) and not turns_all(arm, ELBOW)


def test_of_a_robots_joint_that_never_moves_wrong_links_look_like_a_coupling() -> None:
    arm = rich_recording()
    held = np.array(arm.position)
    held[:, [0, ELBOW]] *= 0.1
    held_arm = replace(arm, position=held, cache={})
    assert only_held(held_arm, 0) and not only_held(arm, 0)
    # Its elbow is a limb's.
    assert not only_held(held_arm, ELBOW)


def test_no_movement_is_said_to_tell_a_wrong_zero_from_a_base_that_stands_askew() -> None:
    others, trial = with_tilt([], "hold still in five postures")
    assert others == ["gravity_torque"] and trial.startswith("put a level on the base")
    others, trial = with_tilt(["payload"], "hold still in five postures")
    assert others == ["payload", "gravity_torque"]
    assert trial.startswith("hold still in five postures; put a level on the base")


@pytest.mark.parametrize(("low", "refused"), [(-0.2, True), (0.3, False)])
def test_what_may_have_no_mass_hangs_nowhere(low: float, refused: bool) -> None:
    mass = {"value": 0.4, "ci90": [max(low, 0.0), 0.5], "unit": "kg", "free": (low, 0.5)}
    place = {"value": 0.6, "ci90": [0.5, 0.7], "unit": "m", "free": (0.5, 0.7)}
    entries = {"mass": mass | {"limits": MASS}, "position_x": place | {"limits": (-0.9, 0.9)}}
    found = if_they_can_be(entries)["position_x"]
    assert found["value"] == (None if refused else 0.6)
    assert ("may have no mass" in found.get("refused", "")) is refused
    # What was fitted is what was simulated.
    assert not refused or found["fitted"] == 0.6


def payload(free: tuple[float, float]) -> dict[str, Any]:
    entry = {"value": 0.7, "ci90": [max(free[0], 0.0), free[1]], "unit": "kg"}
    mass = _if_it_can_be(entry | {"free": free, "limits": MASS})
    return {"name": "payload", "joint": "elbow", "parameters": {"mass": mass}}


def test_a_refused_mass_has_no_value_and_the_model_says_that_it_is_only_fitted() -> None:
    good, refused = payload((0.6, 0.8)), payload((-1.9, 3.3))
    refused["parameters"]["distance"] = {"value": 0.2}
    assert good["parameters"]["mass"] == {"value": 0.7, "ci90": [0.6, 0.8], "unit": "kg"}
    mass = refused["parameters"]["mass"]
    assert mass["value"] is None and mass["ci90"] is None
    assert refused_values([good]) == []
    (said,) = refused_values([refused])
    assert said.startswith(
        "payload of elbow: mass is not determined, because its 90 % interval, -1.9 to"
    )
    assert said.endswith("reaches too far beyond what is possible (0 or more)")
    device = Device(mujoco.MjSpec.from_string(mjcf(Arm())), ())
    report = {
        "declared": [],
        "impedance": {},
        "verdict": Verdict.EFFECT_FOUND,
        "effects": [refused],
    }
    xml, elements, warnings = repaired_model(device, report)
    (warning,) = warnings
    assert warning.startswith("model_after.xml has the fitted values of payload of elbow")
    model = mujoco.MjModel.from_xml_string(xml)
    added = model.body_mass.sum() - device.model.body_mass.sum()
    assert added == pytest.approx(0.7) and elements == [BY_NAME["payload"].element]


def test_friction_whose_excess_is_not_determined_is_in_the_model_as_coulombs() -> None:
    device = Device(mujoco.MjSpec.from_string(mjcf(Arm())), ())
    values = {"torque": 0.7, "breakaway_excess": None, "stribeck_velocity": None}
    effect = {
        "name": "stribeck_friction",
        "joint": "elbow",
        "parameters": {key: {"value": value} for key, value in values.items()},
    }
    report = {
        "declared": [],
        "impedance": {},
        "verdict": Verdict.EFFECT_FOUND,
        "effects": [effect],
    }
    xml, elements, (said,) = repaired_model(device, report)
    assert said.startswith("model_after.xml has coulomb_friction instead of stribeck_friction")
    assert elements == ["joint/@frictionloss"]
    model = mujoco.MjModel.from_xml_string(xml)
    assert model.dof_frictionloss[model.joint("elbow").dofadr[0]] == 0.7


def test_what_was_fitted_beside_others_stays_in_the_model_though_trials_do_not_tell_it() -> None:
    # The pitch of a surgical robot: asymmetric friction of which an offset takes a half.
    device = Device(mujoco.MjSpec.from_string(mjcf(Arm())), ())
    known = {"torque_positive": {"value": 0.3}}
    unknown = {"torque_negative": {"value": None, "fitted": 0.1}}
    effect = {
        "name": "asymmetric_friction",
        "joint": "elbow",
        "parameters": known | unknown,
    }
    report = {
        "declared": [],
        "impedance": {},
        "verdict": Verdict.EFFECT_FOUND,
        "effects": [effect],
    }
    xml, _, (said,) = repaired_model(device, report)
    assert said.startswith("model_after.xml has the fitted values of asymmetric_friction of elbow")
    assert "'torque_negative': 0.1" in xml
    # What cannot be is in no model.
    unknown["torque_negative"]["fitted"] = None
    xml, _, (said,) = repaired_model(device, report)
    assert said.startswith("model_after.xml lacks") and "asymmetric" not in xml


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("payload", {"mass": -1.2, "distance": 0.3}),
        ("added_inertia", {"inertia": -5.0}),
    ],
)
def test_what_no_body_can_be_is_told_once_and_in_words(
    name: str, parameters: dict[str, float]
) -> None:
    device = Device(mujoco.MjSpec.from_string(mjcf(Arm())), ())
    values = {key: {"value": value} for key, value in parameters.items()}
    effect = {"name": name, "joint": "elbow", "parameters": values}
    report = {
        "declared": [],
        "impedance": {},
        "verdict": Verdict.EFFECT_FOUND,
        "effects": [effect],
    }
    _, _, (said,) = repaired_model(device, report)
    assert said.startswith(f"model_after.xml lacks {name} of elbow: ")
    assert "A + B" not in said and "no element" not in said and "\n" not in said


def stribeck_velocity(spread: float) -> dict[str, Any]:
    """Return it as reported where four trials left out move it by `spread` of its top speed."""
    found = Candidate(effect=BY_NAME["stribeck_friction"], joint=ELBOW)
    recording = rich_recording()
    theta, coefficients = TRUTH["stribeck_friction"]
    columns = found.effect.columns(unfitted(recording, ELBOW), theta)
    term = Term(
        joint=ELBOW,
        columns=columns,
        lower=found.effect.lower,
        theta=theta,
        kept=(0, 1),
        effect=found.effect,
        candidate=found,
    )
    moved = spread * np.array([0.0, 0.0, 0.0, 0.0, 1.0, -1.0, 1.0, -1.0])
    fits = Fits(
        coefficients=np.tile(coefficients, (8, 1)),
        thetas={(*found.key, "speed"): theta["speed"] + moved},
        steps=np.ones(3),
        sizes=(4,),
        white=(np.eye(3),),
    )
    model = Model(recording).with_term(term)
    own = parameters_of(model, np.array(coefficients), fits, term)["stribeck_velocity"]
    return _if_it_can_be(own)


def test_a_share_that_is_refused_is_told_without_a_unit() -> None:
    share = {"value": 0.2, "unit": "1", "free": (-0.9, 1.3), "limits": (0.0, 1.0)}
    assert (
        "-0.9 to 1.3, reaches too far beyond what is possible (0 to 1)"
        in (_if_it_can_be(share)["refused"])
    )


def test_what_no_column_gives_ends_where_it_means_something_or_has_no_value() -> None:
    unsure, unknown = stribeck_velocity(0.065), stribeck_velocity(0.2)
    assert unsure["ci90"][0] == 1e-3 < unsure["value"] < unsure["ci90"][1]
    assert unknown["value"] is None and unknown["ci90"] is None
    assert "beyond what is possible (" in unknown["refused"]
    assert unknown["fitted"] == unsure["value"] and "fitted" not in unsure


def offset(spread: float) -> dict[str, Any]:
    """Return an offset as reported where four trials left out move it by `spread`, Nm."""
    found = Candidate(effect=BY_NAME["torque_offset"], joint=ELBOW)
    recording = rich_recording()
    columns = found.effect.columns(unfitted(recording, ELBOW), {})
    term = Term(joint=ELBOW, columns=columns, kept=(0,), effect=found.effect, candidate=found)
    moved = spread * np.array([0.0, 0.0, 1.0, -1.0, 1.0, -1.0])
    fits = Fits(
        coefficients=0.4 + moved[:, None],
        thetas={},
        steps=np.ones(1),
        sizes=(4,),
        white=(np.eye(1),),
    )
    model = Model(recording).with_term(term)
    return _if_it_can_be(parameters_of(model, np.array([0.4]), fits, term)["torque"])


def test_a_torque_that_may_be_larger_than_all_that_was_recorded_has_no_value() -> None:
    """Beside asymmetric friction a coupling's constant came to 0.4 (-5160 to 5160) Nm."""
    known, unknown = offset(0.1), offset(3000.0)
    assert known["value"] == 0.4 and known["ci90"][0] < 0.4 < known["ci90"][1]
    assert unknown["value"] is None and "beyond what is possible (" in unknown["refused"]
    assert unknown["fitted"] == 0.4


@pytest.mark.parametrize(
    ("cosine", "warned"), [([-0.14, 0.19], True), (None, True), ([0.05, 0.19], False)]
)
def test_an_effect_of_which_nothing_is_surely_other_than_zero_is_told(
    cosine: list[float] | None, warned: bool
) -> None:
    parameters = {"cosine": {"ci90": cosine}, "order": {"ci90": [198.0, 647.0]}}
    found = {"name": "torque_ripple", "joint": "elbow", "parameters": parameters}
    said = undetermined([found])
    assert bool(said) is warned
    assert all(line.startswith("torque_ripple of elbow: ") for line in said)


@pytest.mark.parametrize(
    ("value", "half", "warned"), [(2.0, 0.0, True), (2.0, 0.1, False), (1.3, 0.0, False)]
)
def test_a_power_that_is_supposed_is_said_to_be(value: float, half: float, warned: bool) -> None:
    """Its interval, [2, 2], looked as if it had been measured to the last digit."""
    power = {"value": value, "ci90": [value - half, value + half], "unit": "1"}
    torque = {"value": 0.4, "ci90": [0.3, 0.5], "unit": "Nm"}
    entry = {
        "name": "stribeck_friction",
        "joint": "elbow",
        "parameters": {"torque": torque, "stribeck_exponent": power},
    }
    links = {"name": "link_inertia", "joint": "base", "parameters": {"arm.mass": torque}}
    # A side is a choice: there is no other value that is usual.
    side = {"value": 1.0, "ci90": [1.0, 1.0], "unit": "1"}
    reflex = {"name": "stretch_reflex", "joint": "elbow", "parameters": {"side": side}}
    # So is the number of a joint.
    other = {"value": 0.0, "ci90": [0.0, 0.0], "unit": "1"}
    coupling = {
        "name": "cross_joint_coupling",
        "joint": "elbow",
        "parameters": {"other_dof": other},
    }
    said = supposed([entry, links, reflex, coupling])
    assert len(said) == warned
    assert all(
        "of elbow: stribeck_exponent is assumed to be 2, as where nothing shows it" in line
        for line in said
    )


def test_a_load_beside_a_declared_one_has_parameters_of_its_own() -> None:
    """The declared one hangs on the line of its link, somewhere along it."""
    recording = rich_recording()
    joint, rows = unfitted(recording, ELBOW), select_rows(recording, (0,))
    place = dict.fromkeys(PLACE, 0.1)
    declared, found = (
        Term(
            effect=effect,
            joint=ELBOW,
            columns=effect.columns(joint, theta),
            theta=theta,
            kept=(0,),
            candidate=candidate,
        )
        for effect, theta, candidate in (
            (BY_NAME["payload"], {"distance": 1.0}, None),
            (PLACED, place, Candidate(effect=PLACED, joint=ELBOW)),
        )
    )
    model = Model(recording, terms=(declared, found))
    coefficients = evaluate(model, rows).coefficients
    fits = leave_out(model, rows, coefficients)
    assert "mass" in parameters_of(model, coefficients, fits, found)
    assert "distance" in parameters_of(model, coefficients, fits, declared)


def test_coulomb_friction_is_known_no_better_than_beside_viscous_friction() -> None:
    # One speed, one direction: a constant is the same as 3 Nm s/rad there.
    recording = rich_recording(12)
    velocity = np.abs(recording.velocity) * 0.02 + 0.4
    robot = replace(
        recording,
        velocity=velocity,
        session=replace(recording.session, limb_joints=()),
        joints=(ELBOW,),
        cache={},
    )
    friction = 3.0 + 3.0 * velocity[:, ELBOW]
    effort = np.array(robot.inverse)
    effort[:, ELBOW] += friction + 0.1 * np.random.default_rng(3).standard_normal(len(effort))
    robot = replace(robot, effort=robot.filtered(effort), cache={})
    rows = select_rows(robot, (0,))
    candidate = Candidate(effect=BY_NAME["coulomb_friction"], joint=ELBOW)
    theta = {"smooth": 0.004}
    term = Term(
        effect=candidate.effect,
        joint=ELBOW,
        columns=candidate.effect.columns(unfitted(robot, ELBOW), theta),
        theta=theta,
        kept=(0,),
        lower=(0.0,),
        candidate=candidate,
    )
    model = Model(robot).with_term(term)
    coefficients = evaluate(model, rows).coefficients
    alone = parameters_of(model, coefficients, leave_out(model, rows, coefficients), term)
    low, high = alone["torque"]["ci90"]
    assert low > 4.0
    low, _ = beside_its_like(alone, model, rows, candidate)["torque"]["ci90"]
    assert low <= 3.0 < 4.2 < high


def motor(joint: str, other: int, sense: float) -> dict[str, Any]:
    values = {"torque": 1.9, "other_dof": float(other), "sense": sense}
    parameters = {name: {"value": value, "ci90": [value] * 2} for name, value in values.items()}
    return {"name": "coupled_motor", "joint": joint, "parameters": parameters}


def test_a_motor_of_two_joints_is_one_though_it_stands_at_both() -> None:
    """It read as two motors, each of which rubs."""
    joints = ("base", "pitch", "roll")
    rubs = {"name": "coulomb_friction", "joint": "pitch", "parameters": {}}
    first, second, third = with_places(
        [motor("roll", 1, -1.0), rubs, motor("pitch", 2, -1.0)], joints
    )
    assert first["where"] == "roll" and "same_as" not in first
    assert second == rubs | {"where": "pitch"}
    assert third["where"] == "pitch, the same motor as at roll" and third["same_as"] == "roll"
    assert third["joint"] == "pitch"


def test_motors_of_other_pairs_or_of_the_other_sense_are_others() -> None:
    joints = ("base", "pitch", "roll")
    apart = [motor("roll", 1, -1.0), motor("pitch", 2, 1.0), motor("pitch", 0, -1.0)]
    assert all("same_as" not in entry for entry in with_places(apart, joints))


def test_an_effort_that_is_recorded_late_may_be_filtered() -> None:
    """Two strangers' low-passes of 8 and 10 Hz that nobody declared were negative delays alone."""

    def told(delay: float) -> list[str]:
        return late_efforts([{"joint": "elbow", "parameters": {"delay": {"value": delay}}}])

    (line,) = told(-0.0192)
    assert "elbow was recorded 19.2 ms after" in line and "low-pass of 8.3 Hz" in line
    assert "effort_filter_hz" in line and told(0.0192) == []
