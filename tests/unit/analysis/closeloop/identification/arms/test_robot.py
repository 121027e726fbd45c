"""Robots of several joints: what every joint may have, beside what is rare."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.closeloop.identification.arms import robot
from analysis.closeloop.identification.arms.links import links_of
from analysis.closeloop.identification.arms.ordinary import with_ordinary
from analysis.closeloop.identification.arms.shared import with_links
from analysis.closeloop.identification.arms.whole_fit import WholeFit
from analysis.closeloop.identification.balance.declared import declared_model
from analysis.closeloop.identification.balance.model import Model, evaluate, unfitted
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.identification.findings import Grown
from analysis.closeloop.session.contents import DeclaredEffect
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME, LINK_INERTIA
from sim.effects.motion import PRESLIDING_SHARE
from tests.testbed.sessions.coupled import measured, moving, traced
from tests.testbed.sessions.moved import moved
from tests.testbed.sessions.rich import ELBOW, rich_recording
from tests.testbed.sessions.upright import all_at_once


def test_damping_that_a_ripple_hides_is_found_beside_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of what the ripple leaves it takes nearly all, of what is there before a thousandth."""

    def ripple(recording: Recording) -> list[Candidate]:
        effect = BY_NAME["torque_ripple"]
        return [Candidate(effect=effect, joint=joint) for joint in recording.joints]

    monkeypatch.setattr(robot, "candidates", ripple)
    still = rich_recording(20)
    effort = np.array(still.inverse)
    effort[:, ELBOW] += np.sin(22.0 * still.position[:, ELBOW]) + 0.05 * still.velocity[:, ELBOW]
    effort += 0.002 * np.random.default_rng(5).standard_normal(effort.shape)
    arm = replace(still, effort=still.filtered(effort), cache={})
    rows = select_rows(arm, (0,))
    told: list[str] = []
    found = robot.traced_robot(Model(arm), robot.weighed(Model(arm), rows), told.append)
    of_joints = [line for line in told if "what else" in line]
    assert "(joint 1 of " in of_joints[0] and len(of_joints) >= len(rows.joints)
    assert {step.key for step in found.steps} == {
        ("torque_ripple", ELBOW),
        ("viscous_friction", ELBOW),
    }


@pytest.mark.parametrize("viscous", [0.3, 0.0])
def test_friction_is_asked_for_again_where_something_fell_that_stood_for_it(viscous: float) -> None:
    """With a Sawyer's wrong zero the viscous friction of a joint had gone, and 1.4 Nm were left."""
    still = moving()
    arm = measured(still, still.inverse + viscous * still.velocity * [0.0, 1.0, 0.0])
    rows = robot.weighed(Model(arm), select_rows(arm, (0,)))
    bare = Grown(Model(arm), evaluate(Model(arm), rows))
    found = robot.with_ordinary_again(bare, rows)
    assert [step.key for step in found.steps] == [("viscous_friction", 1)] * (viscous > 0.0)
    assert (found is bare) == (viscous == 0.0)


@pytest.mark.parametrize("seed", [29, 32, 37])
def test_friction_that_the_joints_together_show_stays(tmp_path: Path, seed: int) -> None:
    """Links that are free take the place of one joint's friction, at the cost of the others."""
    arm = all_at_once(tmp_path, seed)
    rows, links = robot.weighed(Model(arm), select_rows(arm, arm.fit_trials)), links_of(arm)
    model = with_ordinary(Model(arm), rows)
    found = WholeFit(model, rows, links).with_links(range(len(model.terms)))
    kept = robot.pruned(with_links(model, links, found.links), rows, links).effects
    names = ("viscous_friction", "coulomb_friction", "added_inertia")
    true = {(name, joint) for name in names for joint in range(3)}
    own = {candidate.key for candidate in kept} - {(LINK_INERTIA, 0)}
    assert own <= true and len(own) >= len(true) - 1


def test_damping_that_is_small_beside_the_weight_stays_where_nothing_else_is_left() -> None:
    still = rich_recording(20)
    effort = np.array(still.inverse)
    effort[:, ELBOW] += 0.005 * still.velocity[:, ELBOW]
    effort += 0.001 * np.random.default_rng(5).standard_normal(effort.shape)
    arm = replace(still, effort=still.filtered(effort), cache={})
    rows = robot.weighed(Model(arm), select_rows(arm, (0,)))
    model = robot.pruned(with_ordinary(Model(arm), rows), rows, links_of(arm))
    assert [candidate.key for candidate in model.effects] == [("viscous_friction", ELBOW)]


@pytest.mark.parametrize(
    ("level", "found", "like"),
    [(1.5, "coulomb_friction", ["torque_offset"]), (-1.5, "torque_offset", [])],
)
def test_of_a_joint_that_moves_one_way_friction_is_asked_and_not_the_offset_it_looks_like(
    level: float, found: str, like: list[str]
) -> None:
    # What drives a joint in the direction of its motion is no friction.
    rich = rich_recording(20)
    slow = np.linspace(-0.5, 0.5, len(rich.time))[:, None] + 0.002 * rich.position
    arm = replace(moved(rich, slow, 200.0), joints=(0, ELBOW), cache={})
    effort = np.array(arm.inverse)
    effort[:, ELBOW] += level
    effort += 0.02 * np.random.default_rng(5).standard_normal(effort.shape)
    arm = replace(arm, effort=arm.filtered(effort), cache={})
    rows = robot.weighed(Model(arm), select_rows(arm, (0,)))
    (step,) = robot.traced_robot(Model(arm), rows, lambda _: None).steps
    assert step.key == (found, ELBOW)
    assert [option.candidate.effect.name for option in step.equals] == like


def test_beside_declared_damping_friction_may_be_less_and_inertia_may_not() -> None:
    """Where a motion has one frequency, inertia that is taken away is a spring."""
    arm = rich_recording()
    arm.device.model.dof_damping[ELBOW] = 0.5
    model = with_ordinary(Model(arm), select_rows(arm, (0,)))
    own = [term for term in model.terms if term.joint == ELBOW and term.effect is not None]
    assert {term.effect.name: term.lower[0] for term in own if term.effect is not None} == {
        "torque_offset": -np.inf,
        "viscous_friction": -0.5,
        "coulomb_friction": 0.0,
        "added_inertia": 0.0,
    }


def test_declared_coulomb_friction_takes_in_no_viscous_friction() -> None:
    """Before viscous friction is there, one that turns slowly fits better than one at once."""
    still = rich_recording(20)
    speed = still.velocity[:, ELBOW]
    effort = np.array(still.inverse)
    effort[:, ELBOW] += 3.2 * np.tanh(speed / 0.02) + 2.0 * speed
    effort += 0.002 * np.random.default_rng(5).standard_normal(effort.shape)
    declared = (DeclaredEffect(effect="coulomb_friction", joint=still.name(ELBOW)),)
    session = replace(still.session, declared=declared)
    arm = replace(still, session=session, effort=still.filtered(effort), cache={})
    rows = select_rows(arm, (0,))
    model = declared_model(arm, rows)
    found = robot.traced_robot(model, robot.weighed(model, rows), lambda _: None)
    assert {step.key for step in found.steps} == {("viscous_friction", ELBOW)}
    ((_, own),) = (
        pair for pair in found.model.split(found.score.coefficients) if pair[0].candidate is None
    )
    assert own == pytest.approx([3.2], rel=0.03)


def test_what_is_part_of_an_effect_that_is_there_is_not_added_again() -> None:
    arm = rich_recording()
    asymmetric, theta = BY_NAME["asymmetric_friction"], {"smooth": 0.02, "viscous": 1.0}
    term = Term(
        joint=ELBOW,
        columns=asymmetric.columns(unfitted(arm, ELBOW), theta),
        lower=asymmetric.lower,
        kept=(0, 1, 2, 3),
        theta=theta,
        effect=asymmetric,
        candidate=Candidate(effect=asymmetric, joint=ELBOW),
    )
    model = with_ordinary(Model(arm, terms=(term,)), select_rows(arm, (0,)))
    own = {candidate.effect.name for candidate in model.effects if candidate.joint == ELBOW}
    assert own == {"asymmetric_friction", "torque_offset", "added_inertia"}


@pytest.mark.parametrize("offset", [0.04, 0.1])
def test_an_offset_that_hysteresis_hid_is_an_offset_and_no_spring(offset: float) -> None:
    """Before the hysteresis is found it is too little to matter, and a spring has one in it."""
    still = moving()
    needed = np.array(still.inverse)
    wound = unfitted(still, 1).wound(0.12)
    needed[:, 1] += 0.8 * wound + offset
    assert set(traced(measured(still, needed))) == {("hysteresis", 1), ("torque_offset", 1)}


def test_friction_that_goes_with_the_load_is_found_where_its_turns_hide_it() -> None:
    """It winds up over a way at every reversal: nearly all that Coulomb friction leaves is that."""
    still = rich_recording(20)
    joint = unfitted(still, ELBOW)
    level = 3.0 + 0.06 * np.abs(still.inverse[:, ELBOW])
    effort = np.array(still.inverse)
    effort[:, ELBOW] += level * joint.wound(PRESLIDING_SHARE * joint.travel[1], 1.0)
    effort += 0.01 * np.random.default_rng(5).standard_normal(effort.shape)
    arm = replace(still, effort=still.filtered(effort), cache={})
    rows = robot.weighed(Model(arm), select_rows(arm, (0,)))
    found = robot.traced_robot(Model(arm), rows, lambda _: None)
    keys = {step.key for step in found.steps}
    assert ("load_dependent_friction", ELBOW) in keys and ("coulomb_friction", ELBOW) not in keys
