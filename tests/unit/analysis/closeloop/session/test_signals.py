"""What filters and shifts of a signal do."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.signals import (
    derivatives,
    digit_speed,
    lagged,
    last_digit,
    least_digit,
    sampling_at,
    shifted,
    slope,
)


def test_a_delay_and_its_opposite_cancel() -> None:
    t = np.arange(1000) / 200.0
    signal = np.sin(3 * t)[:, None]
    back = shifted(shifted(signal, 0.031, 200.0), -0.031, 200.0)
    assert back[20:-20] == pytest.approx(signal[20:-20], abs=2e-4)


@pytest.mark.parametrize("time_constant", [0.05, 0.004, 0.0007])
def test_a_lag_is_behind_by_its_time_constant_however_coarse_the_samples(
    time_constant: float,
) -> None:
    ramp = np.arange(2000)[:, None] / 200.0
    behind = ramp - lagged(ramp, time_constant, 200.0)
    assert behind[0, 0] == 0.0
    assert behind[-1, 0] == pytest.approx(time_constant, rel=1e-6)


def test_a_slope_is_right_up_to_a_tenth_of_the_sampling_rate() -> None:
    t = np.arange(500) / 100.0
    w = 2 * np.pi * 10.0
    found = slope(np.sin(w * t)[:, None], 100.0)[20:-20, 0]
    assert found == pytest.approx(w * np.cos(w * t)[20:-20], abs=0.002 * w)


@pytest.mark.parametrize("cutoff", [5.0, 10.0])
def test_a_recording_cut_in_motion_keeps_its_acceleration_to_the_ends(cutoff: float) -> None:
    time = np.arange(600) / 100.0
    phase = 2 * np.pi * 0.7 * time + 0.4
    position = np.column_stack([np.sin(phase), 0.2 * np.cos(phase)])
    needed = -((2 * np.pi * 0.7) ** 2) * position
    off = np.abs(derivatives(position, sampling_at(cutoff, 100.0, "session.json"))[2] - needed)
    off /= np.abs(needed).max(axis=0)
    # An extension without curvature is wrong by all of it at the end, and by 5 % a period away.
    period = int(100.0 / cutoff)
    assert off[:2].max() < 0.12 and off[-2:].max() < 0.12
    assert off[period:-period].max() < 0.006


def test_rounding_makes_of_rest_the_speed_that_is_said() -> None:
    """An encoder of 1.5 mrad that flickers between two steps, 100 Hz, low-pass at 8 Hz."""
    rng, sampling = np.random.default_rng(8), sampling_at(8.0, 100.0, "encoder")
    step = 1.5e-3
    rounded = step * np.round(0.3 * rng.standard_normal(20000) + rng.uniform(-0.5, 0.5, 20000))
    _, velocity, _ = derivatives(rounded[:, None], sampling)
    digit = float(np.std(rounded))
    assert digit_speed(digit, sampling) == pytest.approx(float(np.std(velocity)), rel=0.15)


def test_an_encoder_that_flickers_leaves_a_joint_at_rest(recording: Recording) -> None:
    trial = recording.session.trials[0]
    steps = 1.5e-3 * np.round(np.random.default_rng(9).uniform(0.0, 1.2, 400))
    coarse = replace(trial, columns={**trial.columns, "elbow.position": steps})
    session = replace(recording.session, trials=(coarse,))
    seen = replace(recording, session=session, velocity=0.1 * recording.velocity)
    least = 3.0 * digit_speed(1.5e-3 / np.sqrt(12.0), recording.sampling)
    assert seen.rest_speed[1] == pytest.approx(least)
    assert seen.rest_speed[0] == pytest.approx(0.01 * seen.top_speed[0])


def test_a_smooth_motion_that_comes_back_shows_next_to_no_step() -> None:
    """Its places look like steps: a tenth of as many as there are samples."""
    swing = np.tile(np.sin(2 * np.pi * np.arange(200) / 200.0), 20)
    assert least_digit(swing) < 0.2 * last_digit(swing)
    rounded = 1.5e-3 * np.round(swing / 1.5e-3)
    assert least_digit(rounded) == pytest.approx(1.5e-3 / np.sqrt(12.0), rel=1e-3)
