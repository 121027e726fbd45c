"""What could move a stiffness unseen is asked of what could be there."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.declared import declared_model
from analysis.closeloop.identification.balance.model import (
    Model,
    estimate_of,
    evaluate,
    unfitted,
)
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.judgement.identified import _reach, _variants, hidden_effects
from analysis.closeloop.session.contents import DeclaredEffect
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from sim.effects.motion import RecordedJoint
from tests.testbed.sessions.moved import moved
from tests.testbed.sessions.rich import ELBOW, TRUTH, added


def limb_of(recording: Recording) -> tuple[Model, Rows]:
    """Return a limb of 5 Nm/rad as it is declared, and its rows."""
    declared = (DeclaredEffect(effect="viscoelastic_joint", joint="elbow"),)
    session = replace(recording.session, declared=declared)
    noise = 0.1 * np.random.default_rng(2).standard_normal(recording.position.shape)
    effort = recording.filtered(recording.inverse + 5.0 * recording.position + noise)
    limb = replace(recording, session=session, joints=(ELBOW,), effort=effort, cache={})
    rows = select_rows(limb, (0,))
    return declared_model(limb, rows), rows


def limb_with(name: str, recording: Recording) -> tuple[Model, Rows]:
    """Return the limb's model with an effect that its recording has, and the rows to fit."""
    limb, _ = limb_of(recording)
    effect, (theta, size) = BY_NAME[name], TRUTH[name]
    columns = effect.columns(unfitted(limb.recording, ELBOW), theta)
    effort = np.array(limb.recording.effort)
    effort[:, ELBOW] += columns[ELBOW] @ size
    measured = replace(limb.recording, effort=effort, cache={})
    rows = select_rows(measured, (0,))
    return declared_model(measured, rows).with_term(added(name, columns, theta)), rows


@pytest.mark.parametrize(
    ("torque", "imitated", "least", "most"),
    [(1e-16, 1.0, 0.0, 0.0), (1.0, 1.0, 0.5, 5.0), (1.0, 0.9999, 0.1, 2.5)],
    ids=["rounding", "stiffness itself", "nearly stiffness"],
)
def test_what_a_column_shows_of_itself_says_how_far_it_could_move_a_stiffness(
    recording: Recording, torque: float, imitated: float, least: float, most: float
) -> None:
    """A zero moves nothing where no gravity pulls, and with gravity as much as the trials allow."""
    model, rows = limb_of(recording)
    position = recording.position[:, ELBOW] - recording.position[:, ELBOW].mean()
    other = np.sin(7.0 * recording.position[:, ELBOW])
    own = other / np.linalg.norm(other) * np.linalg.norm(position)
    column = torque * (np.sqrt(imitated) * position + np.sqrt(1.0 - imitated) * own)
    effect, value = BY_NAME["position_offset"], evaluate(model, rows).coefficients[0]
    reach = _reach(model, rows, (0, float(value)), effect, {ELBOW: column[:, None]})
    assert least <= reach <= most


def test_a_rung_moves_no_stiffness_where_the_rung_below_is_not_there(recording: Recording) -> None:
    model, rows = limb_of(recording)
    found = hidden_effects(model, evaluate(model, rows).coefficients, rows)
    names = {hidden.effect.name for hidden in found[ELBOW]}
    assert "load_dependent_friction" in names
    assert not names & {"quadratic_load_friction", "directional_load_friction"}


def test_what_was_found_may_have_another_form_beside_what_could_move_a_stiffness(
    recording: Recording,
) -> None:
    """A stiffer cuff made room for a gain of 54 % of K, which was told as 0.2 % (an opponent's)."""
    found, rows = limb_with("end_range_torque", recording)
    coefficients = evaluate(found, rows).coefficients
    gain = BY_NAME["torque_gain"]
    recorded = RecordedJoint(found.recording, ELBOW, estimate_of(found, coefficients))
    held = _reach(found, rows, (0, float(coefficients[0])), gain, gain.columns(recorded, {}))
    (free,) = (
        hidden.by
        for hidden in hidden_effects(found, coefficients, rows)[ELBOW]
        if hidden.effect is gain
    )
    assert free > 2.0 * held


def test_a_gain_is_hidden_beside_a_load_that_may_hang_beside_its_line(
    recording: Recording,
) -> None:
    """It takes a gain in whole, and was said to let one move K by 0.5 %: it did by 11."""
    found, rows = limb_with("payload", recording)
    coefficients = evaluate(found, rows).coefficients
    hidden = hidden_effects(found, coefficients, rows)[ELBOW]
    (by,) = (one.by for one in hidden if one.effect.name == "torque_gain")
    assert by == pytest.approx(0.25 * coefficients[0])


def test_a_spring_that_hardens_is_hidden_beside_a_load_that_may_hang_anywhere(
    recording: Recording,
) -> None:
    """Weight of any size and place is nearly one: an opponent's K was 128 % off, and it 1.6 %."""
    time = np.arange(8000) / 200.0
    swings = 0.3 * np.sin(0.9 * time) + 0.2 * np.sin(2.3 * time)
    narrow = moved(recording, np.column_stack([0.0 * time, 1.2 + swings]), 200.0)
    found, rows = limb_with("payload", narrow)
    coefficients = evaluate(found, rows).coefficients
    spring, stiffness = BY_NAME["nonlinear_stiffness"], float(coefficients[0])
    recorded = RecordedJoint(found.recording, ELBOW, estimate_of(found, coefficients))
    held = max(
        _reach(found, rows, (0, stiffness), spring, columns)
        for columns in _variants(spring, recorded)
    )
    assert held < 0.1 * stiffness
    hidden = hidden_effects(found, coefficients, rows)[ELBOW]
    (by,) = (one.by for one in hidden if one.effect is spring)
    # Nothing is known of it, and "forty times" would tell nobody more.
    assert by == pytest.approx(stiffness)
