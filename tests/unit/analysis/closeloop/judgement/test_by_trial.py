"""A limb whose stiffness differs from trial to trial has no one number, and that is said."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Model, unfitted
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.balance.terms import Term
from analysis.closeloop.judgement.by_trial import by_trial
from analysis.closeloop.session.contents import Trial
from analysis.closeloop.session.recording import Recording
from sim.effects.laws.elastic import Viscoelastic
from tests.testbed.sessions.moved import moved

RATE, SECONDS, TRIALS = 50.0, 12.0, 6
TIME = np.arange(int(TRIALS * SECONDS * RATE)) / RATE
TRIAL = (TIME // SECONDS).astype(int)
PLACE = 1.0 + 0.4 * np.sin(2 * np.pi * 0.4 * TIME + 0.6 * np.sin(0.31 * TIME))
#: Of every trial, Nm/rad: in no order that a function of time follows.
TONE = np.array([2.05, 2.65, 3.25, 2.05, 2.65, 3.25])


@pytest.fixture
def limb(recording: Recording) -> Recording:
    """Six trials of a limb in motion, its shoulder held; without effort beyond the model's."""
    one = moved(recording, np.column_stack([np.zeros_like(PLACE), PLACE]), RATE)
    length = int(SECONDS * RATE)
    names = [f"t{number}.csv" for number in range(TRIALS)]
    trials = tuple(Trial(file=n, label=n, group=n, role="fit") for n in names)
    return replace(
        one,
        session=replace(one.session, trials=trials, limb_joints=("elbow",)),
        trial=TRIAL,
        slices=[slice(length * number, length * (number + 1)) for number in range(TRIALS)],
        fit_trials=tuple(range(TRIALS)),
        cache={},
    )


def stiffness(limb: Recording, torque: np.ndarray, noise: np.ndarray) -> dict[int, float] | None:
    """Return the elbow's stiffness by trial where it adds a torque, Nm, (n,)."""
    effort = np.array(limb.inverse)
    effort[:, 1] += torque + noise
    measured = replace(limb, effort=limb.filtered(effort), cache={})
    effect = Viscoelastic()
    columns = effect.columns(unfitted(measured, 1), {})
    term = Term(joint=1, columns=columns, lower=(-np.inf,), kept=(0, 1, 2), effect=effect)
    model = Model(measured, terms=(term,))
    found = by_trial(model, select_rows(measured, measured.fit_trials))
    return dict(found[1].stiffness) if found else None


def slow_noise(seed: int) -> np.ndarray:
    """Return noise of which a stiffness may seem to follow a wave or two, Nm, (n,)."""
    steps = np.random.default_rng(seed).standard_normal(len(TIME))
    return np.asarray(0.05 * (np.cumsum(steps) / 20.0 + steps))


def test_tone_that_differs_in_no_order_is_told_trial_by_trial(limb: Recording) -> None:
    """A stranger's: repeats of a movement took it for noise, and K was called unidentified."""
    found = stiffness(limb, TONE[TRIAL] * (PLACE - 1.0), slow_noise(0))
    assert found is not None
    assert list(found.values()) == pytest.approx(TONE, abs=0.08)


def test_noise_that_wanders_is_no_tone(limb: Recording) -> None:
    assert [stiffness(limb, 2.6 * (PLACE - 1.0), slow_noise(seed)) for seed in range(20)] == (
        [None] * 20
    )


def test_what_goes_with_the_motion_alike_in_every_trial_is_no_tone(limb: Recording) -> None:
    cubic = 2.6 * (PLACE - 1.0) + 3.0 * (PLACE - 1.0) ** 3
    assert stiffness(limb, cubic, slow_noise(1)) is None
