"""Intervals hold the truth as often as they say, over many draws of what makes them necessary."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from analysis.closeloop.catalogue import VISCOELASTIC
from analysis.closeloop.model import Model, declared_model, evaluate, impedances
from analysis.closeloop.recording import Recording
from analysis.closeloop.regression import Rows, select_rows
from analysis.closeloop.session import DeclaredEffect, Trial
from analysis.closeloop.signals import Sampling
from analysis.closeloop.uncertainty import PARTS, jackknife_interval, leave_out

RATE, SECONDS, ELBOW = 50.0, 6.0, 1
STIFFNESS, DAMPING = 4.0, 0.4
DRAWS = 200
#: Torque that nobody declared, of a recording and a generator, (n,).
Disturbance = Callable[[Recording, np.random.Generator], np.ndarray]


def trials_recording(recording: Recording, count: int) -> Recording:
    """Return trials in which the elbow swings to and fro, each at a speed of its own."""
    size = int(RATE * SECONDS)
    t = np.arange(size) / RATE
    motion = np.zeros((3, count * size, 2))
    for number in range(count):
        w = 2 * np.pi * (0.25 + 0.15 * (number % 4))
        wave = np.array([np.sin(w * t), w * np.cos(w * t), -(w**2) * np.sin(w * t)])
        motion[:, number * size : (number + 1) * size, ELBOW] = 0.6 * wave
    trials = tuple(
        Trial(file=f"{i}.csv", label=str(i), group=str(i), role="fit") for i in range(count)
    )
    declared = (DeclaredEffect(effect=VISCOELASTIC, joint="elbow"),)
    return Recording(
        device=recording.device,
        session=replace(recording.session, trials=trials, declared=declared),
        sampling=Sampling(recorded=RATE, working=RATE, cutoff=15.0),
        pieces=[],
        slices=[slice(i * size, (i + 1) * size) for i in range(count)],
        trial=np.repeat(np.arange(count), size),
        time=np.arange(count * size) / RATE,
        position=motion[0] + [0.0, 1.0],
        velocity=motion[1],
        acceleration=motion[2],
        effort=np.zeros_like(motion[0]),
        extra=np.empty((count * size, 0)),
        extra_names=(),
        joints=(ELBOW,),
        fit_trials=tuple(range(count)),
    )


def noise_by_trial(recording: Recording, rng: np.random.Generator) -> np.ndarray:
    """A stiffness that differs a little from trial to trial, and coloured noise."""
    every = 0.05 * rng.standard_normal(len(recording.session.trials))
    coloured = lfilter([1.0], [1.0, -0.95], 0.02 * rng.standard_normal(len(recording.time)))
    return np.asarray(every[recording.trial] * recording.position[:, ELBOW] + coloured)


def misfit_by_place(recording: Recording, rng: np.random.Generator) -> np.ndarray:
    """A torque of place and direction that comes back in every trial, and a little noise."""
    position, velocity = recording.position[:, ELBOW], recording.velocity[:, ELBOW]
    share = (position - position.min()) / np.ptp(position)
    place = np.minimum((share * PARTS).astype(int), PARTS - 1)
    torque = 0.1 * rng.standard_normal((2, PARTS))[(velocity > 0).astype(int), place]
    return np.asarray(torque + 0.01 * rng.standard_normal(len(position)))


def covered(recording: Recording, disturbance: Disturbance) -> tuple[float, float]:
    """Return how often the intervals of stiffness and damping hold the truth."""
    rows = select_rows(recording, recording.fit_trials, rests=True)
    model = declared_model(recording, rows)
    elbow = (
        STIFFNESS * (recording.position[:, ELBOW] - 0.9) + DAMPING * recording.velocity[:, ELBOW]
    )
    held = []
    for seed in range(DRAWS):
        torque = disturbance(recording, np.random.default_rng(seed))
        effort = recording.inverse.copy()
        effort[:, ELBOW] += elbow + torque
        held.append(holds(model, measured(rows, replace(recording, effort=effort))))
    stiffness, damping = np.mean(held, axis=0)
    return float(stiffness), float(damping)


def measured(rows: Rows, recording: Recording) -> Rows:
    """Return the rows with another effort, low-passed; columns that were stacked stay."""
    filtered = replace(recording, effort=recording.filtered(recording.effort))
    columns = {key: value for key, value in rows.stacked.items() if key[0] == "term"}
    return replace(rows, recording=filtered, stacked=columns)


def holds(model: Model, rows: Rows) -> list[bool]:
    coefficients = evaluate(model, rows).coefficients
    fits = leave_out(model, rows, coefficients)
    found = []
    for key, truth in (("stiffness", STIFFNESS), ("damping", DAMPING)):
        every = np.array([impedances(model, own)[ELBOW][key] for own in fits.coefficients])
        low, high = fits.interval(every, impedances(model, coefficients)[ELBOW][key])
        found.append(low <= truth <= high)
    return found


def test_the_interval_of_a_mean_is_students() -> None:
    sample = np.random.default_rng(3).normal(2.0, 0.5, 7)
    left_out = np.array([np.delete(sample, i).mean() for i in range(7)])
    expected = stats.t.interval(0.9, 6, sample.mean(), stats.sem(sample))
    found = jackknife_interval(sample.mean(), [left_out], sample.mean())
    assert found == pytest.approx(expected)


def test_the_variances_of_two_partitions_add_with_the_t_of_the_fewer_clusters() -> None:
    whole, narrow, wide = 1.0, np.array([1.01, 0.99] * 4), np.array([1.1, 0.9, 1.1, 0.9])
    half = stats.t.ppf(0.95, 3) * np.sqrt(3 / 4 * 4 * 0.01 + 7 / 8 * 8 * 0.0001)
    assert jackknife_interval(whole, [narrow, wide], 1.0) == pytest.approx((1 - half, 1 + half))


def test_an_interval_holds_the_whole_fit_and_ends_at_a_physical_bound() -> None:
    left_out = [np.array([0.2, 0.4, 0.3])]
    low, high = jackknife_interval(0.3, left_out, 0.05, lowest=0.0)
    assert low == 0.0
    assert high >= 0.3


@pytest.mark.parametrize("count", [4, 8])
def test_intervals_hold_the_truth_where_trials_differ(recording: Recording, count: int) -> None:
    stiffness, damping = covered(trials_recording(recording, count), noise_by_trial)
    assert 0.85 <= stiffness <= 0.98
    assert 0.85 <= damping <= 1.0


def test_intervals_hold_the_truth_where_a_misfit_comes_back_in_every_trial(
    recording: Recording,
) -> None:
    stiffness, damping = covered(trials_recording(recording, 8), misfit_by_place)
    assert 0.85 <= stiffness <= 0.98
    assert 0.85 <= damping <= 1.0
