"""Intervals hold the truth as often as they say, over many draws of what makes them necessary."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter

from analysis.closeloop.identification.balance.declared import declared_model
from analysis.closeloop.identification.balance.model import Model, evaluate, impedances
from analysis.closeloop.identification.balance.regression import Rows, select_rows
from analysis.closeloop.identification.balance.uncertainty import (
    CUTS,
    leave_out,
    variance,
)
from analysis.closeloop.session.contents import DeclaredEffect, Trial
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.signals import Sampling
from sim.effects.catalogue import VISCOELASTIC

RATE, SECONDS, ELBOW = 50.0, 6.0, 1
STIFFNESS, DAMPING = 4.0, 0.4
DRAWS = 150
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
    declared = (DeclaredEffect(effect=VISCOELASTIC.name, joint="elbow"),)
    return Recording(
        device=recording.device,
        session=replace(recording.session, trials=trials, declared=declared),
        sampling=Sampling(recorded=RATE, working=RATE, cutoff=15.0),
        slices=[slice(i * size, (i + 1) * size) for i in range(count)],
        trial=np.repeat(np.arange(count), size),
        time=np.arange(count * size) / RATE,
        position=motion[0] + [0.0, 1.0],
        velocity=motion[1],
        acceleration=motion[2],
        effort=np.zeros_like(motion[0]),
        measured=np.ones(count * size),
        extra=np.empty((count * size, 0)),
        extra_names=(),
        joints=(ELBOW,),
        fit_trials=tuple(range(count)),
    )


def plain_noise(recording: Recording, rng: np.random.Generator) -> np.ndarray:
    """White noise alone."""
    return np.asarray(0.1 * rng.standard_normal(len(recording.time)))


def coloured_noise(recording: Recording, rng: np.random.Generator) -> np.ndarray:
    """Noise that remembers half a second."""
    return np.asarray(lfilter([1.0], [1.0, -0.96], 0.02 * rng.standard_normal(len(recording.time))))


def noise_by_trial(recording: Recording, rng: np.random.Generator) -> np.ndarray:
    """A stiffness that differs a little from trial to trial, and coloured noise."""
    every = 0.05 * rng.standard_normal(len(recording.session.trials))
    coloured = lfilter([1.0], [1.0, -0.95], 0.02 * rng.standard_normal(len(recording.time)))
    return np.asarray(every[recording.trial] * recording.position[:, ELBOW] + coloured)


def misfit_by_place(recording: Recording, rng: np.random.Generator) -> np.ndarray:
    """A torque of place and direction that comes back in every trial, and a little noise."""
    position, velocity = recording.position[:, ELBOW], recording.velocity[:, ELBOW]
    share = (position - position.min()) / np.ptp(position)
    count = CUTS[0][1]
    place = np.minimum((share * count).astype(int), count - 1)
    torque = 0.1 * rng.standard_normal((2, count))[(velocity > 0).astype(int), place]
    return np.asarray(torque + 0.01 * rng.standard_normal(len(position)))


def smooth_misfit(recording: Recording, rng: np.random.Generator) -> np.ndarray:
    """A torque over the angle that is smooth over a third of the range, and a little noise."""
    position = recording.position[:, ELBOW]
    share = (position - position.min()) / np.ptp(position)
    torque = np.interp(share, np.linspace(0.0, 1.0, 7), 0.1 * rng.standard_normal(7))
    return np.asarray(torque + 0.01 * rng.standard_normal(len(position)))


def misfit_by_speed(recording: Recording, rng: np.random.Generator) -> np.ndarray:
    """A torque that is smooth over the velocity, and a little noise."""
    velocity = recording.velocity[:, ELBOW]
    share = (velocity - velocity.min()) / np.ptp(velocity)
    torque = np.interp(share, np.linspace(0.0, 1.0, 7), 0.1 * rng.standard_normal(7))
    return np.asarray(torque + 0.01 * rng.standard_normal(len(velocity)))


def covered(recording: Recording, disturbance: Disturbance) -> tuple[np.ndarray, np.ndarray]:
    """Return how often intervals of stiffness and damping hold the truth, and how wide they are.

    The width is relative to that of the interval which one would give who knew how the estimates
    scatter over all draws.
    """
    rows = select_rows(recording, recording.fit_trials, rests=True)
    model = declared_model(recording, rows)
    elbow = (
        STIFFNESS * (recording.position[:, ELBOW] - 0.9) + DAMPING * recording.velocity[:, ELBOW]
    )
    ends = []
    for seed in range(DRAWS):
        torque = disturbance(recording, np.random.default_rng(seed))
        effort = recording.inverse.copy()
        effort[:, ELBOW] += elbow + torque
        ends.append(intervals(model, measured(rows, replace(recording, effort=effort))))
    low, high = np.moveaxis(ends, 2, 0)
    truth = np.array([STIFFNESS, DAMPING])
    ideal = 2 * stats.norm.ppf(0.95) * ((low + high) / 2).std(axis=0)
    return ((low <= truth) & (truth <= high)).mean(axis=0), np.median(high - low, axis=0) / ideal


def measured(rows: Rows, recording: Recording) -> Rows:
    """Return the rows with another effort, low-passed; columns that were stacked stay."""
    filtered = replace(recording, effort=recording.filtered(recording.effort))
    columns = {key: value for key, value in rows.stacked.items() if key[0] == "term"}
    return replace(rows, recording=filtered, stacked=columns)


def intervals(model: Model, rows: Rows) -> list[tuple[float, float]]:
    """Return the intervals of stiffness and damping."""
    coefficients = evaluate(model, rows).coefficients
    fits = leave_out(model, rows, coefficients)
    found = []
    for key in ("stiffness", "damping"):
        every = np.array([impedances(model, own)[ELBOW][key] for own in fits.coefficients])
        found.append(fits.interval(every, impedances(model, coefficients)[ELBOW][key]))
    return found


def test_white_noise_makes_of_every_partition_what_the_columns_say(recording: Recording) -> None:
    session = trials_recording(recording, 4)
    rows = select_rows(session, session.fit_trials, rests=True)
    model = declared_model(session, rows)
    base, _ = model.base(rows)
    truth = np.array([STIFFNESS, DAMPING, -0.9 * STIFFNESS])
    found, expected = [], []
    for seed in range(DRAWS):
        noisy = base @ truth + np.random.default_rng(seed).standard_normal(len(base))
        rows.stacked["target", id(model.given), model.channel_key] = (model.given, noisy)
        fits = leave_out(model, rows, truth)
        stiffness = np.split(fits.coefficients[4:, 0], np.cumsum(fits.sizes)[:-1])
        found.append([variance(fits.coefficients[0, 0], part) for part in stiffness])
        expected.append([white[0, 0] for white in fits.white])
    assert np.mean(found, axis=0) == pytest.approx(np.mean(expected, axis=0), rel=0.2)


def test_a_single_second_has_intervals_too(recording: Recording) -> None:
    session = trials_recording(recording, 1)
    rows = select_rows(session, (0,), rests=True)
    rows = replace(rows, block=np.zeros_like(rows.block))
    effort = session.inverse.copy()
    effort[:, ELBOW] += STIFFNESS * (session.position[:, ELBOW] - 0.9)
    model = declared_model(session, rows)
    own = measured(rows, replace(session, effort=effort))
    fits = leave_out(model, own, evaluate(model, own).coefficients)
    assert np.all(np.isfinite(fits.coefficients))
    assert len(fits.coefficients) == 1 + len(fits.steps) + sum(fits.sizes)


@pytest.mark.parametrize("disturbance", [plain_noise, coloured_noise, noise_by_trial])
def test_intervals_hold_the_truth_and_are_little_wider_than_need_be(
    recording: Recording, disturbance: Disturbance
) -> None:
    held, width = covered(trials_recording(recording, 8), disturbance)
    assert np.all((held >= 0.84) & (held <= 0.98))
    # Student's t for eight trials alone is 1.15 times as wide as the normal distribution; if noise
    # counted twice, the stiffness would have 1.69.
    assert np.all(width < [1.6, 1.65])


@pytest.mark.parametrize("disturbance", [misfit_by_place, smooth_misfit, misfit_by_speed])
def test_intervals_hold_the_truth_where_a_misfit_comes_back_in_every_trial(
    recording: Recording, disturbance: Disturbance
) -> None:
    held, _ = covered(trials_recording(recording, 8), disturbance)
    assert np.all(held >= 0.84)


def test_few_trials_widen_the_intervals(recording: Recording) -> None:
    held, width = covered(trials_recording(recording, 4), noise_by_trial)
    assert np.all(held >= 0.84)
    assert np.all(width > 1.15)
