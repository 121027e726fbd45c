"""A wrong zero, and a wrong motor constant, before what imitates them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.closeloop.identification.arms.gains import with_gains
from analysis.closeloop.identification.arms.links import last_links, links_of
from analysis.closeloop.identification.arms.robot import (
    pruned,
    traced_robot,
    weighed,
    with_ordinary,
)
from analysis.closeloop.identification.arms.shared import with_links
from analysis.closeloop.identification.arms.whole_fit import WholeFit
from analysis.closeloop.identification.arms.zeros import (
    IMITATE,
    for_links,
    for_offsets,
    for_rare,
    with_zeros,
)
from analysis.closeloop.identification.balance.declared import placed
from analysis.closeloop.identification.balance.model import (
    Model,
    evaluate,
    unfitted,
    with_independent,
)
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.session.chain.link_torque import chain_motion
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from sim.effects.rigid import point_mass
from tests.testbed.sessions.moved import moved
from tests.testbed.sessions.rich import ELBOW, rich_recording
from tests.testbed.sessions.upright import joint_by_joint

ZERO = "position_offset"
SHOULDER = 0


def arm_of(effort: np.ndarray, still: Recording) -> Recording:
    noise = 0.02 * np.random.default_rng(5).standard_normal(effort.shape)
    return replace(still, effort=still.filtered(effort + noise), cache={})


@pytest.mark.parametrize("offset", [0.0, 0.1])
def test_a_wrong_zero_is_asked_of_all_joints_at_once_and_only_if_there_is_one(
    offset: float,
) -> None:
    """The shoulder carries what hangs at the elbow, so both say where the forearm is."""
    still = rich_recording(20)
    effort = np.array(still.inverse)
    if offset:
        effort -= offset * still.secant(ELBOW, -offset)
    arm = arm_of(effort, still)
    rows = select_rows(arm, (0,))
    model = with_zeros(with_ordinary(Model(arm), rows), rows, links_of(arm))
    zeros = [term for term in model.terms if term.candidate and term.candidate.key[0] == ZERO]
    assert [term.joint for term in zeros] == ([ELBOW] if offset else [])
    assert all(set(term.columns) == set(arm.joints) for term in zeros)
    assert all(term.theta["offset"] == pytest.approx(offset, rel=0.1) for term in zeros)


def test_no_zero_is_sought_beyond_where_it_can_be() -> None:
    """Gauss-Newton went to where its torque is rounding, and an opponent's UR10 had 1e15 rad."""
    still = rich_recording(20)
    arm = arm_of(still.inverse - 20.0 * still.secant(SHOULDER, -0.1), still)
    rows = select_rows(arm, (0,))
    zero = Candidate(effect=BY_NAME[ZERO], joint=SHOULDER)
    theta = {"offset": 0.1}
    columns = zero.effect.columns(unfitted(arm, SHOULDER), theta)
    term = Term(effect=zero.effect, joint=SHOULDER, columns=columns, theta=theta, candidate=zero)
    model = placed(with_independent(Model(arm), term, rows), rows)
    assert model.terms[0].theta["offset"] == pytest.approx(np.pi / 2)


def test_a_zero_goes_that_only_stood_for_a_centre_of_mass() -> None:
    """It is asked for first, and links that are fitted anew without it predict as well."""
    still = rich_recording(20)
    links = [-0.4 * still.mass_torque(joint, np.array([0.1, 0.0, -0.15])) for joint in still.joints]
    arm = arm_of(still.inverse + sum(links), still)
    rows = weighed(Model(arm), select_rows(arm, (0,)))
    model = with_zeros(with_ordinary(Model(arm), rows), rows, links_of(arm))
    assert (ZERO, ELBOW) in {candidate.key for candidate in model.effects}
    free = WholeFit(model, rows, links_of(arm)).with_links(range(len(model.terms)))
    left = pruned(with_links(model, links_of(arm), free.links), rows, links_of(arm))
    assert {candidate.effect.name for candidate in left.effects} == {"link_inertia"}


def test_a_gain_stands_for_the_inertia_and_friction_that_do_the_same_together() -> None:
    still = rich_recording(20)
    still.device.model.dof_damping[ELBOW] = 0.5
    effort = np.array(still.inverse)
    effort[:, ELBOW] *= 1.2
    arm = arm_of(effort, still)
    rows = select_rows(arm, (0,))
    model = with_gains(with_ordinary(Model(arm), rows), rows)
    own = {candidate.effect.name for candidate in model.effects if candidate.joint == ELBOW}
    assert own == {"torque_gain"}


@pytest.mark.parametrize(("gravity", "said"), [(0.0, {"torque_gain"}), (-9.81, set())])
def test_without_gravity_more_inertia_may_as_well_be_a_gain(gravity: float, said: set[str]) -> None:
    rich = rich_recording()
    rich.device.spec.option.gravity = [0.0, 0.0, gravity]
    time = np.arange(6000) / 200.0
    swings = 0.4 * np.sin(2.0 * np.pi * 0.7 * time) * np.sin(2.0 * np.pi * 0.05 * time)
    still = moved(rich, np.column_stack([0.0 * time, 1.0 + swings]), 200.0)
    effort = np.array(still.inverse)
    effort[:, ELBOW] += 0.02 * still.acceleration[:, ELBOW]
    arm = arm_of(effort, still)
    rows = select_rows(arm, (0,))
    found = traced_robot(Model(arm), weighed(Model(arm), rows), lambda _: None)
    (step,) = found.steps
    assert step.key == ("added_inertia", ELBOW)
    assert {other.candidate.effect.name for other in step.equals} == said


def test_inertia_that_a_motor_has_is_no_gain() -> None:
    still = rich_recording(20)
    effort = np.array(still.inverse)
    effort[:, ELBOW] += 0.05 * still.acceleration[:, ELBOW]
    arm = arm_of(effort, still)
    rows = select_rows(arm, (0,))
    found = traced_robot(Model(arm), weighed(Model(arm), rows), lambda _: None)
    assert {step.key for step in found.steps} == {("added_inertia", ELBOW)}


@pytest.mark.parametrize("zero", [0.03, 0.1])
def test_a_zero_stands_for_the_offset_and_inertia_that_it_is_where_each_trial_moves_one_joint(
    zero: float, tmp_path: Path
) -> None:
    arm = joint_by_joint(tmp_path, zero=zero)
    rows = weighed(Model(arm), select_rows(arm, arm.fit_trials))
    imitated = pruned(with_ordinary(Model(arm), rows), rows, links_of(arm))
    assert {c.effect.name for c in imitated.effects} <= set(IMITATE)
    found = for_offsets(imitated, rows)
    assert [(c.effect.name, arm.name(c.joint)) for c in found.effects] == [(ZERO, "bend")]
    assert evaluate(found, rows).coefficients == pytest.approx([zero], rel=0.1)


def test_offsets_that_no_zero_explains_stay(tmp_path: Path) -> None:
    arm = joint_by_joint(tmp_path)
    arm = replace(arm, effort=arm.effort + np.array([0.3, -0.2, 0.25]), cache={})
    rows = weighed(Model(arm), select_rows(arm, arm.fit_trials))
    offsets = pruned(with_ordinary(Model(arm), rows), rows, links_of(arm))
    assert for_offsets(offsets, rows) is offsets and len(offsets.effects) == 3


@pytest.mark.parametrize("slack", [False, True])
def test_a_zero_stands_for_what_is_rare_at_one_joint_if_all_go_better_with_it(slack: bool) -> None:
    """It may be too little for a name; backlash of the joint that shows it most stood for it."""
    still = rich_recording(20)
    effort, offset = np.array(still.inverse), 0.1
    backlash, joint = BY_NAME["backlash"], unfitted(still, ELBOW)
    theta = backlash.thetas(joint)[-1]
    if slack:
        effort[:, [ELBOW]] += 0.1 * backlash.columns(joint, theta)[ELBOW]
    else:
        effort -= offset * still.secant(ELBOW, -offset)
    arm = arm_of(effort, still)
    rows = weighed(Model(arm), select_rows(arm, (0,)))
    rare = Candidate(effect=backlash, joint=ELBOW)
    columns = backlash.columns(unfitted(arm, ELBOW), theta)
    term = Term(effect=backlash, joint=ELBOW, columns=columns, theta=theta, candidate=rare)
    found = with_independent(with_ordinary(Model(arm), rows), term, rows)
    model = for_rare(found, rows, [rare.key])
    zeros = {candidate.joint for candidate in model.effects if candidate.effect.name == ZERO}
    assert zeros == (set() if slack else {ELBOW}) and (rare in model.effects) == slack
    # What was there before, or declared, is not in question.
    assert for_rare(found, rows, []) is found


@pytest.mark.parametrize(("at", "both"), [(SHOULDER, True), (ELBOW, False), (None, False)])
def test_a_payload_and_a_wrong_zero_stand_for_links_that_do_what_both_do(
    at: int | None, both: bool
) -> None:
    """Neither explains much while the other is missing, and ten parameters a link do most.

    The last joint's zero turns what hangs there and nothing else: that is other links.
    """
    still = rich_recording(20)
    effort, zero, place = np.array(still.inverse), 0.08, np.array([0.15, 0.0, 0.05])
    if at == ELBOW:
        zero = 0.2
    if at is not None:
        (body,) = last_links(still)
        there = still.position.copy()
        there[:, at] -= zero
        hung = chain_motion(still.device.model, there, still.velocity, still.acceleration)
        effort += 0.5 * (hung.link_torque(body) @ point_mass(place))
        effort -= zero * still.secant(at, -zero)
    else:
        away = np.array([0.1, 0.0, -0.15])
        effort += sum(0.4 * still.mass_torque(joint, away) for joint in still.joints)
    arm = arm_of(effort, still)
    rows, links = weighed(Model(arm), select_rows(arm, (0,))), links_of(arm)
    plain = with_ordinary(Model(arm), rows)
    free = WholeFit(plain, rows, links).with_links(range(len(plain.terms)))
    model = for_links(with_links(plain, links, free.links), rows, links)
    added = [t for t in model.terms if t.candidate and t.candidate not in plain.effects]
    terms = {t.at.key: t for t in added}
    assert (model.given is None) == both
    assert set(terms) == ({("payload", ELBOW), (ZERO, SHOULDER)} if both else set())
    if both:
        # The secant is over the zero itself, and the load is where it hangs.
        assert terms[ZERO, SHOULDER].theta["offset"] == pytest.approx(zero, rel=0.05)
        assert terms["payload", ELBOW].theta["position_x"] == pytest.approx(0.15, abs=0.002)


def test_a_zero_that_looks_like_an_offset_is_found_beside_a_spring(tmp_path: Path) -> None:
    """Before the spring is known the zero predicts no better than an offset, nor than links."""
    arm = joint_by_joint(tmp_path, zero=0.02)
    spring = np.zeros_like(arm.effort)
    spring[:, 1] = 8.0 * (arm.position[:, 1] - 0.2)
    arm = replace(arm, effort=arm.effort + spring, cache={})
    rows = weighed(Model(arm), select_rows(arm, arm.fit_trials))
    found = traced_robot(Model(arm), rows, lambda _: None)
    names = {(step.key[0], arm.name(step.key[1])) for step in found.steps}
    assert names == {("joint_stiffness", "lift"), (ZERO, "bend")}
