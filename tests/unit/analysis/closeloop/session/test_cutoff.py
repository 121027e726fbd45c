"""The cutoff of the positions: the torque says how much of the encoder's noise it can bear."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from analysis.closeloop.errors import SessionError
from analysis.closeloop.session.contents import Session, Trial
from analysis.closeloop.session.cutoff import noisy
from analysis.closeloop.session.device import Device
from analysis.closeloop.session.files import Fields
from analysis.closeloop.session.reading import _cutoff_hz
from analysis.closeloop.session.signals import Sampling
from analysis.closeloop.session.stretches import record

RATE = 250.0
PENDULUM = """<mujoco><worldbody><body name="bar"><joint name="pivot" axis="0 -1 0"/>
<inertial pos="0 0 -.3" mass="0.6" diaginertia="0.004 0.004 0.001"/></body></worldbody></mujoco>"""


def chosen(*, encoder: float, late: float = 0.0, own: float | None = None) -> Sampling:
    """Return the rates for a pendulum that swings at up to 2 Hz.

    Args:
        encoder: noise of the position, rad.
        late: how far the torque is behind the effort, s.
        own: the session's own cutoff.
    """
    rng = np.random.default_rng(7)
    t = np.arange(0.0, 8.0, 1.0 / RATE)
    parts = [(0.6, 0.5), (0.3, 1.1), (0.12, 2.0)]
    phase = rng.uniform(0.0, 6.0, 3)

    def motion(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        w = [2 * np.pi * f for _, f in parts]
        q = sum(a * np.sin(k * at + p) for (a, _), k, p in zip(parts, w, phase, strict=True))
        acceleration = sum(
            -a * k * k * np.sin(k * at + p) for (a, _), k, p in zip(parts, w, phase, strict=True)
        )
        return np.asarray(q), np.asarray(acceleration)

    q, _ = motion(t)
    at, acceleration = motion(t + late)
    effort = 0.058 * acceleration + 0.6 * 9.81 * 0.3 * np.sin(at)
    effort += 0.02 * rng.standard_normal(len(t))
    columns = {
        "pivot.position": q + encoder * rng.standard_normal(len(t)),
        "pivot.effort": effort,
    }
    trial = Trial(file="a.csv", label="a", group="a", role="fit", time=t, columns=columns)
    session = Session(folder=Path(), model="device.xml", trials=(trial,), kinematic_cutoff_hz=own)
    return record(session, Device(mujoco.MjSpec.from_string(PENDULUM), ())).sampling


def test_a_noisy_encoder_is_smoothed_more_where_the_torque_feels_it() -> None:
    fine, coarse = chosen(encoder=1e-6), chosen(encoder=1e-3)
    assert fine.cutoff > 1.5 * coarse.cutoff
    assert 2.5 <= coarse.cutoff <= 8.0 and coarse.cutoff_from == "torque"


def test_a_late_torque_is_no_reason_to_smooth_the_motion_away() -> None:
    assert chosen(encoder=1e-6, late=0.04).cutoff >= 0.8 * chosen(encoder=1e-6).cutoff


@pytest.mark.parametrize(
    ("errors", "noise"),
    [
        # Flat: nothing to gain below.
        ({4.0: 1.3, 5.0: 1.1, 6.0: 1.0, 8.0: 1.0, 10.0: 1.0, 12.0: 1.001}, False),
        # Ever steeper: the encoder.
        ({4.0: 1.05, 5.0: 1.01, 6.0: 1.0, 8.0: 1.0, 10.0: 1.003, 12.0: 1.012}, True),
        # Ever flatter: the model lacks something, and smoothing hides it.
        ({4.0: 1.0, 5.0: 1.025, 6.0: 1.045, 8.0: 1.053, 10.0: 1.058, 12.0: 1.062}, False),
        # More than any lack of a model does.
        ({4.0: 1.0, 5.0: 1.2, 6.0: 1.4, 8.0: 1.6, 10.0: 1.7, 12.0: 1.75}, True),
    ],
)
def test_noise_grows_ever_faster_with_the_cutoff(errors: dict[float, float], noise: bool) -> None:
    assert noisy(12.0, list(errors), errors.__getitem__) is noise


def test_a_session_may_say_its_own_cutoff() -> None:
    sampling = chosen(encoder=1e-3, own=7.5)
    assert (sampling.cutoff, sampling.cutoff_from) == (7.5, "session.json")
    assert chosen(encoder=1e-3, own=900.0).cutoff == pytest.approx(0.4 * RATE)


def test_a_cutoff_is_a_positive_number() -> None:
    fields = Fields({"kinematic_cutoff_hz": 0}, "session.json")
    with pytest.raises(SessionError, match=r"must be more than 0\.1"):
        _cutoff_hz(fields)
    assert replace(chosen(encoder=1e-6, own=6.0), cutoff=3.0).fit_cutoff == 1.5


@pytest.mark.parametrize(("hertz", "quick"), [(4.0, False), (28.0, True)])
def test_a_quick_motor_of_a_slow_log_is_smoothed_less_as_far_as_its_torque_gains(
    hertz: float, quick: bool
) -> None:
    """Two strangers' bare motors lost a tenth of their torque above a fifth of the rate."""
    rate, inertia, count = 100.0, 0.06, 2000
    rng = np.random.default_rng(8)
    # Every frequency up to some takes the same torque.
    w = 2.0 * np.pi * np.fft.rfftfreq(count, 1.0 / rate)
    inside = (w > np.pi) & (w < 2.0 * np.pi * hertz)
    waves = np.where(inside, np.exp(2j * np.pi * rng.random(len(w))), 0.0)
    scale = 20.0 / np.std(np.fft.irfft(waves))
    position = -scale * np.fft.irfft(waves / np.maximum(w, np.pi) ** 2)
    effort = inertia * scale * np.fft.irfft(waves)
    columns = {
        "pivot.position": position + 1e-6 * rng.standard_normal(count),
        "pivot.effort": effort + 0.02 * rng.standard_normal(count),
    }
    t = np.arange(count) / rate
    trial = Trial(file="a.csv", label="a", group="a", role="fit", time=t, columns=columns)
    session = Session(folder=Path(), model="device.xml", trials=(trial,), gravity=(0.0, 0.0, 0.0))
    sampling = record(session, Device(mujoco.MjSpec.from_string(PENDULUM), ())).sampling
    assert (sampling.cutoff > 0.21 * rate) == quick
    assert sampling.cutoff <= 0.3 * rate * (1.0 + 1e-9)
    assert not quick or sampling.cutoff_from == "torque"
