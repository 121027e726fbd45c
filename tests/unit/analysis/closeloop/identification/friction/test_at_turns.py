"""In quick motion friction that is larger when slow shows where a joint turns around."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Model, evaluate, prediction, unfitted
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.identification.findings import Grown, Option, Step
from analysis.closeloop.identification.friction.at_turns import with_peak_at_turns, with_turns
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.rich import ELBOW, rich_recording

#: Nm: of friction in motion, of what there is more of it when slow, and of the sensor.
FRICTION, EXCESS, NOISE = 1.0, 0.6, 0.02
#: Way over which bristles bend, rad, and speed at which the excess is lost, rad/s.
WAY, SPEED = 8e-4, 0.08


@pytest.fixture(scope="module")
def arm() -> Recording:
    return rich_recording(30)


def rubbed(
    arm: Recording,
    excess: float,
    *,
    ways: tuple[float, ...] = (WAY,),
    late: float = 0.0,
    smoothed: float = 0.0,
    damping: float = 0.0,
    power: float = 2.0,
    stiff: bool = False,
) -> Recording:
    """The arm with friction of bristles at its elbow, which may be larger when slow, Nm.

    They may be of several ways or of constant stiffness and turn late, s, and smoothing may have
    taken an inertia's torque where the acceleration is largest, kg m2. The joint may be damped,
    too, Nm s/rad. The excess falls by a power of the speed.
    """
    joint = unfitted(arm, ELBOW)
    slow = np.exp(-(np.abs(joint.velocity / SPEED) ** power))
    bent = np.mean([joint.wound(way) for way in ways], axis=0)
    if stiff:
        bent = joint.bent(WAY, 1.0 + excess / FRICTION * slow)
    effort = np.array(arm.inverse)
    effort[:, [ELBOW]] += arm.shifted(((FRICTION + excess * slow) * bent)[:, None], -late)
    effort[:, ELBOW] += smoothed * slow * joint.acceleration + damping * joint.velocity
    effort += NOISE * np.random.default_rng(4).standard_normal(effort.shape)
    return replace(arm, effort=arm.filtered(effort), cache={})


def quick(rows: Rows) -> Rows:
    """The rows without those about a turn, where nobody knows what friction is."""
    kept = np.ones(len(rows.weight), dtype=bool)
    for joint, part in rows.parts.items():
        speed = np.abs(rows.recording.velocity[rows.samples[joint], joint])
        kept[part] = speed > 3.0 * SPEED
    return rows.where(kept)


def traced(
    arm: Recording, name: str = "coulomb_friction", **theta: float
) -> tuple[Grown, Rows, tuple[str, ...]]:
    """What becomes of a law of friction that was named from the rows of quick motion."""
    every = select_rows(arm, arm.fit_trials).reweighted({0: NOISE, ELBOW: NOISE})
    rows = quick(every)
    candidate = Candidate(effect=BY_NAME[name], joint=ELBOW)
    columns = candidate.effect.columns(unfitted(arm, ELBOW), {"smooth": 0.004, **theta})
    term = Term(
        effect=candidate.effect,
        joint=ELBOW,
        columns=columns,
        lower=candidate.effect.lower,
        theta={"smooth": 0.004, **theta},
        kept=tuple(range(columns[ELBOW].shape[1])),
        candidate=candidate,
    )
    model = Model(arm).with_term(term)
    score = evaluate(model, rows)
    option = Option(candidate=candidate, model=model, score=score, gain=1.0, z=9.0)
    step = Step(taken=option, equals=(), options=(), before=score.loss + 1.0)
    return with_peak_at_turns(Grown(model, score, (step,)), rows, every)


def test_an_excess_that_only_turns_show_is_stribeck_friction_of_its_size(arm: Recording) -> None:
    grown, rows, notes = traced(rubbed(arm, EXCESS))
    assert [step.key for step in grown.steps] == [("stribeck_friction", ELBOW)]
    assert grown.steps[0].p_value < 1e-4
    term = next(t for t in grown.model.terms if t.candidate is not None)
    assert grown.score.coefficients[:2] == pytest.approx([FRICTION, EXCESS], rel=0.05)
    found = BY_NAME["stribeck_friction"].fixed(unfitted(arm, ELBOW), term.theta)
    assert found["stribeck_velocity"] == pytest.approx(SPEED, rel=0.03)
    assert "where it turns, friction winds up over 0.00079 rad" in notes[0]
    assert grown.score.loss == pytest.approx(evaluate(grown.model, rows).loss)


@pytest.mark.parametrize("power", [2.0, 0.5])
def test_bristles_of_constant_stiffness_have_the_excess_of_the_power_that_it_falls_by(
    arm: Recording, power: float
) -> None:
    grown, _, _ = traced(rubbed(arm, EXCESS, power=power, stiff=True))
    term = next(t for t in grown.model.terms if t.candidate is not None)
    assert grown.score.coefficients[:2] == pytest.approx([FRICTION, EXCESS], rel=0.1)
    assert term.theta["power"] == pytest.approx(power, rel=0.1)
    assert term.theta["way"] == pytest.approx(WAY, rel=0.1)


def test_a_law_that_quick_motion_showed_is_known_better_by_the_turns(arm: Recording) -> None:
    found = {"speed": 0.3, "power": 2.0}
    grown, _, notes = traced(rubbed(arm, EXCESS), "stribeck_friction", **found)
    assert [step.key for step in grown.steps] == [("stribeck_friction", ELBOW)]
    assert grown.score.coefficients[:2] == pytest.approx([FRICTION, EXCESS], rel=0.05)
    assert len(notes) == 1


def test_a_law_that_turns_as_the_joint_does_stays_as_it_was_found(arm: Recording) -> None:
    """An opponent's friction that winds up over nothing: bristles doubled what turns left of it."""
    speed = SPEED / float(arm.top_speed[ELBOW])
    loud = rubbed(arm, EXCESS, ways=(1e-6,))
    grown, _, notes = traced(loud, "stribeck_friction", speed=speed, power=2.0)
    assert [step.key for step in grown.steps] == [("stribeck_friction", ELBOW)]
    assert not notes


def test_damping_that_a_level_between_slow_and_fast_hid_is_found_beside_it(arm: Recording) -> None:
    grown, _, _ = traced(rubbed(arm, EXCESS, damping=0.1))
    names = [candidate.effect.name for candidate in grown.model.effects]
    assert (
        names == [step.key[0] for step in grown.steps] == ["stribeck_friction", "viscous_friction"]
    )
    sizes = {
        t.candidate.effect.name: own
        for t, own in grown.model.split(grown.score.coefficients)
        if t.candidate
    }
    assert sizes["viscous_friction"] == pytest.approx([0.1], rel=0.1)
    assert sizes["stribeck_friction"] == pytest.approx([FRICTION, EXCESS], rel=0.1)


def test_what_it_is_fitted_beside_predicts_the_turns_themselves(arm: Recording) -> None:
    loud = rubbed(arm, EXCESS)
    grown, rows, _ = traced(loud)
    expected = loud.filtered(prediction(grown.model, grown.score.coefficients)[:, [ELBOW]])
    samples = rows.samples[ELBOW]
    assert len(samples) == len(select_rows(loud, loud.fit_trials).samples[ELBOW])
    left = loud.effort[samples, ELBOW] - expected[samples, 0]
    turning = np.abs(loud.velocity[samples, ELBOW]) < SPEED
    assert np.sqrt(np.mean(left[turning] ** 2)) < 2.0 * NOISE


@pytest.mark.parametrize(
    ("ways", "late", "smoothed", "why"),
    [
        ((WAY,), 0.0, 0.0, "bristles bend, and that is all"),
        ((0.25 * WAY, 4.0 * WAY), 0.0, 0.0, "some bend further than others"),
        ((WAY,), 0.001, 0.0, "what comes late by less than a sample is no bristle's form"),
        ((2.0 * WAY,), 0.005, 0.0, "what comes late winds up, and what slides has no excess"),
        ((WAY,), 0.01, 0.0, "what comes late is larger after a turn, not before it"),
        ((WAY,), 0.0, 0.1, "what smoothing takes of an acceleration is less before a turn"),
    ],
)
def test_else_friction_stays_what_it_is_and_no_row_comes_back(
    arm: Recording, ways: tuple[float, ...], late: float, smoothed: float, why: str
) -> None:
    grown, rows, notes = traced(rubbed(arm, 0.0, ways=ways, late=late, smoothed=smoothed))
    assert [c.key for c in grown.model.effects] == [("coulomb_friction", ELBOW)], why
    assert not notes
    assert len(rows.weight) == len(quick(select_rows(arm, arm.fit_trials)).weight)


def test_a_richer_law_that_was_found_is_left_alone(arm: Recording) -> None:
    grown, _, notes = traced(rubbed(arm, EXCESS), "asymmetric_friction", viscous=0.0)
    assert [c.key for c in grown.model.effects] == [("asymmetric_friction", ELBOW)]
    assert not notes


def test_of_other_joints_rows_stay_left_out(arm: Recording) -> None:
    every = select_rows(arm, arm.fit_trials)
    rows = quick(every)
    shown = with_turns(rows, every, [ELBOW])
    assert shown.samples[ELBOW].tolist() == every.samples[ELBOW].tolist()
    assert shown.samples[0].tolist() == rows.samples[0].tolist()
