"""How friction passes through zero is chosen again, and is one for all friction of a joint."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.declared import declared_again
from analysis.closeloop.identification.balance.model import Model, evaluate, unfitted
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.identification.candidates import candidates, options_beside
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.rich import ELBOW, rich_elbow


@pytest.fixture(scope="module")
def elbow() -> Recording:
    return rich_elbow()


def turning(recording: Recording, smooth: float) -> np.ndarray:
    """Return the direction, smooth below a share of the top speed, (n,)."""
    return np.array(replace(unfitted(recording, ELBOW), smooth=smooth).direction)


def test_declared_friction_is_chosen_again_beside_what_was_found(elbow: Recording) -> None:
    coulomb = BY_NAME["coulomb_friction"]
    effort = np.array(elbow.inverse)
    effort[:, ELBOW] += turning(elbow, 0.004)
    loud = replace(elbow, effort=elbow.filtered(effort), cache={})
    rows, theta = select_rows(loud, (0,)), {"smooth": 0.06}
    columns = coulomb.columns(unfitted(loud, ELBOW), theta)
    term = Term(joint=ELBOW, columns=columns, kept=(0,), theta=theta, effect=coulomb)
    wrong = Model(loud, terms=(term,))
    found = declared_again(wrong, rows)
    assert found.terms[0].theta["smooth"] < 0.01
    assert evaluate(found, rows).sse < 0.1 * evaluate(wrong, rows).sse
    added = replace(term, candidate=Candidate(effect=coulomb, joint=ELBOW))
    assert declared_again(Model(loud, terms=(added,)), rows).terms[0].theta == theta


def test_further_friction_turns_as_the_declared_does(elbow: Recording) -> None:
    coulomb, theta = BY_NAME["coulomb_friction"], {"smooth": 0.02}
    effort = np.array(elbow.inverse)
    effort[:, ELBOW] += (1.0 + 0.6 * np.abs(elbow.velocity[:, ELBOW])) * turning(elbow, 0.02)
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
