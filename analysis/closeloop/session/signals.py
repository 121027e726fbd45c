"""The signal chain: even clock, smooth kinematics, and one low-pass for data and candidates alike.

Positions are smoothed by a zero-phase Butterworth filter and differentiated, as is usual for
identification by inverse dynamics (Gautier 1997; Janot, Vandanjon and Gautier 2014). Effort is
never smoothed where errors are reported; for fitting, effort and every regressor pass the same
low-pass, so that what the filter takes away it takes from both sides.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.linalg.lapack import dgttrf, dgttrs
from scipy.signal import butter, lfilter, lfilter_zi

#: Rate at which regressors are computed, over the cutoff; at least this many Hz if recorded so.
OVERSAMPLING, MIN_RATE = 8.0, 200.0
#: The fit's low-pass over the kinematic cutoff: below it, smoothing has hardly touched the motion.
FIT_SHARE = 0.5
#: Rows of which the filter sees a smaller share of measured samples are left out.
LEAST_MEASURED = 0.5
#: Length at the ends of a recording that its curvature there is judged by, over the period of the
#: cutoff, and the order of the polynomial: of those tried on sums of sines below a third of the
#: cutoff and an encoder of 16 bits, the least error of acceleration there.
ENDS, ENDS_ORDER = 1.5, 4
#: A joint counts as at rest below this share of its fastest motion.
REST_SHARE = 0.01
#: ... or below this many times the speed that its encoder's last digit makes of rest.
FLICKERS = 3.0
#: Steps that are less than this share of the others are arithmetic.
ROUNDED = 1e-6


@dataclass(frozen=True)
class Sampling:
    """Rates of a session, Hz."""

    recorded: float
    working: float
    #: Of the positions' low-pass.
    cutoff: float
    #: What chose it: "torque", "encoder" or "session.json".
    cutoff_from: str = "session.json"

    @property
    def decimation(self) -> int:
        return max(1, round(self.recorded / self.working))

    @property
    def fit_cutoff(self) -> float:
        return FIT_SHARE * self.cutoff


def sampling_at(cutoff: float, rate: float, cutoff_from: str) -> Sampling:
    """Return the rates for a kinematic cutoff, Hz, and a recorded rate, Hz."""
    working = rate / max(1, int(rate / max(MIN_RATE, OVERSAMPLING * cutoff)))
    return Sampling(recorded=rate, working=working, cutoff=cutoff, cutoff_from=cutoff_from)


def last_digit(signal: np.ndarray) -> float:
    """Return what rounding to a channel's steps leaves, or 0 if it shows no steps."""
    levels = np.unique(signal)
    if len(levels) < 2 or len(levels) > 0.2 * len(signal):
        return 0.0
    return float(np.median(np.diff(levels)) / np.sqrt(12.0))


def least_digit(signal: np.ndarray) -> float:
    """Return the same by the least step: a smooth motion comes back to places further apart."""
    if last_digit(signal) == 0.0:
        return 0.0
    steps = np.diff(np.unique(signal))
    return float(steps[steps > ROUNDED * np.median(steps)].min() / np.sqrt(12.0))


def digit_speed(digit: float, sampling: Sampling) -> float:
    """Return the speed that rounding a position makes of rest, in root mean square.

    White noise of `digit`, differentiated and passed through the positions' low-pass.

    Args:
        digit: what rounding leaves (`last_digit`), rad or m.
        sampling: of the session.
    """
    band = sampling.cutoff**3 / (1.5 * sampling.recorded)
    return float(2.0 * np.pi * digit * np.sqrt(band))


def rms(signal: np.ndarray) -> float:
    """Return the root mean square of a signal."""
    return float(np.sqrt(np.mean(signal**2)))


class MeasuredLowpass:
    """Takes away what lies above `cutoff`, missing samples left out.

    Every sample counts by its share of measured ones, and the filter's output is divided by what it
    gives for those shares (normalised convolution, Knutsson and Westin 1993); where it sees too few
    of them, a straight line goes from one side to the other. All of it is linear, so what is
    missing is missing on both sides of a regression alike.

    Args:
        measured: share of measured samples at each, 0 to 1, (n,).
        cutoff: Hz.
        rate: Hz.
    """

    def __init__(self, measured: np.ndarray, cutoff: float, rate: float) -> None:
        self._cutoff, self._rate = cutoff, rate
        self._whole = bool(measured.all() and np.ptp(measured) == 0.0)
        self._weight = measured
        if not self._whole:
            share = lowpass(measured, cutoff, rate)
            self._share = np.maximum(share, LEAST_MEASURED)
            self._line = _Line(share < LEAST_MEASURED)

    def __call__(self, signal: np.ndarray) -> np.ndarray:
        """Return what is left of `signal`, (n, ...); what stands at a missing sample is nothing."""
        return self.over_share(lowpass(self.by_share(signal), self._cutoff, self._rate))

    def by_share(self, signal: np.ndarray) -> np.ndarray:
        """Return a signal, (n, ...), by the share of each sample: what is passed."""
        return signal if self._whole else signal * _on_rows(self._weight, signal)

    def over_share(self, passed: np.ndarray) -> np.ndarray:
        """Return what was passed, (n, ...), by what was passed of the shares."""
        return passed if self._whole else self._line(passed / _on_rows(self._share, passed))


class PiecesLowpass:
    """`MeasuredLowpass` of each of several pieces, those of one length at once: much quicker.

    Args:
        measured: share of measured samples at each, 0 to 1, (n,).
        pieces: of the samples, one after the other.
        cutoff: Hz.
        rate: Hz.
    """

    def __init__(
        self, measured: np.ndarray, pieces: Sequence[slice], cutoff: float, rate: float
    ) -> None:
        self._cutoff, self._rate = cutoff, rate
        self._alike: dict[int, list[tuple[slice, MeasuredLowpass]]] = {}
        for own in pieces:
            low = MeasuredLowpass(measured[own], cutoff, rate)
            self._alike.setdefault(own.stop - own.start, []).append((own, low))

    def __call__(self, signal: np.ndarray) -> np.ndarray:
        """Return what is left of `signal`, (n, ...)."""
        found = np.empty(signal.shape)
        for alike in self._alike.values():
            together = np.stack([low.by_share(signal[own]) for own, low in alike], axis=1)
            passed = lowpass(together, self._cutoff, self._rate)
            for place, (own, low) in enumerate(alike):
                found[own] = low.over_share(passed[:, place])
        return found


def _on_rows(share: np.ndarray, signal: np.ndarray) -> np.ndarray:
    """Return a share of each row, (n,), in as many dimensions as a signal, (n, ...)."""
    return share.reshape(-1, *([1] * (signal.ndim - 1)))


class _Line:
    """Puts straight lines where nothing is known of a signal.

    Args:
        unknown: where that is, (n,).
    """

    def __init__(self, unknown: np.ndarray) -> None:
        known = np.flatnonzero(~unknown)
        self._rows = np.flatnonzero(unknown) if len(known) else known
        after = np.searchsorted(known, self._rows)
        self._from = known[np.maximum(after - 1, 0)]
        self._to = known[np.minimum(after, len(known) - 1)]
        length = np.maximum(self._to - self._from, 1)
        self._part = np.clip((self._rows - self._from) / length, 0.0, 1.0)

    def __call__(self, signal: np.ndarray) -> np.ndarray:
        """Return a signal, (n, ...), with those lines; its ends go on as they are known last."""
        if len(self._rows):
            part = self._part.reshape(-1, *([1] * (signal.ndim - 1)))
            signal[self._rows] = (1.0 - part) * signal[self._from] + part * signal[self._to]
        return signal


def lowpass(
    signal: np.ndarray, cutoff: float, rate: float, order: int = 4, *, curved: bool = False
) -> np.ndarray:
    """Return `signal` without what lies above `cutoff`, without delay; shape (n, ...).

    Args:
        signal: evenly sampled.
        cutoff: Hz.
        rate: Hz.
        order: of both passes together.
        curved: whether the signal goes on beyond its ends with its value, slope and curvature there
            (`_beyond_start`), as one has to that is differentiated twice; else with its first two.
    """
    if cutoff >= 0.45 * rate or len(signal) < 4 * order:
        return np.array(signal)
    padding = min(len(signal) - 1, int(3 * rate / cutoff))
    width = int(ENDS * rate / cutoff)
    if curved and ENDS_ORDER + 2 <= width < len(signal):
        before = _beyond_start(signal, padding, width)
        after = _beyond_start(signal[::-1], padding, width)[::-1]
    else:
        before = 2 * signal[:1] - signal[padding:0:-1]
        after = 2 * signal[-1:] - signal[-2 : -padding - 2 : -1]
    # As scipy's sosfiltfilt, which designs its initial state anew at every call.
    extended = np.concatenate([before, signal, after])
    sections = _butterworth(order // 2, cutoff / (0.5 * rate))
    shape = (-1, *([1] * (signal.ndim - 1)))
    for _ in ("forwards", "backwards"):
        for numerator, denominator, state in sections:
            start = state.reshape(shape) * extended[:1]
            extended, _ = lfilter(numerator, denominator, extended, axis=0, zi=start)
        extended = extended[::-1]
    return np.ascontiguousarray(extended[padding : len(extended) - padding])


def _beyond_start(signal: np.ndarray, count: int, width: int) -> np.ndarray:
    """Return `count` samples that a signal, (n, ...), is continued with before its first.

    The signal is turned about its first point, and its curvature, which that turns over, is set
    right: a recording that is cut in motion would else begin with a jump of its acceleration. Value
    and curvature are those of a polynomial through the first `width` samples.
    """
    place = np.arange(width + 1) / width
    powers = np.vander(place, ENDS_ORDER + 1, increasing=True)
    flat = signal[: width + 1].reshape(width + 1, -1)
    fit = np.linalg.lstsq(powers, flat, rcond=None)[0].reshape(-1, *signal.shape[1:])
    back = (np.arange(count, 0, -1) / width).reshape(-1, *([1] * (signal.ndim - 1)))
    return np.asarray(2.0 * (fit[0] + fit[2] * back**2) - signal[count:0:-1])


@cache
def _butterworth(order: int, cutoff: float) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Return numerator, denominator and settled state for a unit input of every section."""
    sections = butter(order, cutoff, output="sos")
    return [(s[:3], s[3:], lfilter_zi(s[:3], s[3:])) for s in sections]


def derivatives(position: np.ndarray, sampling: Sampling) -> tuple[np.ndarray, ...]:
    """Return smoothed position, velocity and acceleration at the working rate, each (m, joints)."""
    smooth = lowpass(position, sampling.cutoff, sampling.recorded, order=8, curved=True)
    velocity = slope(smooth, sampling.recorded)
    acceleration = slope(velocity, sampling.recorded)
    every = slice(None, None, sampling.decimation)
    return smooth[every], velocity[every], acceleration[every]


def slope(signal: np.ndarray, rate: float) -> np.ndarray:
    """Return the rate of change of an evenly sampled signal, (n, ...).

    That of a cubic spline without knots at the second samples, which is a compact difference of
    fourth order (Lele 1992): at a tenth of the sampling rate it is 0.1 % small, where a central
    difference is 6 %. As scipy's, which asks its points anew whether they are even at every call.
    """
    count = len(signal)
    if count < 4:
        return np.asarray(np.gradient(signal, 1.0 / rate, axis=0))
    steps = np.diff(signal, axis=0)
    known = np.empty(signal.shape)
    known[1:-1] = 3.0 * (steps[1:] + steps[:-1])
    known[0], known[-1] = 2.5 * steps[0] + 0.5 * steps[1], 2.5 * steps[-1] + 0.5 * steps[-2]
    slopes, _ = dgttrs(*_tridiagonal(count), known.reshape(count, -1))
    return np.asarray(rate * slopes).reshape(signal.shape)


@cache
def _tridiagonal(count: int) -> tuple[np.ndarray, ...]:
    """Return what the slopes of a spline are the solution of, factored, for so many samples."""
    below, on, above = np.ones(count - 1), np.full(count, 4.0), np.ones(count - 1)
    on[[0, -1]], above[0], below[-1] = 1.0, 2.0, 2.0
    return tuple(dgttrf(below, on, above)[:-1])


def shifted(signal: np.ndarray, seconds: float, rate: float) -> np.ndarray:
    """Return signal(t + seconds) along the first axis, ends held."""
    n = len(signal)
    at = np.clip(np.arange(n) + seconds * rate, 0, n - 1)
    low = np.minimum(at.astype(int), n - 2)
    part = (at - low).reshape(-1, *([1] * (signal.ndim - 1)))
    # Half the time of an index in brackets.
    return np.asarray(signal.take(low, axis=0) * (1 - part) + signal.take(low + 1, axis=0) * part)


def lagged(signal: np.ndarray, time_constant: float, rate: float) -> np.ndarray:
    """Return `signal` behind a first-order low-pass of `time_constant` seconds.

    Exact for straight lines between samples, so a ramp comes late by the time constant at any rate.
    """
    steps = 1.0 / (rate * time_constant)
    kept = float(np.exp(-steps))
    newest = 1.0 + np.expm1(-steps) / steps
    start = (1.0 - newest) * signal[:1]
    forward = [newest, 1.0 - kept - newest]
    filtered, _ = lfilter(forward, [1.0, -kept], signal, axis=0, zi=start)
    return np.asarray(filtered)


def before_lag(signal: np.ndarray, time_constant: float, rate: float) -> np.ndarray:
    """Return what a first-order low-pass has made `signal`, (n, ...), of; NaN where that is."""
    return np.asarray(signal + time_constant * slope(np.nan_to_num(signal), rate))
