"""The signal chain: even clock, smooth kinematics, and one low-pass for data and candidates alike.

Positions are smoothed by a zero-phase Butterworth filter and differentiated centrally, as is usual
for identification by inverse dynamics (Gautier 1997; Janot, Vandanjon and Gautier 2014). Effort is
never smoothed where errors are reported; for fitting, effort and every regressor pass the same
low-pass, so that what the filter takes away it takes from both sides.
"""

import itertools
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.signal import butter, lfilter, lfilter_zi, welch

from analysis.closeloop.session.device import Device
from analysis.closeloop.session.reading import Trial

#: Steps longer than this many medians are gaps; nothing is interpolated across one.
GAP_STEPS = 5.0
#: Shortest stretch between gaps that is analysed, s.
MIN_STRETCH = 0.5
#: Bounds of the kinematic cutoff, Hz.
CUTOFFS = (8.0, 60.0)
#: Rate at which regressors are computed, over the cutoff; at least this many Hz if recorded so.
OVERSAMPLING, MIN_RATE = 8.0, 200.0
#: The fit's low-pass over the kinematic cutoff: below it, smoothing has hardly touched the motion.
FIT_SHARE = 0.5
#: A joint counts as at rest below this share of its fastest motion.
REST_SHARE = 0.01


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """An evenly sampled piece of a trial at the recorded rate; arrays have shape (n, joints)."""

    trial: int
    time: np.ndarray
    position: np.ndarray
    #: NaN where a joint has no effort.
    effort: np.ndarray
    extra: np.ndarray


@dataclass(frozen=True)
class Sampling:
    """Rates of a session, Hz."""

    recorded: float
    working: float
    cutoff: float

    @property
    def decimation(self) -> int:
        return max(1, round(self.recorded / self.working))

    @property
    def fit_cutoff(self) -> float:
        return FIT_SHARE * self.cutoff


def stretches(trials: tuple[Trial, ...], device: Device) -> tuple[list[Stretch], float]:
    """Bring every trial to the session's one even clock and split it at gaps.

    Returns:
        The stretches in order, and their common rate in Hz.
    """
    step = float(np.median([np.median(np.diff(trial.time)) for trial in trials]))
    names = extra_columns(trials, device)
    pieces = []
    for number, trial in enumerate(trials):
        gaps = np.flatnonzero(np.diff(trial.time) > GAP_STEPS * max(step, _step(trial)))
        bounds = [0, *(gaps + 1), len(trial.time)]
        for start, stop in itertools.pairwise(bounds):
            raw = trial.time[start:stop]
            if stop - start < 20 or raw[-1] - raw[0] < MIN_STRETCH:
                continue
            time = raw[0] + step * np.arange(int((raw[-1] - raw[0]) / step + 1e-6) + 1)
            pieces.append(
                Stretch(
                    trial=number,
                    time=time,
                    position=_resampled(trial, device, raw, time, start, stop, "position"),
                    effort=_resampled(trial, device, raw, time, start, stop, "effort"),
                    extra=np.column_stack(
                        [
                            np.interp(time, raw, trial.columns[name][start:stop])
                            if name in trial.columns
                            else np.full(len(time), np.nan)
                            for name in names
                        ]
                        or [np.empty((len(time), 0))]
                    ),
                )
            )
    return pieces, 1.0 / step


def extra_columns(trials: tuple[Trial, ...], device: Device) -> tuple[str, ...]:
    """Return the columns that are no joint's own signal, in order of appearance."""
    own = {
        f"{joint}.{word}"
        for joint in device.joints
        for word in ("position", "velocity", "acceleration", "effort")
    }
    names = dict.fromkeys(name for trial in trials for name in trial.columns if name not in own)
    return tuple(names)


def _step(trial: Trial) -> float:
    return float(np.median(np.diff(trial.time)))


def _resampled(
    trial: Trial,
    device: Device,
    raw: np.ndarray,
    time: np.ndarray,
    start: int,
    stop: int,
    word: str,
) -> np.ndarray:
    columns = []
    for joint in device.joints:
        signal = trial.columns.get(f"{joint}.{word}")
        if signal is None or (joint in device.ignored_joints and word == "position"):
            fill = device.reference[device.dof(joint)] if word == "position" else np.nan
            columns.append(np.full(len(time), fill))
        else:
            columns.append(np.interp(time, raw, signal[start:stop]))
    return np.column_stack(columns)


def choose_sampling(pieces: list[Stretch], rate: float, moving: np.ndarray) -> Sampling:
    """Choose the kinematic cutoff where motion sinks into the encoder's noise.

    Args:
        pieces: the stretches.
        rate: their rate, Hz.
        moving: which joints move, shape (joints,).
    """
    highest = CUTOFFS[0]
    for piece in pieces:
        for joint in np.flatnonzero(moving):
            signal = piece.position[:, joint]
            if np.ptp(signal) < 1e-6 or len(signal) < 64:
                continue
            window = min(len(signal), max(64, int(4.0 * rate)))
            frequency, power = welch(signal, rate, nperseg=window, detrend="linear")
            floor = float(np.median(power[frequency > 0.25 * rate]))
            clear = power > 20.0 * floor
            # The first frequency from which on motion no longer stands out.
            end = int(np.argmin(clear[1:])) + 1 if not clear[1:].all() else len(clear) - 1
            highest = max(highest, 1.5 * float(frequency[end]))
    cutoff = min(highest, CUTOFFS[1], rate / 5.0)
    working = rate / max(1, int(rate / max(MIN_RATE, OVERSAMPLING * cutoff)))
    return Sampling(recorded=rate, working=working, cutoff=cutoff)


def lowpass(signal: np.ndarray, cutoff: float, rate: float, order: int = 4) -> np.ndarray:
    """Return `signal` without what lies above `cutoff`, without delay; shape (n, ...)."""
    if cutoff >= 0.45 * rate or len(signal) < 4 * order:
        return np.array(signal)
    padding = min(len(signal) - 1, int(3 * rate / cutoff))
    # As scipy's sosfiltfilt, which designs its initial state anew at every call.
    extended = np.concatenate(
        [
            2 * signal[:1] - signal[padding:0:-1],
            signal,
            2 * signal[-1:] - signal[-2 : -padding - 2 : -1],
        ]
    )
    sections = _butterworth(order // 2, cutoff / (0.5 * rate))
    shape = (-1, *([1] * (signal.ndim - 1)))
    for _ in ("forwards", "backwards"):
        for numerator, denominator, state in sections:
            start = state.reshape(shape) * extended[:1]
            extended, _ = lfilter(numerator, denominator, extended, axis=0, zi=start)
        extended = extended[::-1]
    return np.ascontiguousarray(extended[padding : len(extended) - padding])


@cache
def _butterworth(order: int, cutoff: float) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return numerator, denominator and settled state for a unit input of every section."""
    sections = butter(order, cutoff, output="sos")
    return [(s[:3], s[3:], lfilter_zi(s[:3], s[3:])) for s in sections]


def derivatives(position: np.ndarray, sampling: Sampling) -> tuple[np.ndarray, ...]:
    """Return smoothed position, velocity and acceleration at the working rate, each (m, joints)."""
    smooth = lowpass(position, sampling.cutoff, sampling.recorded, order=8)
    step = 1.0 / sampling.recorded
    velocity = np.gradient(smooth, step, axis=0)
    acceleration = np.gradient(velocity, step, axis=0)
    every = slice(None, None, sampling.decimation)
    return smooth[every], velocity[every], acceleration[every]


def shifted(signal: np.ndarray, seconds: float, rate: float) -> np.ndarray:
    """Return signal(t + seconds) along the first axis, ends held."""
    n = len(signal)
    at = np.clip(np.arange(n) + seconds * rate, 0, n - 1)
    low = np.minimum(at.astype(int), n - 2)
    part = (at - low).reshape(-1, *([1] * (signal.ndim - 1)))
    return np.asarray(signal[low] * (1 - part) + signal[low + 1] * part)


def lagged(signal: np.ndarray, time_constant: float, rate: float) -> np.ndarray:
    """Return `signal` behind a first-order low-pass of `time_constant` seconds."""
    share = 1.0 - np.exp(-1.0 / (rate * time_constant))
    start = (1.0 - share) * signal[:1]
    filtered, _ = lfilter([share], [1.0, share - 1.0], signal, axis=0, zi=start)
    return np.asarray(filtered)
