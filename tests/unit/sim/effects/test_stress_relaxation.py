"""A limb whose torque falls after a movement: the standard linear solid."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from analysis.closeloop.identification.balance.declared import declared_model
from analysis.closeloop.identification.balance.model import evaluate, unfitted
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.candidates import candidates, options_beside
from analysis.closeloop.session.recording import Recording
from sim.effects.catalogue import BY_NAME
from sim.effects.motion import RecordedJoint
from tests.testbed.sessions.rests import with_rests
from tests.testbed.sessions.rich import ELBOW

RELAXATION = BY_NAME["stress_relaxation"]


def column(recording: Recording, seconds: float) -> np.ndarray:
    joint: RecordedJoint = unfitted(recording, ELBOW)
    return RELAXATION.columns(joint, {"relaxation_time": seconds})[ELBOW][:, 0]


def maxwell(recording: Recording, stiffness: float, seconds: float) -> np.ndarray:
    """Spring and dashpot in series, by an integrator of SciPy's, (n,)."""
    time, place = recording.time, recording.position[:, ELBOW]

    def creeps(t: float, z: np.ndarray) -> np.ndarray:
        return (np.interp(t, time, place) - z) / seconds

    span = (float(time[0]), float(time[-1]))
    found = solve_ivp(creeps, span, place[:1], t_eval=time, rtol=1e-7, atol=1e-9, max_step=0.05)
    return np.asarray(stiffness * (place - found.y[0]))


def test_a_recorded_stretch_relaxes_as_a_maxwell_element_does() -> None:
    whole = with_rests()
    assert column(whole, 0.8) == pytest.approx(maxwell(whole, 1.0, 0.8), abs=2e-5)


def test_lost_samples_are_gone_over_straight_and_a_trial_begins_relaxed() -> None:
    whole = with_rests()
    middle = len(whole.time) // 2
    middle += int(np.argmax(np.abs(whole.velocity[middle:, ELBOW])))
    kept = np.delete(np.arange(len(whole.time)), np.s_[middle : middle + 5])
    torn = replace(
        whole,
        slices=[slice(0, middle), slice(middle, len(kept))],
        trial=whole.trial[kept],
        time=whole.time[kept],
        position=whole.position[kept],
        velocity=whole.velocity[kept],
        acceleration=whole.acceleration[kept],
        effort=whole.effort[kept],
        measured=whole.measured[kept],
        extra=whole.extra[kept],
        cache={},
    )
    assert column(torn, 0.8) == pytest.approx(column(whole, 0.8)[kept], abs=2e-3)
    next_trial = (np.arange(len(kept)) >= middle).astype(int)
    assert column(replace(torn, trial=next_trial), 0.8)[middle] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("seconds", [0.3, 1.1, 4.0])
def test_relaxing_tissue_is_named_and_leaves_the_stiffness_of_rest(seconds: float) -> None:
    """Reflexes, hysteresis and thixotropy were named for it (an opponent's)."""
    still = with_rests()
    q, v = still.position[:, ELBOW], still.velocity[:, ELBOW]
    effort = np.array(still.inverse)
    effort[:, ELBOW] += 10.0 * (q - 0.9) + 0.5 * v + maxwell(still, 3.0, seconds)
    effort += 0.02 * np.random.default_rng(3).standard_normal(effort.shape)
    loud = replace(still, effort=still.filtered(effort), cache={})
    rows = select_rows(loud, (0,))
    model = declared_model(loud, rows)
    best, *others = options_beside(model, rows, evaluate(model, rows), candidates(loud))
    assert best.candidate.effect is RELAXATION
    assert min(other.score.loss for other in others) > 2.0 * best.score.loss
    assert best.score.coefficients[0] == pytest.approx(10.0, rel=0.02)
    assert best.score.coefficients[-1] == pytest.approx(3.0, rel=0.1)
    assert best.theta["relaxation_time"] == pytest.approx(seconds, rel=0.1)
