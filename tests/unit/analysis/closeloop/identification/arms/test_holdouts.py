"""A repair makes no joint worse on trials that no fit has touched."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.arms.holdouts import not_worse
from analysis.closeloop.identification.balance.model import (
    Model,
    evaluate,
    unfitted,
    with_independent,
)
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.identification.findings import Grown, Option, Step
from analysis.closeloop.session.contents import Trial
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.rich import ELBOW


def halves(recording: Recording, second: float) -> Recording:
    """Return the recording as two trials: an offset of 1 Nm to fit, and `second` held out."""
    offset = np.where(np.arange(1000) < 500, 1.0, second)
    effort = recording.inverse + offset[:, None] * np.array([0.0, 1.0])
    effort = effort + 0.05 * np.random.default_rng(0).standard_normal(effort.shape)
    parts = (slice(0, 500), slice(500, 1000))
    trials = tuple(
        Trial(
            file=f"{role}.csv",
            label=role,
            group=role,
            role=role,
            time=recording.time[part],
            columns={"elbow.effort": effort[part, ELBOW]},
        )
        for role, part in zip(("fit", "holdout"), parts, strict=True)
    )
    return replace(
        recording,
        joints=(ELBOW,),
        effort=recording.filtered(effort),
        slices=list(parts),
        trial=np.repeat([0, 1], 500),
        session=replace(recording.session, trials=trials),
        cache={},
    )


def with_effect(recording: Recording, name: str, **theta: float) -> tuple[Grown, Model, Rows]:
    """Return the model with an effect that the first trial has, the declared one, and rows."""
    rows, declared = select_rows(recording, (0,)), Model(recording)
    candidate = Candidate(effect=BY_NAME[name], joint=ELBOW)
    columns = candidate.effect.columns(unfitted(recording, ELBOW), theta)
    term = Term(effect=candidate.effect, joint=ELBOW, columns=columns, candidate=candidate)
    model = with_independent(declared, term, rows)
    score = evaluate(model, rows)
    option = Option(candidate=candidate, model=model, score=score, gain=1.0, z=9.0)
    step = Step(taken=option, equals=(), options=(), before=2.0)
    return Grown(model, score, (step,)), declared, rows


@pytest.mark.parametrize(("second", "stays"), [(1.0, True), (0.2, False)])
def test_an_effect_stays_only_where_no_held_out_error_grows(
    second: float, stays: bool, recording: Recording
) -> None:
    grown, declared, rows = with_effect(halves(recording, second), "torque_offset")
    found, notes = not_worse(grown, declared, rows)
    assert bool(found.steps) is stays
    assert bool(found.model.effects) is stays
    assert ("torque_offset of elbow is not added" in " ".join(notes)) is not stays


def test_an_effect_is_not_refused_by_ends_where_no_filter_knows_the_motion(
    recording: Recording,
) -> None:
    """A start from a stop is quicker than the low-pass of the positions: its torque is unknown."""
    split = halves(recording, 1.0)
    fit, held = split.session.trials
    jerked = np.array(held.columns["elbow.effort"])
    jerked[: split.edge // 2] -= 40.0
    trials = (fit, replace(held, columns={"elbow.effort": jerked}))
    split = replace(split, session=replace(split.session, trials=trials), cache={})
    found, notes = not_worse(*with_effect(split, "torque_offset"))
    assert found.steps and not notes


def test_friction_stays_though_nobody_knows_what_it_is_at_rest(recording: Recording) -> None:
    velocity = np.array(recording.velocity)
    velocity[620:970] = 0.0
    resting = replace(recording, velocity=velocity, cache={})
    split = halves(resting, 0.0)
    # Nothing holds the resting joint, where the model's friction ends over some samples.
    friction = 0.5 * np.tanh(velocity[:, ELBOW] / (0.02 * resting.top_speed[ELBOW]))
    effort = np.full_like(split.effort, np.nan)
    effort[:, ELBOW] = resting.inverse[:, ELBOW] + friction
    effort[620:970, ELBOW] += 0.4
    trials = tuple(
        replace(trial, columns={"elbow.effort": effort[part, ELBOW]})
        for trial, part in zip(split.session.trials, split.slices, strict=True)
    )
    session = replace(split.session, trials=trials)
    split = replace(split, effort=split.filtered(effort), session=session, cache={})
    found, notes = not_worse(*with_effect(split, "coulomb_friction", smooth=0.02))
    assert found.steps and not notes


def test_a_held_joint_refutes_an_offset_and_leaves_the_friction_that_it_looks_like(
    recording: Recording,
) -> None:
    # As the trapezoids of a Kinova Gen3, of which each moves one joint in one direction.
    velocity = np.abs(recording.velocity)
    velocity[500:] = 0.0
    held = replace(recording, velocity=velocity, cache={})
    grown, declared, rows = with_effect(halves(held, 0.0), "torque_offset")
    (step,) = grown.steps
    option = with_effect(rows.recording, "coulomb_friction", smooth=0.004)[0].steps[0].taken
    grown = replace(grown, steps=(replace(step, equals=(option,)),))
    found, notes = not_worse(grown, declared, rows)
    assert [s.key[0] for s in found.steps] == ["coulomb_friction"] and not notes
    assert found.score.coefficients == pytest.approx([1.0], abs=0.1)


@pytest.mark.parametrize(("second", "stays"), [(1.0, True), (-0.6, False)])
def test_without_held_out_trials_groups_that_are_left_out_refuse_an_effect(
    second: float, stays: bool, recording: Recording
) -> None:
    split = halves(recording, second)
    trials = tuple(replace(trial, role="fit") for trial in split.session.trials)
    session = replace(split.session, trials=trials)
    fitted = replace(split, session=session, fit_trials=(0, 1), cache={})
    grown, declared, _ = with_effect(fitted, "torque_offset")
    found, notes = not_worse(grown, declared, select_rows(fitted, (0, 1)))
    assert bool(found.steps) is stays
    assert bool(notes) is not stays
