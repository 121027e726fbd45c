"""Stiffness that moving breaks and rest builds again."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.declared import declared_model
from analysis.closeloop.identification.balance.model import evaluate
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.candidates import candidates, options_beside
from analysis.closeloop.session.contents import DeclaredEffect
from analysis.closeloop.session.recording import Recording
from sim.effects.laws.limb import Structure, ThixotropicStiffness
from tests.testbed.sessions.rich import ELBOW, rich_recording

EFFECT = ThixotropicStiffness()


def test_steady_motion_leaves_what_rest_builds_in_the_meantime() -> None:
    structure, state = Structure(recovery=2.0, distance=0.4), 1.0
    for _ in range(4000):
        state = structure.stepped(state, 0.005, 0.005 * 0.8)
    # Moore: 1 / (1 + recovery |v| / distance).
    assert state == pytest.approx(1.0 / (1.0 + 2.0 * 0.8 / 0.4), rel=1e-6)
    for _ in range(400):
        state = structure.stepped(state, 0.005, 0.0)
    assert state == pytest.approx(1.0 - 0.8 * np.exp(-1.0), rel=5e-3)


def test_a_spring_that_moving_softens_is_no_hardening_spring() -> None:
    """The law by its own equation, solved in small steps, beside a declared impedance."""
    rich = rich_recording()
    declared = (DeclaredEffect(effect="viscoelastic_joint", joint="elbow"),)
    session = replace(rich.session, declared=declared)
    elbow: Recording = replace(rich, session=session, joints=(ELBOW,), cache={})
    q, v = elbow.position[:, ELBOW], elbow.velocity[:, ELBOW]
    state, structure = 1.0, np.empty(len(q))
    for i, speed in enumerate(np.abs(v)):
        structure[i] = state
        for _ in range(20):
            state += 2.5e-4 * ((1.0 - state) / 1.0 - state * speed / 0.15)
    effort = np.array(elbow.inverse)
    effort[:, ELBOW] += 10.0 * (q - 0.9) + 0.5 * v + 6.0 * structure * (q - 0.9)
    effort += 0.01 * np.random.default_rng(3).standard_normal(effort.shape)
    loud = replace(elbow, effort=elbow.filtered(effort), cache={})
    rows = select_rows(loud, (0,))
    model = declared_model(loud, rows)
    best = options_beside(model, rows, evaluate(model, rows), candidates(loud))[0]
    assert best.candidate.effect.name == EFFECT.name
    stiffness = dict(zip(best.model.terms[-1].kept, best.score.coefficients[3:], strict=True))[0]
    assert stiffness == pytest.approx(6.0, rel=0.15)
    assert best.score.coefficients[0] == pytest.approx(10.0, rel=0.05)
