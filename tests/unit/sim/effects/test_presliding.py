"""Friction gives way before it slides, and neither form nor size of it is mistaken for that."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.declared import declared_again
from analysis.closeloop.identification.balance.model import (
    Candidate,
    Model,
    Term,
    evaluate,
    unfitted,
)
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.candidates import candidates, options_beside
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from tests.testbed.rich_recording import ELBOW, rich_recording

WAY = 0.004


@pytest.fixture(scope="module")
def elbow() -> Recording:
    return replace(rich_recording(), joints=(ELBOW,), cache={})


def bristles(recording: Recording) -> np.ndarray:
    """Return the state of contacts that give way over `WAY` rad, step by step, (n,)."""
    position, state = recording.position[:, ELBOW], [0.0]
    for step in np.diff(position):
        way = np.sign(step)
        state.append(way + (state[-1] - way) * np.exp(-abs(step) / WAY))
    return np.array(state)


def test_the_direction_winds_up_over_a_way(elbow: Recording) -> None:
    joint = replace(unfitted(elbow, ELBOW), slide=WAY / unfitted(elbow, ELBOW).travel[1])
    assert joint.direction == pytest.approx(bristles(elbow), abs=1e-9)


def test_stribeck_friction_is_told_from_coulomb_friction_that_gives_way(elbow: Recording) -> None:
    speed = elbow.velocity[:, ELBOW]
    level = 1.0 + 1.0 * np.exp(-((speed / 0.15) ** 2))
    noise = 0.02 * np.random.default_rng(3).standard_normal(len(speed))
    effort = np.array(elbow.inverse)
    effort[:, ELBOW] += level * bristles(elbow) + noise
    loud = replace(elbow, effort=elbow.filtered(effort), cache={})
    rows, model = select_rows(loud, (0,)), Model(loud)
    tried = [c for c in candidates(loud) if c.effect.name.startswith(("coulomb", "stribeck_f"))]
    first, second = options_beside(model, rows, evaluate(model, rows), tried)
    assert first.candidate.effect.name == "stribeck_friction"
    assert first.theta["slide"] > 0.0
    assert first.score.loss < 0.2 * second.score.loss


def test_declared_friction_is_chosen_again_beside_what_was_found(elbow: Recording) -> None:
    coulomb = BY_NAME["coulomb_friction"]
    effort = np.array(elbow.inverse)
    effort[:, ELBOW] += bristles(elbow)
    loud = replace(elbow, effort=elbow.filtered(effort), cache={})
    rows, theta = select_rows(loud, (0,)), {"smooth": 0.06, "slide": 0.0}
    columns = coulomb.columns(unfitted(loud, ELBOW), theta)
    term = Term(joint=ELBOW, columns=columns, kept=(0,), theta=theta, effect=coulomb)
    wrong = Model(loud, terms=(term,))
    found = declared_again(wrong, rows)
    assert found.terms[0].theta["slide"] > 0.0
    assert evaluate(found, rows).sse < 0.1 * evaluate(wrong, rows).sse
    added = replace(term, candidate=Candidate(effect=coulomb, joint=ELBOW))
    assert declared_again(Model(loud, terms=(added,)), rows).terms[0].theta == theta


def test_further_friction_turns_as_the_declared_does(elbow: Recording) -> None:
    coulomb, theta = BY_NAME["coulomb_friction"], {"smooth": 0.004, "slide": 0.003}
    effort = np.array(elbow.inverse)
    effort[:, ELBOW] += (1.0 + 0.6 * np.abs(elbow.velocity[:, ELBOW])) * bristles(elbow)
    loud = replace(elbow, effort=elbow.filtered(effort), cache={})
    rows = select_rows(loud, (0,))
    columns = coulomb.columns(unfitted(loud, ELBOW), theta)
    model = Model(
        loud, terms=(Term(joint=ELBOW, columns=columns, kept=(0,), theta=theta, effect=coulomb),)
    )
    tried = [c for c in candidates(loud) if c.effect.name == "asymmetric_friction"]
    options = options_beside(model, rows, evaluate(model, rows), tried)
    assert options
    for option in options:
        assert {name: option.theta[name] for name in theta} == theta
        # The mean of both sides is declared already: only what tells them apart is new.
        assert 0 not in option.model.terms[-1].kept
