"""The first look at a residual: what it depends on, its period over position, its lags."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.report.diagnostics import diagnose, explained, whiteness
from analysis.closeloop.session.recording import Recording


def diagnosed(recording: Recording, residual: np.ndarray) -> dict:
    effort = recording.inverse.copy()
    effort[:, 1] += residual + 0.02 * np.random.default_rng(3).standard_normal(len(residual))
    measured = replace(recording, effort=recording.filtered(effort), cache={})
    return diagnose(Model(measured), np.empty(0), select_rows(measured, (0,)), 1)


@pytest.mark.parametrize(
    ("signal", "power"),
    [("position", 3), ("acceleration", 1), ("velocity sign", 1), ("time", 1)],
)
def test_the_signal_that_makes_a_residual_stands_first(
    signal: str, power: int, recording: Recording
) -> None:
    made = {
        "position": recording.position[:, 1],
        # At a sine, acceleration is position: only with another frequency are they two.
        "acceleration": recording.acceleration[:, 1],
        "velocity sign": np.sign(recording.velocity[:, 1]),
        "time": recording.time,
    }[signal]
    shares = diagnosed(recording, 0.5 * made**power)["depends_on"]
    assert shares[signal] > 0.9
    if signal != "acceleration":
        assert next(iter(shares)) == signal or shares[next(iter(shares))] - shares[signal] < 0.02


def test_noise_depends_on_nothing(recording: Recording) -> None:
    shares = diagnosed(recording, np.zeros(len(recording.time)))["depends_on"]
    assert max(shares.values()) < 0.2


def test_a_ripple_shows_its_order(recording: Recording) -> None:
    order = diagnosed(recording, 0.5 * np.sin(30.0 * recording.position[:, 1]))["order"]
    assert order["order"] == pytest.approx(30.0, abs=1.5) and order["over_median"] > 5


def test_a_joint_without_rows_has_no_period(recording: Recording) -> None:
    order = diagnose(Model(recording), np.empty(0), select_rows(recording, ()), 1)["order"]
    assert order == {"order": 0.0, "amplitude": 0.0, "over_median": 0.0}


def test_lags_of_filtered_noise_stay_inside_their_bounds_and_those_of_a_tone_do_not(
    recording: Recording,
) -> None:
    rng, t = np.random.default_rng(5), np.arange(6000) / 200.0
    outside = []
    for _ in range(20):
        noise = recording.filtered(np.resize(rng.standard_normal(6000), (6000, 1))[:1000])
        outside.append(whiteness([noise[:, 0]], recording)["outside"])
    assert np.mean(outside) < 0.12
    tone = np.sin(2 * np.pi * 3.0 * t) + 0.5 * rng.standard_normal(6000)
    assert whiteness([tone], recording)["outside"] > 0.5


def test_time_since_reversal_starts_anew_at_each(recording: Recording) -> None:
    since = recording.since_reversal(1)
    turns = np.flatnonzero(np.diff(np.sign(since)) != 0)
    # 0.4 Hz for 5 s: a reversal every 1.25 s.
    assert np.abs(since).max() == pytest.approx(1.25, abs=0.03)
    assert len(turns) >= 3


def test_as_many_functions_of_nothing_explain_nothing() -> None:
    rng = np.random.default_rng(7)
    assert explained(rng.standard_normal(2000), rng.standard_normal(2000)) < 0.02
