"""Friction that is larger at rest than in motion shows in what a joint holds there."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Model, evaluate, unfitted
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.identification.findings import Grown, Option, Step
from analysis.closeloop.identification.friction.breakaway import (
    _held,
    held_levels,
    level_of,
    with_breakaway,
)
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.moved import moved
from tests.testbed.sessions.rich import ELBOW, rich_elbow

RATE, WAY, REST = 200.0, 1.0, 0.8
#: Nm: of the joint in motion, and of the sensor.
FRICTION, NOISE = 1.0, 0.05
#: Speed at which an excess is lost, rad/s: a hundredth of the top speed, passed in milliseconds.
SLOW = 0.02
COULOMB = BY_NAME["coulomb_friction"]


def to_and_fro(held: tuple[float, float], *, let_go: float = 0.0, beside: float = 0.0) -> Recording:
    """An elbow that goes to and fro, and holds so much to either side at each end, Nm.

    What holds it may let go some time before it leaves, s. A motor may rub beside, Nm, that turns
    with the shoulder, too; that goes with the elbow, half as far again, and every other time
    against it.
    """
    ways = 12
    s = np.linspace(0.0, 1.0, int(RATE * WAY), endpoint=False)
    way = 10 * s**3 - 15 * s**4 + 6 * s**5
    still = np.zeros(int(RATE * REST))
    place = np.concatenate([np.concatenate([way, still + 1, 1 - way, still]) for _ in range(ways)])
    arm = rich_elbow()
    position = np.tile(arm.position[0], (len(place), 1))
    position[:, ELBOW] += 0.8 * (place - 0.5)
    if beside:
        cycle = np.arange(len(place)) // (len(place) // ways)
        position[:, 0] += 1.2 * place * np.where(cycle % 2, -1.0, 1.0)
    arm = moved(arm, position, RATE)
    speed = arm.velocity[:, ELBOW]
    excess = max(min(held) - beside - FRICTION, 0.0) * np.exp(-((speed / SLOW) ** 2))
    friction = (FRICTION + excess) * np.tanh(speed / 0.005)
    friction += beside * np.tanh((speed + arm.velocity[:, 0]) / 0.005)
    rest = arm.resting(ELBOW, arm.slices[0])
    # It comes to rest in one direction, and its motor has turned before it leaves in the other.
    after = np.arange(len(place)) % int(RATE * (WAY + REST)) < int(RATE * (WAY + REST / 2))
    forward = (place > 0.5) == after
    friction[rest] = np.where(forward, held[0], -held[1])[rest]
    last = np.flatnonzero(rest & ~np.roll(rest, -1))
    for end in last:
        gone = slice(end + 1 - round(let_go * RATE), end + 1)
        friction[gone] = np.clip(friction[gone], -0.9 * FRICTION, 0.9 * FRICTION)
    effort = np.array(arm.inverse)
    effort[:, ELBOW] += friction
    effort[:, ELBOW] += NOISE * np.random.default_rng(2).standard_normal(len(effort))
    raw = {"elbow.effort": effort[:, ELBOW]}
    trial = replace(arm.session.trials[0], time=arm.time, columns=raw)
    session = replace(arm.session, trials=(trial,))
    return replace(arm, session=session, effort=arm.filtered(effort), cache={})


def coulomb(arm: Recording) -> Term:
    """Coulomb friction as it is named."""
    candidate, theta = Candidate(effect=COULOMB, joint=ELBOW), {"smooth": 0.004}
    return Term(
        effect=COULOMB,
        joint=ELBOW,
        columns=COULOMB.columns(unfitted(arm, ELBOW), theta),
        lower=(0.0,),
        kept=(0,),
        theta=theta,
        candidate=candidate,
    )


def traced(arm: Recording) -> tuple[Grown, tuple[str, ...]]:
    """What becomes of the Coulomb friction that was named."""
    model, rows = Model(arm, terms=(coulomb(arm),)), select_rows(arm, arm.fit_trials)
    score = evaluate(model, rows)
    (candidate,) = model.effects
    option = Option(candidate=candidate, model=model, score=score, gain=1.0, z=9.0)
    step = Step(taken=option, equals=(), options=(), before=1.0)
    return with_breakaway(Grown(model, score, (step,)), rows)


def named(arm: Recording) -> set[str]:
    return {step.key[0] for step in traced(arm)[0].steps}


def test_a_joint_that_holds_more_than_it_slides_with_has_stribeck_friction() -> None:
    grown, notes = traced(to_and_fro((1.8, 1.7)))
    assert {step.key for step in grown.steps} == {("stribeck_friction", ELBOW)}
    torque, excess = grown.score.coefficients
    assert torque == pytest.approx(FRICTION, rel=0.05)
    assert excess > 0.68
    assert "holds 1.7" in notes[0]
    assert grown.steps[0].p_value < 1e-4


@pytest.mark.parametrize(
    ("held", "why"),
    [
        ((0.95, 0.9), "it holds what it slides with"),
        ((1.8, 0.9), "it holds more to one side: that may be a wrong offset"),
        ((1.1, 1.1), "the difference is within the error"),
    ],
)
def test_else_its_friction_stays_what_it_is(held: tuple[float, float], why: str) -> None:
    assert named(to_and_fro(held)) == {"coulomb_friction"}, why


def test_a_brake_that_lets_go_before_the_joint_leaves_is_no_friction() -> None:
    """Leaving takes no more than sliding does, whatever the rest held."""
    assert named(to_and_fro((1.8, 1.7), let_go=0.1)) == {"coulomb_friction"}


def test_a_level_that_rests_hold_alike_to_both_sides_is_friction_however_they_are_left() -> None:
    """A low-pass takes the peak of a start; a brake holds whatever it is given."""
    assert named(to_and_fro((1.7, 1.7), let_go=0.1)) == {"stribeck_friction"}


@pytest.mark.parametrize(
    ("rests", "level"), [([0.9, 1.0, 1.1, 1.8, 1.9], 1.1), ([0.2, 1.0], 0.2), ([1.0], 1.0)]
)
def test_a_level_is_what_several_rests_hold(rests: list[float], level: float) -> None:
    """Of many rests the most is noise, or what somebody held."""
    assert level_of(rests) == level


def test_where_somebody_pushes_it_out_of_each_rest_nothing_tells_what_leaving_takes() -> None:
    arm = to_and_fro((1.8, 1.7))
    rest = arm.resting(ELBOW, arm.slices[0])
    disturbed = np.zeros(arm.position.shape, dtype=bool)
    disturbed[:, ELBOW] = rest & ~np.roll(rest, -round(0.2 * RATE))
    assert named(replace(arm, disturbed=disturbed)) == {"coulomb_friction"}


@pytest.mark.parametrize("excess", [0.0, 0.8])
def test_a_motor_of_two_joints_holds_the_joint_too(excess: float) -> None:
    """Of an opponent's 21 arms with one, five had Stribeck friction that was not there."""
    held = (FRICTION + 0.7 + excess, FRICTION + 0.65 + excess)
    arm = to_and_fro(held, beside=0.7)
    motor, theta = BY_NAME["coupled_motor"], {"other_dof": 0.0, "sense": 1.0, "smooth": 0.004}
    columns = motor.columns(unfitted(arm, ELBOW), theta)
    term = Term(effect=motor, joint=ELBOW, columns=columns, lower=(0.0,), kept=(0,), theta=theta)
    model, rows = Model(arm, terms=(coulomb(arm), term)), select_rows(arm, arm.fit_trials)
    score = evaluate(model, rows)
    assert score.coefficients == pytest.approx([FRICTION, 0.7], rel=0.1)
    found = _held(Grown(model, score, ()), rows, ELBOW)
    assert (found is not None) == (excess > 0.0)
    assert found is None or found.level - found.sliding == pytest.approx(excess, rel=0.05)


def test_what_somebody_pushed_is_no_breakaway() -> None:
    arm = to_and_fro((1.8, 1.7))
    disturbed = np.zeros(arm.position.shape, dtype=bool)
    disturbed[arm.resting(ELBOW, arm.slices[0]), ELBOW] = True
    assert named(replace(arm, disturbed=disturbed)) == {"coulomb_friction"}


def test_beside_declared_coulomb_friction_the_excess_alone_is_named() -> None:
    arm = to_and_fro((1.8, 1.7))
    term = replace(coulomb(arm), candidate=None)
    model, rows = Model(arm, terms=(term,)), select_rows(arm, arm.fit_trials)
    grown, _ = with_breakaway(Grown(model, evaluate(model, rows)), rows)
    assert {step.key for step in grown.steps} == {("stribeck_friction", ELBOW)}
    assert [term.kept for term in grown.model.terms] == [(0,), (1,)]
    assert grown.steps[0].p_value < 1e-4


def test_a_peak_is_not_held() -> None:
    torque = np.zeros(100)
    torque[50] = 5.0
    assert held_levels(torque, 20) == pytest.approx((0.25, 0.0))
    assert held_levels(torque, 101) == (-np.inf, -np.inf)
