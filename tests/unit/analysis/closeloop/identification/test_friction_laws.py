"""Laws of friction are told apart where friction may wind up before it slides."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Model, evaluate, unfitted
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.identification.findings import Grown, Option, Step
from analysis.closeloop.identification.growing.friction_laws import with_wound_laws
from analysis.closeloop.identification.growing.plain_law import with_plain_law
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from sim.effects.motion import PRESLIDING_SHARE
from tests.testbed.sessions.rich import ELBOW, rich_elbow

#: Nm: of friction in motion, of what there is more of it when slow, and of the sensor.
FRICTION, EXCESS, NOISE = 1.0, 1.5, 0.02
#: Further friction over the load, and so little that errors of other joints may look like it.
SHARE, LITTLE = 0.15, 0.015


@pytest.fixture(scope="module")
def elbow() -> Recording:
    return rich_elbow(30)


def wound(elbow: Recording, excess: float) -> Recording:
    """The elbow with friction that winds up over presliding's way, and so much more when slow."""
    joint = unfitted(elbow, ELBOW)
    level = FRICTION + excess * np.exp(-((joint.velocity / (0.06 * joint.top_speed)) ** 2))
    effort = np.array(elbow.inverse)
    effort[:, ELBOW] += level * joint.wound(0.5 * PRESLIDING_SHARE * joint.travel[1])
    effort += NOISE * np.random.default_rng(4).standard_normal(effort.shape)
    return replace(elbow, effort=elbow.filtered(effort), cache={})


def loaded(seconds: int, quicker: float, share: float = SHARE) -> Recording:
    """The elbow with friction that grows with its load, told where it is quick enough.

    Args:
        seconds: of the recording.
        quicker: share of the top speed below which nothing is told, as about a turn.
        share: by how much it grows, over the load.
    """
    elbow = rich_elbow(seconds)
    joint = unfitted(elbow, ELBOW)
    level = 0.5 * FRICTION + share * np.abs(elbow.static[:, ELBOW])
    effort = np.array(elbow.inverse)
    effort[:, ELBOW] += level * np.tanh(joint.velocity / (0.004 * joint.top_speed))
    effort += NOISE * np.random.default_rng(5).standard_normal(effort.shape)
    slow = np.abs(elbow.velocity) <= quicker * joint.top_speed
    return replace(elbow, effort=elbow.filtered(effort), disturbed=slow, cache={})


def named(recording: Recording, rows: Rows, name: str, **theta: float) -> Grown:
    """What is found where one law was named."""
    candidate = Candidate(effect=BY_NAME[name], joint=ELBOW)
    columns = candidate.effect.columns(unfitted(recording, ELBOW), theta)
    term = Term(
        effect=candidate.effect,
        joint=ELBOW,
        columns=columns,
        lower=candidate.effect.lower,
        theta=theta,
        kept=tuple(range(columns[ELBOW].shape[1])),
        candidate=candidate,
    )
    model = Model(recording).with_term(term)
    score = evaluate(model, rows)
    option = Option(candidate=candidate, model=model, score=score, gain=1.0, z=9.0)
    step = Step(taken=option, equals=(), options=(), before=score.loss + 1.0)
    return Grown(model, score, (step,))


@pytest.mark.parametrize(
    ("excess", "found", "theta", "true"),
    [
        (EXCESS, "coulomb_friction", {"smooth": 0.02}, "stribeck_friction"),
        (0.0, "position_dependent_friction", {"smooth": 0.02, "waves": 1.0}, "coulomb_friction"),
        (0.0, "coulomb_friction", {"smooth": 0.02}, "coulomb_friction"),
    ],
)
def test_the_simplest_law_that_predicts_as_well_as_the_best_where_it_winds_up_is_named(
    elbow: Recording, excess: float, found: str, theta: dict[str, float], true: str
) -> None:
    loud = wound(elbow, excess)
    rows = select_rows(loud, (0,))
    again = with_wound_laws(named(loud, rows, found, **theta), rows)
    assert [step.key for step in again.steps] == [(true, ELBOW)]
    assert [candidate.effect.name for candidate in again.model.effects] == [true]
    assert again.score.loss == pytest.approx(evaluate(again.model, rows).loss)
    level = again.score.coefficients[0]
    assert level == pytest.approx(FRICTION, abs=0.1)


def test_a_law_that_is_right_is_not_put_aside_since_winding_freely_fits_noise() -> None:
    # Of what turns nothing is told.
    quick = loaded(3, 0.2)
    rows = select_rows(quick, (0,))
    found = named(quick, rows, "load_dependent_friction", smooth=0.004, load=0.0)
    assert with_wound_laws(found, rows).steps == found.steps


def test_a_peak_that_predicts_better_as_it_turns_is_no_plain_friction_that_winds_up() -> None:
    """That has nine levels for it, and was named in its place. (The unkind bench.)"""
    elbow = rich_elbow(10)
    joint = unfitted(elbow, ELBOW)
    fast = joint.velocity / joint.top_speed
    effort = np.array(elbow.inverse)
    effort[:, ELBOW] += (FRICTION + 0.3 * np.exp(-((fast / 0.06) ** 2))) * np.tanh(fast / 0.02)
    effort += NOISE * np.random.default_rng(4).standard_normal(effort.shape)
    loud = replace(elbow, effort=elbow.filtered(effort), cache={})
    rows = select_rows(loud, (0,)).reweighted({ELBOW: NOISE})
    found = named(loud, rows, "stribeck_friction", smooth=0.02, speed=0.06, power=2.0)
    assert with_wound_laws(found, rows).steps == found.steps


def test_a_richer_law_is_named_also_where_friction_turns_as_the_plain_one_does() -> None:
    slow = loaded(10, 0.0)
    rows = select_rows(slow, (0,))
    again = with_wound_laws(named(slow, rows, "coulomb_friction", smooth=0.004), rows)
    assert [step.key for step in again.steps] == [("load_dependent_friction", ELBOW)]
    assert again.score.coefficients == pytest.approx([0.5 * FRICTION, SHARE], abs=0.02)


def test_what_a_richer_law_adds_has_to_be_more_than_other_errors_may_be() -> None:
    slow = loaded(10, 0.0, LITTLE)
    rows = select_rows(slow, (0,))
    found = named(slow, rows, "coulomb_friction", smooth=0.004)
    assert with_wound_laws(found, rows).steps == found.steps


@pytest.mark.parametrize(
    ("difference", "law"), [(0.0, "coulomb_friction"), (0.6, "asymmetric_friction")]
)
def test_beside_another_effect_friction_is_plain_unless_left_out_rows_miss_more(
    elbow: Recording, difference: float, law: str
) -> None:
    """Before the other was known an asymmetry stood for it (a reflex, of a stranger's)."""
    smooth, load = {"smooth": 0.02}, {"distance": 1.6}
    joint = unfitted(elbow, ELBOW)
    turned = np.tanh(joint.velocity / (smooth["smooth"] * joint.top_speed))
    effort = np.array(elbow.inverse)
    effort[:, ELBOW] += FRICTION * turned + difference * np.abs(turned)
    effort[:, ELBOW] += BY_NAME["payload"].columns(joint, load)[ELBOW] @ [0.4]
    effort += NOISE * np.random.default_rng(4).standard_normal(effort.shape)
    loud = replace(elbow, effort=elbow.filtered(effort), cache={})
    rows = select_rows(loud, (0,)).reweighted({ELBOW: NOISE})
    rich = named(loud, rows, "asymmetric_friction", **smooth, viscous=0.0)
    other = named(loud, rows, "payload", distance=1.2)
    model = rich.model.with_term(other.model.terms[0])
    found = with_plain_law(Grown(model, evaluate(model, rows), rich.steps + other.steps), rows)
    assert sorted(step.key[0] for step in found.steps) == sorted((law, "payload"))
    if not difference:
        (term,) = [t for t in found.model.terms if t.effect is BY_NAME["payload"]]
        assert term.theta["distance"] > 1.4
