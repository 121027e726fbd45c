"""Friction by position: a wave in any phase, and a parabola where waves are long."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Model, unfitted
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.candidates import tried_alone
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from tests.testbed.sessions.rich import ELBOW

EFFECT = BY_NAME["position_dependent_friction"]


@pytest.mark.parametrize("phase", [0.0, 1.0, 2.5])
def test_a_level_and_a_wave_of_any_phase_are_its_columns(
    recording: Recording, phase: float
) -> None:
    joint = unfitted(recording, ELBOW)
    columns = EFFECT.columns(joint, {"smooth": 0.004, "waves": 1.5})[ELBOW]
    order = EFFECT.fixed(joint, {"smooth": 0.004, "waves": 1.5})["order"]
    wanted = columns[:, 0] * (2.0 + np.sin(order * joint.position + phase))
    held = np.linalg.lstsq(columns, wanted, rcond=None)[0]
    np.testing.assert_allclose(columns @ held, wanted, atol=1e-9)


def test_long_waves_are_a_parabola(recording: Recording) -> None:
    joint = unfitted(recording, ELBOW)
    parabola = EFFECT.columns(joint, {"smooth": 0.004, "waves": 0.0})[ELBOW]
    wave = EFFECT.columns(joint, {"smooth": 0.004, "waves": 0.01})[ELBOW]
    np.testing.assert_allclose(wave, parabola, atol=1e-3)


@pytest.mark.parametrize("waves", [0.7, 1.7, 3.4])
def test_waves_between_those_of_the_grid_are_found(recording: Recording, waves: float) -> None:
    joint = unfitted(recording, ELBOW)
    needed = np.zeros_like(recording.effort)
    columns = EFFECT.columns(joint, {"smooth": 0.004, "waves": waves})[ELBOW]
    needed[:, ELBOW] = columns @ [1.0, 0.5, -1.5]
    own = replace(recording, joints=(ELBOW,), effort=recording.filtered(recording.inverse + needed))
    rows = select_rows(own, own.fit_trials)
    found = tried_alone(Model(own), rows, Candidate(effect=EFFECT, joint=ELBOW))
    assert found is not None
    (term,) = found[0].terms
    assert term.theta["waves"] == pytest.approx(waves, rel=0.1)
