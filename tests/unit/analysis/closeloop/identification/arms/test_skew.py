"""A log whose efforts are some time before or after its positions, at all joints alike."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from analysis.closeloop.identification.arms.skew import (
    agreed_time,
    later,
    synchronised,
    synchronised_limb,
)
from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.balance.terms import Candidate, Channel
from analysis.closeloop.identification.explainable import explainable
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.rich import ELBOW, rich_elbow, rich_recording

MS = 1e-3


def logged(times: tuple[float, float], noise: float = 0.002) -> Recording:
    """Both joints of the arm, whose efforts are logged so much before their positions, s."""
    arm = replace(rich_recording(20), session=replace(rich_recording().session, limb_joints=()))
    effort = np.column_stack([later(arm, own).inverse[:, at] for at, own in enumerate(times)])
    effort += noise * np.random.default_rng(4).standard_normal(effort.shape)
    return replace(arm, effort=arm.filtered(effort), cache={})


@pytest.mark.parametrize("time", [1.0 * MS, -0.5 * MS])
def test_efforts_that_are_logged_at_another_time_are_compared_with_the_motion_then(
    time: float,
) -> None:
    arm = logged((time, time))
    there, said = synchronised(arm)
    truth = later(arm, time)
    moved = there.position[:, ELBOW] - arm.position[:, ELBOW]
    assert moved == pytest.approx(truth.position[:, ELBOW] - arm.position[:, ELBOW], abs=4e-5)
    assert f"{1e3 * abs(time):.2f} ms {'before' if time > 0 else 'after'}" in said


@pytest.mark.parametrize(
    ("times", "why"),
    [
        ((0.0, 0.0), "nothing is late"),
        ((0.0, 4 * MS), "the drive of one joint is early"),
        ((-4 * MS, 4 * MS), "each goes its own way"),
        ((20 * MS, 20 * MS), "four samples are no log's"),
    ],
)
def test_else_the_recording_stays_as_it_is(times: tuple[float, float], why: str) -> None:
    arm = logged(times)
    assert synchronised(arm) == (arm, ""), why


def test_friction_that_turns_late_does_not_hide_the_time_of_a_log() -> None:
    """A controller takes a while to turn a joint, which sticks meanwhile."""
    arm = logged((1.0 * MS, 1.0 * MS))
    sticks = np.roll(np.sign(arm.velocity), round(0.03 * arm.rate), axis=0)
    rubbing = replace(arm, effort=arm.effort + arm.filtered(2.0 * sticks), cache={})
    there, _ = synchronised(rubbing)
    moved = there.position[:, ELBOW] - arm.position[:, ELBOW]
    truth = later(arm, 1.0 * MS).position[:, ELBOW] - arm.position[:, ELBOW]
    assert moved == pytest.approx(truth, abs=0.15 * np.abs(truth).max())


def limb(time: float, name: str = "", theta: float = 0.0) -> SimpleNamespace:
    """Return what was found of an elbow whose efforts are logged so long before its positions, s.

    Args:
        time: by which they are.
        name: of an effect that was found, none if empty.
        theta: its parameter, s.
    """
    elbow = rich_elbow(20)
    effort = later(elbow, time).inverse
    effort += 0.002 * np.random.default_rng(4).standard_normal(effort.shape)
    elbow = replace(elbow, effort=elbow.filtered(effort), cache={})
    named = [Candidate(effect=BY_NAME[name], joint=ELBOW)] if name else []
    channels = tuple(
        Channel(candidate=one, theta={one.effect.nonlinear[0].name: theta}) for one in named
    )
    rows, model = select_rows(elbow, (0,)), Model(elbow, channels=channels)
    return SimpleNamespace(rows=rows, model=model, explainable_after=explainable(model, rows))


@pytest.mark.parametrize("name", ["", "time_delay", "actuator_lag"])
def test_of_a_limb_it_is_told_beside_what_was_found_and_before_what_nothing_tells_from_it(
    name: str,
) -> None:
    """A command that is held acts later: a Maxwell element and a load were named for that.

    And a delay or lag of a joint was, of 0.6 to 0.9 of a sample (a stranger's).
    """
    time = 4.0 * MS
    found = limb(time, name, time)
    there, said = synchronised_limb(found)  # type: ignore[arg-type]
    elbow = found.rows.recording
    moved, truth = (one.position - elbow.position for one in (there, later(elbow, time)))
    assert moved[:, ELBOW] == pytest.approx(truth[:, ELBOW], abs=2e-4)
    assert "ms before the positions, less than a sample" in said


@pytest.mark.parametrize("samples", [1.0, 1.5, 4.0])
def test_a_delay_of_a_sample_or_more_is_the_joint_s(samples: float) -> None:
    """No log is late by so much, and its time would stand in for it."""
    found = limb(samples * 5.0 * MS, "time_delay", samples * 5.0 * MS)
    assert synchronised_limb(found) == (found.rows.recording, "")  # type: ignore[arg-type]


@pytest.mark.parametrize(("drag", "told"), [(0.0, True), (0.006, False)])
def test_a_limb_s_is_told_if_it_is_most_of_what_is_left_to_explain(drag: float, told: bool) -> None:
    """Of drag that no name explains: 7 ms were allowed for that no log had. (A stranger's.)"""
    elbow = rich_elbow(20)
    velocity, effort = elbow.velocity[:, ELBOW], later(elbow, 1.0 * MS).inverse
    effort[:, ELBOW] += drag * velocity * np.abs(velocity)
    effort += 0.002 * np.random.default_rng(4).standard_normal(effort.shape)
    elbow = replace(elbow, effort=elbow.filtered(effort), cache={})
    rows, model = select_rows(elbow, (0,)), Model(elbow)
    found = SimpleNamespace(rows=rows, model=model, explainable_after=explainable(model, rows))
    assert bool(synchronised_limb(found)[1]) == told  # type: ignore[arg-type]


@pytest.mark.parametrize(("delay", "told"), [(0.0, True), (1.0 * MS, True), (12.0 * MS, False)])
def test_joints_of_a_limb_that_are_late_alike_have_no_delay_of_one_of_them(
    delay: float, told: bool
) -> None:
    """Of less than a sample, one joint had a delay, and the other's reflex took the rest."""
    time = 1.0 * MS
    arm = logged((time, time))
    limbs = replace(arm, session=replace(arm.session, limb_joints=("shoulder", "elbow")), cache={})
    late = Candidate(effect=BY_NAME["time_delay"], joint=ELBOW)
    channels = (Channel(candidate=late, theta={"delay": delay}),) if delay else ()
    model, rows = Model(limbs, channels=channels), select_rows(limbs, (0,))
    there, said = synchronised_limb(SimpleNamespace(rows=rows, model=model))  # type: ignore[arg-type]
    assert bool(said) == told
    if told:
        moved, truth = (one.position - limbs.position for one in (there, later(limbs, time)))
        assert moved[:, ELBOW] == pytest.approx(truth[:, ELBOW], abs=4e-5)


def test_of_a_limb_nothing_is_said_before_its_effects_are_known() -> None:
    """Its one joint agrees with itself: a delay of its drive is no matter of the log."""
    arm = logged((1.0 * MS, 1.0 * MS))
    limb = replace(arm, session=replace(arm.session, limb_joints=("elbow",)))
    assert synchronised(limb)[1] == ""


def test_a_joint_with_a_delay_of_its_own_is_outvoted() -> None:
    time, error = agreed_time(
        MS * np.array([7.1, -0.50, -0.45, -0.60]), MS * np.array([0.1, 0.02, 0.1, 0.06])
    )
    assert time == pytest.approx(-0.51 * MS, abs=0.02 * MS)
    assert error < 0.1 * MS


def test_two_that_do_not_agree_tell_nothing() -> None:
    assert agreed_time(MS * np.array([7.1, -0.5]), MS * np.array([0.1, 0.02]))[1] == np.inf


def test_joints_that_differ_by_more_than_their_errors_make_the_error_larger() -> None:
    times = MS * np.array([0.8, 1.2, 1.0, 1.0])
    (_, alike), (_, apart) = (agreed_time(times, MS * np.full(4, own)) for own in (0.3, 0.05))
    assert alike == pytest.approx(0.15 * MS)
    assert apart > 0.05 / 2 * MS * 3
