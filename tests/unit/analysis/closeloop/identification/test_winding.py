"""Friction that winds up before it slides is no stiffness of the limb."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification import winding
from analysis.closeloop.identification.balance.model import Model, evaluate, impedances, unfitted
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.identification.balance.terms import Candidate, Term
from analysis.closeloop.identification.winding import with_winding
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME, VISCOELASTIC
from tests.testbed.sessions.rich import ELBOW, rich_elbow

STIFFNESS, FRICTION = 3.0, 0.8


@pytest.fixture(scope="module")
def elbow() -> Recording:
    return rich_elbow(20)


def fitted(elbow: Recording, wound: np.ndarray) -> tuple[Model, Rows]:
    """Return Coulomb friction and a limb, for an elbow with a spring and a friction, (n,) of 1."""
    joint = unfitted(elbow, ELBOW)
    effort = np.array(elbow.inverse)
    effort[:, ELBOW] += STIFFNESS * (joint.position - 1.0) + FRICTION * wound
    effort[:, ELBOW] += 0.02 * np.random.default_rng(3).standard_normal(len(effort))
    loud = replace(elbow, effort=elbow.filtered(effort), cache={})
    friction, theta = BY_NAME["coulomb_friction"], {"smooth": 0.004}
    limb = VISCOELASTIC.columns(unfitted(loud, ELBOW), {})
    rubs = friction.columns(unfitted(loud, ELBOW), theta)
    terms = (
        Term(joint=ELBOW, columns=limb, kept=(0, 1, 2), effect=VISCOELASTIC),
        Term(
            joint=ELBOW,
            columns=rubs,
            kept=(0,),
            theta=theta,
            effect=friction,
            candidate=Candidate(effect=friction, joint=ELBOW),
        ),
    )
    return Model(loud, terms=terms), select_rows(loud, (0,))


def test_what_winds_up_at_the_ends_of_a_movement_adds_nothing_to_the_stiffness(
    elbow: Recording,
) -> None:
    model, rows = fitted(elbow, unfitted(elbow, ELBOW).wound(0.002))
    before = evaluate(model, rows)
    wider, after, at = with_winding(model, before, rows)
    stiff, freed = (
        impedances(*fit)[ELBOW]["stiffness"] / STIFFNESS - 1.0
        for fit in ((model, before.coefficients), (wider, after.coefficients))
    )
    assert at == [ELBOW] and stiff > 0.005 and abs(freed) < 0.2 * stiff
    # The level stays what it is, with its name.
    own = {t.candidate.key: c for t, c in wider.split(after.coefficients) if t.candidate}
    assert own["coulomb_friction", ELBOW] == pytest.approx(FRICTION, rel=0.02)


def test_friction_that_turns_as_its_law_says_is_left_alone(elbow: Recording) -> None:
    model, rows = fitted(elbow, np.sign(elbow.velocity[:, ELBOW]))
    score = evaluate(model, rows)
    assert with_winding(model, score, rows) == (model, score, [])


@pytest.mark.parametrize(("beyond", "freed"), [(0.3, True), (20.0, False)])
def test_friction_is_not_freed_where_it_would_be_anything_outside_of_the_fitted_rows(
    elbow: Recording, monkeypatch: pytest.MonkeyPatch, beyond: float, freed: bool
) -> None:
    """Where a joint sticks they lack what winds up: five times as much as before was left there."""
    outside = np.abs(elbow.since_reversal(ELBOW)) < 0.3
    column = np.sin(9.0 * elbow.time) * np.where(outside, beyond, 1.0)
    model, rows = fitted(elbow, np.sign(elbow.velocity[:, ELBOW]) + np.sin(9.0 * elbow.time))
    free = Term(joint=ELBOW, columns={ELBOW: column[:, None]}, kept=(0,))
    monkeypatch.setattr(winding, "winding_freely", lambda *_: model.with_term(free))
    few = rows.where(~outside[rows.samples[ELBOW]])
    _, _, at = with_winding(model, evaluate(model, few), few)
    assert at == ([ELBOW] if freed else [])
