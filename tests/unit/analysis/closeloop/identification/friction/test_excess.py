"""The speed at which an excess of friction is lost and its power are fitted together."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Model, evaluate, unfitted
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.findings import Grown, Option, Step
from analysis.closeloop.identification.friction.excess import with_settled_excess
from analysis.closeloop.identification.nameable import with_law
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.rich import ELBOW, rich_elbow

STRIBECK = BY_NAME["stribeck_friction"]
#: Nm: of friction when fast, of what there is more when slow, and of the sensor.
FRICTION, EXCESS, NOISE = 0.6, 0.9, 0.02
#: Nm s/rad: further damping of the joint.
DAMPING = 0.2


@pytest.fixture(scope="module")
def elbow() -> Recording:
    return rich_elbow(30)


def begun(elbow: Recording, power: float, damping: float = 0.0) -> tuple[Grown, Rows]:
    """What a search has that knows one power: Stribeck friction of a speed that is half the truth.

    The truth falls by another power of the speed, from the same level.
    """
    joint = unfitted(elbow, ELBOW)
    truth = {"smooth": 0.004, "speed": 0.12, "power": power}
    effort = np.array(elbow.inverse)
    effort[:, ELBOW] += STRIBECK.columns(joint, truth)[ELBOW] @ np.array([FRICTION, EXCESS])
    effort[:, ELBOW] += damping * joint.velocity
    effort += NOISE * np.random.default_rng(4).standard_normal(effort.shape)
    loud = replace(elbow, effort=elbow.filtered(effort), cache={})
    rows = select_rows(loud, loud.fit_trials)
    candidate = Candidate(effect=STRIBECK, joint=ELBOW)
    theta = truth | {"speed": 0.06, "power": 2.0}
    model = with_law(Model(loud), candidate, theta, rows, joint)
    assert model is not None
    score = evaluate(model, rows)
    option = Option(candidate=candidate, model=model, score=score, gain=1.0, z=9.0)
    step = Step(taken=option, equals=(), options=(), before=score.loss + 1.0)
    return Grown(model, score, (step,)), rows


@pytest.mark.parametrize("power", [2.0, 1.0, 0.5])
def test_the_level_and_the_excess_are_those_of_the_power_that_is_found(
    elbow: Recording, power: float
) -> None:
    grown, rows = begun(elbow, power)
    settled = with_settled_excess(grown, rows)
    (term,) = settled.model.terms
    assert term.theta["power"] == pytest.approx(power, rel=0.1)
    assert term.theta["speed"] == pytest.approx(0.12, rel=0.2)
    assert settled.score.coefficients == pytest.approx([FRICTION, EXCESS], rel=0.1)
    assert settled.steps == grown.steps


def test_damping_that_a_peak_of_another_power_hid_is_found_beside_it(elbow: Recording) -> None:
    settled = with_settled_excess(*begun(elbow, 1.0, DAMPING))
    names = [step.key[0] for step in settled.steps]
    assert names == ["stribeck_friction", "viscous_friction"]
    assert settled.score.coefficients == pytest.approx([FRICTION, EXCESS, DAMPING], rel=0.1)


def test_a_law_whose_excess_nothing_shows_is_left_as_it_was(elbow: Recording) -> None:
    grown, rows = begun(elbow, 2.0)
    (term,) = grown.model.terms
    bare = replace(grown.model, terms=(replace(term, kept=(0,)),))
    grown = Grown(bare, evaluate(bare, rows), grown.steps)
    assert with_settled_excess(grown, rows).model.terms[0].theta == term.theta
