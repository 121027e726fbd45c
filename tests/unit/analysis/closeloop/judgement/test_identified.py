"""What could move a stiffness unseen is asked of what could be there."""

from dataclasses import replace

import numpy as np

from analysis.closeloop.identification.balance.declared import declared_model
from analysis.closeloop.identification.balance.model import evaluate
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.judgement.identified import hidden_effects
from analysis.closeloop.session.contents import DeclaredEffect
from analysis.closeloop.session.recording import Recording
from tests.testbed.sessions.rich import ELBOW


def test_a_rung_moves_no_stiffness_where_the_rung_below_is_not_there(recording: Recording) -> None:
    declared = (DeclaredEffect(effect="viscoelastic_joint", joint="elbow"),)
    session = replace(recording.session, declared=declared)
    noise = 0.1 * np.random.default_rng(2).standard_normal(recording.position.shape)
    effort = recording.filtered(recording.inverse + 5.0 * recording.position + noise)
    limb = replace(recording, session=session, joints=(ELBOW,), effort=effort, cache={})
    rows = select_rows(limb, (0,))
    model = declared_model(limb, rows)
    found = hidden_effects(model, evaluate(model, rows).coefficients, rows)
    names = {hidden.effect.name for hidden in found[ELBOW]}
    assert "load_dependent_friction" in names
    assert not names & {"quadratic_load_friction", "directional_load_friction"}
