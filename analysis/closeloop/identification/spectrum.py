"""Oscillations in a residual that no signal explains: narrow lines, and bands an octave wide.

A pump or the mains makes a line, a tremor or somebody else's motion a band. Coloured noise makes
neither: its spectrum falls from low frequencies on, and has no foot on that side.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.fft import dct, idct
from scipy.signal import welch

from analysis.closeloop.session.signals import rms

#: A line or a band is this many times its surroundings.
RATIO = 12.0
WINDOW_SECONDS = 4.0
#: Shorter stretches have no spectrum.
LEAST_SAMPLES = 256
#: The first of a spectrum's lines that taking the mean away leaves as it was.
LOWEST = 2
#: A band spans so many times its lowest frequency, and its feet lie so many times beyond.
WIDTH, FOOT = 2.0, 4.0
#: Least root mean square of a band over that of the joint's effort, and of a line over that of the
#: effort's own line: what a motion leaves of itself, a fraction of a sample late, drives itself.
MIN_SHARE = 0.01


@dataclass(frozen=True, kw_only=True)
class Peak:
    """A line or band of a spectrum: where it is, and its root mean square."""

    low_hz: float
    high_hz: float
    rms: float


def peaks(
    residuals: list[np.ndarray], efforts: list[np.ndarray], rate: float, highest_hz: float
) -> list[Peak]:
    """Return the narrow lines of a joint's residual, or else its strongest band.

    Args:
        residuals: one array per stretch, even clock.
        efforts: the joint's effort at the same times, in the residual's unit.
        rate: Hz.
        highest_hz: up to where to look for bands; near the cutoff of the kinematics the noise of
            the acceleration makes one.
    """
    frequency, power = _spectrum(residuals, rate)
    effort = _spectrum(efforts, rate)[1]
    # A controller that is slower than the recorder leaves every other sample older than the one
    # before: what the motion drives comes back as far below half of the rate, and as large as half
    # of what it changes by from one sample to the next.
    image = np.maximum(MIN_SHARE, np.sin(np.pi * frequency[::-1] / rate)) ** 2 * effort[::-1]
    return _lines(frequency, power, np.maximum(MIN_SHARE**2 * effort, image)) or _bands(
        frequency[frequency <= FOOT * highest_hz],
        power,
        MIN_SHARE * rms(np.concatenate(efforts)),
    )


def strongest_line(residuals: list[np.ndarray], rate: float) -> Peak | None:
    """Return the narrow line of a joint's residual that has the most power, if there is one.

    Args: as of `peaks`.
    """
    frequency, power = _spectrum(residuals, rate)
    lines = _lines(frequency, power, np.zeros(len(power)))
    return max(lines, key=lambda line: line.rms, default=None)


def below(signals: np.ndarray, cutoff: float, rate: float, pieces: Sequence[slice]) -> np.ndarray:
    """Return what of signals, (n, k), lies below a frequency, Hz.

    By cosines, whose even continuation makes nothing of where a piece begins.
    """
    out = np.empty_like(signals)
    for piece in pieces:
        spectrum = dct(signals[piece], axis=0)
        spectrum[np.arange(len(spectrum)) >= 2.0 * len(spectrum) * cutoff / rate] = 0.0
        out[piece] = idct(spectrum, axis=0)
    return out


def _spectrum(residuals: list[np.ndarray], rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies and the mean power of the stretches that are long enough, (lines,)."""
    long = [residual for residual in residuals if len(residual) >= LEAST_SAMPLES]
    if not long:
        return np.empty(0), np.empty(0)
    window = min(int(WINDOW_SECONDS * rate), min(len(residual) for residual in long))
    spectra = [welch(residual, rate, nperseg=window, detrend="constant") for residual in long]
    lengths = [len(residual) for residual in long]
    power = np.average([spectrum[1] for spectrum in spectra], axis=0, weights=lengths)
    return spectra[0][0], np.asarray(power)


def _lines(frequency: np.ndarray, power: np.ndarray, least: np.ndarray) -> list[Peak]:
    """Return what stands out on both sides: without one below, a line is a slope's upper end.

    Args:
        frequency: of the spectrum's lines, Hz, (lines,).
        power: at each.
        least: power that an oscillation has there.
    """
    lines = []
    for i in range(LOWEST + 4, len(power) - 4):
        sides = power[max(LOWEST, i - 24) : i - 3], power[i + 4 : i + 25]
        # Beside the line's height it must rise above everything near, or it is a slope's end.
        highest = power[i] == power[i - 3 : i + 4].max()
        highest = highest and power[i] > 3.0 * max(side.max(initial=0.0) for side in sides)
        around = max(float(np.median(side)) for side in sides if len(side))
        if highest and power[i] > RATIO * around:
            near = slice(i - 2, i + 3)
            if power[near].sum() <= least[near].sum():
                continue
            size = float(np.sqrt(power[near].sum() * frequency[1]))
            at = float(frequency[i])
            lines.append(Peak(low_hz=0.9 * at, high_hz=1.1 * at, rms=size))
    return lines


def _bands(frequency: np.ndarray, power: np.ndarray, least: float) -> list[Peak]:
    """Return the band with the most power, if it stands above what is below and above it."""
    found = []
    power = power[: len(frequency)]
    for low in frequency[2:]:
        high = WIDTH * low
        if FOOT * high > frequency[-1]:
            break
        inside = (frequency >= low) & (frequency <= high)
        feet = (
            (frequency > 0) & (frequency <= low / 2.0),
            (frequency >= 2.0 * high) & (frequency <= FOOT * high),
        )
        around = max(float(power[foot].mean()) for foot in feet)
        size = float(np.sqrt(power[inside].sum() * frequency[1]))
        if size > least and float(power[inside].mean()) > RATIO * around:
            found.append(Peak(low_hz=float(low), high_hz=float(high), rms=size))
    return [max(found, key=lambda peak: peak.rms)] if found else []
