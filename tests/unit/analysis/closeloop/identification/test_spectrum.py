"""Oscillations that depend on nothing recorded are seen; coloured noise is not one."""

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from analysis.closeloop.identification.spectrum import peaks

RATE = 200.0


def stretches(
    signal: object = None, *, noise: float = 0.1, colour: float = 0.0
) -> list[np.ndarray]:
    """Return five residuals of 12 s: noise, and `signal` of time in each of them."""
    rng = np.random.default_rng(2)
    found = []
    for number in range(5):
        time = 12.0 * number + np.arange(2400) / RATE
        residual = lfilter([1.0], [1.0, -colour], noise * rng.standard_normal(len(time)))
        found.append(residual + (signal(time) if callable(signal) else 0.0))
    return found


def motion(size: float = 3.0, frequency: float = 0.7) -> list[np.ndarray]:
    """Return the efforts of a motion of one frequency, of a root mean square `size`."""
    return stretches(lambda t: size * np.sqrt(2.0) * np.sin(2 * np.pi * frequency * t), noise=0.01)


def test_white_noise_has_no_peaks() -> None:
    assert peaks(stretches(), motion(), RATE, highest_hz=10.0) == []


@pytest.mark.parametrize("colour", [0.8, 0.95, 0.99])
def test_coloured_noise_has_no_peaks(colour: float) -> None:
    assert peaks(stretches(colour=colour), motion(), RATE, highest_hz=10.0) == []


@pytest.mark.parametrize("seed", range(6))
def test_slow_noise_is_no_line_for_want_of_anything_below_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    slow = butter(2, 1.1, fs=RATE)
    found = [
        lfilter(*slow, rng.standard_normal(1200)) + 0.005 * rng.standard_normal(1200)
        for _ in range(5)
    ]
    assert peaks(found, motion(), RATE, highest_hz=10.0) == []


@pytest.mark.parametrize("frequency", [2.0, 50.0], ids=["a slow oscillation", "the mains"])
def test_an_oscillation_and_the_mains_are_a_line(frequency: float) -> None:
    (line,) = peaks(
        stretches(lambda t: 0.2 * np.sin(2 * np.pi * frequency * t)),
        motion(),
        RATE,
        highest_hz=10.0,
    )
    assert line.low_hz < frequency < line.high_hz
    assert line.rms == pytest.approx(0.2 / np.sqrt(2), rel=0.1)


@pytest.mark.parametrize("frequency", [2.0, RATE / 2 - 2.0], ids=["late", "late by turns"])
def test_what_a_motion_leaves_of_itself_is_no_oscillation(frequency: float) -> None:
    """A motion of 2 Hz and 60 Nm, logged half a millisecond late, leaves a line of 0.6 Nm."""
    left = stretches(lambda t: 0.5 * np.sin(2 * np.pi * frequency * t))
    assert peaks(left, motion(60.0, 2.0), RATE, highest_hz=10.0) == []
    assert peaks(left, motion(60.0, 0.7), RATE, highest_hz=10.0) != []


def test_every_other_effort_a_sample_old_is_no_oscillation() -> None:
    """Of a motion of 3 Hz it leaves a twentieth of the effort. (Two clean limbs of our own.)"""
    efforts = motion(2.0, 3.0)
    left = []
    for effort in efforts:
        old = effort.copy()
        old[1::2] = effort[:-1:2]
        left.append(old - effort)
    assert np.std(left[0]) > 0.04 * np.std(efforts[0])
    image = [own - np.convolve(own, [0.25, 0.5, 0.25], mode="same") for own in left]
    assert peaks(image, efforts, RATE, highest_hz=10.0) == []
    assert peaks([3.0 * own for own in image], efforts, RATE, highest_hz=10.0) != []


def tremor(time: np.ndarray) -> np.ndarray:
    return 0.5 * np.sin(2 * np.pi * 5.0 * time + 3.0 * np.sin(2 * np.pi * 0.4 * time))


def test_a_tremor_is_a_band() -> None:
    (band,) = peaks(stretches(tremor), motion(), RATE, highest_hz=10.0)
    assert band.low_hz < 5.0 < band.high_hz
    assert band.rms == pytest.approx(0.5 / np.sqrt(2), rel=0.2)


def test_a_band_that_matters_to_nobody_is_not_told() -> None:
    assert peaks(stretches(tremor), motion(100.0), RATE, highest_hz=10.0) == []


def test_noise_of_the_acceleration_near_the_cutoff_is_no_band() -> None:
    assert peaks(stretches(tremor), motion(), RATE, highest_hz=2.0) == []


def test_stretches_that_are_too_short_say_nothing() -> None:
    assert peaks([np.ones(100)], [np.ones(100)], RATE, highest_hz=10.0) == []
