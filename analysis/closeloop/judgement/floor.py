"""How small a joint's error can get: the noise of its effort channel, never from the residual.

A floor is what the user declares of the sensor; or what a movement that was repeated leaves when
one pass is taken from the other (both passes' residuals under the declared model, over the square
root of two, so that a shift in time or place does little harm); or what the channel shows above the
band of the movement, where the model has nothing to say, continued flat into the band. It is never
less than what the channel's last digit leaves. What a recorder's low-pass leaves above the
band says nothing of the noise within it, and is no floor. See Pintelon and Schoukens 2012, System
Identification, section 1.3, on noise from repeated experiments.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.optimize import nnls
from scipy.signal import medfilt, oaconvolve, welch

from analysis.closeloop.identification.balance.trial_error import TrialError
from analysis.closeloop.identification.findings import Carried, Floor
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.signals import last_digit

#: Length of a movement that is looked for again, s, and rate at which it is looked for, Hz.
PASS_SECONDS, PASS_RATE = 2.0, 50.0
#: Two passes are one movement if they are this near, over what the movement is (root mean square).
SAME = 0.02
#: Least number of passes that were made again.
MIN_PASSES = 3
#: Where the band above the movement begins, over the fit's cutoff, and how wide it must be.
BEYOND, WIDE = 1.25, 1.5
#: A spectrum that falls faster than this power of the frequency is what a recorder's low-pass left:
#: steps of friction and noise of the first order, drifts among it, fall with its square.
STEEP = -3.0
#: Where filters of a recorder against aliases are at work, over half of the rate, and the least
#: range on which a fall is judged.
ALIASES, RANGE = 0.8, 2.0**0.5
#: Samples of a spectrum's window, the longest first that fits twice into some piece of a trial, and
#: the share of its lines over which a narrow one is smoothed away.
WINDOWS, SMOOTHED = (256, 128, 64), 0.07


def floors(
    recording: Recording, errors: Sequence[TrialError], loads: Sequence[Carried] = ()
) -> dict[int, Floor]:
    """Return the floor of every joint that has one.

    Args:
        recording: all trials.
        errors: of the declared model, raw samples; of every trial that was recorded.
        loads: what trials carry without naming it.
    """
    repeated = [both for both in passes(recording) if _carry_alike(recording, *both, loads)]
    found = {}
    for joint in recording.joints:
        own = [error for error in errors if error.joint == joint and len(error.time) > 1]
        floor = (
            _declared(recording, joint)
            or _from_repeats(recording, repeated, own)
            or _above_the_band(recording, own)
        )
        raw = [recording.raw_effort(error.trial, joint) for error in own]
        known = [effort for effort in raw if effort is not None]
        digit = last_digit(np.concatenate(known)) if known else 0.0
        if digit > (floor.value if floor else 0.0):
            floor = Floor(value=digit, source="quantisation")
        if floor is not None:
            found[joint] = floor
    return found


def _declared(recording: Recording, joint: int) -> Floor | None:
    noise = recording.session.noise.get(f"{recording.name(joint)}.effort")
    return None if noise is None else Floor(value=noise, source="declared")


def passes(recording: Recording) -> Iterator[tuple[slice, int]]:
    """Yield movements that were made again: samples of the first pass, and by how many later.

    Every joint moves alike in both. The search is a sum of squares at every lag (by convolution).
    """
    thin = max(1, round(recording.rate / PASS_RATE))
    moving = [j for j in recording.joints if np.ptp(recording.position[:, j]) > 0]
    if not moving:
        return
    place = recording.position[::thin][:, moving]
    scale = place.std(axis=0)
    place = place / np.where(scale > 0, scale, 1.0)
    trial = recording.trial[::thin]
    count = int(PASS_SECONDS * recording.rate / thin)
    power = np.concatenate([[0.0], np.cumsum((place**2).sum(axis=1))])
    power = power[count:] - power[:-count]
    for start in range(0, len(place) - 2 * count, count):
        own = place[start : start + count]
        spread = float(((own - own.mean(axis=0)) ** 2).sum())
        if trial[start] != trial[start + count - 1] or spread < 0.05 * own.size:
            continue
        rest = place[start + count :]
        product = sum(
            oaconvolve(rest[:, k], own[::-1, k], mode="valid") for k in range(len(moving))
        )
        later = start + count
        distance = power[later : later + len(product)] - 2 * product + float((own**2).sum())
        whole = trial[later : later + len(product)] == trial[later + count - 1 :][: len(product)]
        distance = np.where(whole, distance, np.inf)
        if not len(distance):
            continue
        best = int(np.argmin(distance))
        if distance[best] < SAME**2 * spread:
            yield slice(start * thin, (start + count) * thin), (later + best - start) * thin


def _carry_alike(recording: Recording, first: slice, later: int, loads: Sequence[Carried]) -> bool:
    """Whether the trials of two passes carry the same: with another load nothing is repeated."""
    one, other = (int(recording.trial[at]) for at in (first.start, first.start + later))
    trials = recording.session.trials
    hung = [(trials[n].payload, trials[n].added_mass) for n in (one, other)]
    unnamed = {load.trial for load in loads if not load.fitted}
    return one == other or (hung[0] == hung[1] and not unnamed.intersection((one, other)))


def _from_repeats(
    recording: Recording, repeated: Sequence[tuple[slice, int]], errors: Sequence[TrialError]
) -> Floor | None:
    """Return the noise that repeats show; half of the passes may hold something else."""
    by_trial = {error.trial: error for error in errors}
    shares = []
    for first, later in repeated:
        one = by_trial.get(int(recording.trial[first.start]))
        other = by_trial.get(int(recording.trial[first.start + later]))
        if one is None or other is None:
            continue
        begin, end = recording.time[first.start], recording.time[first.stop - 1]
        inside = (one.time >= begin) & (one.time <= end)
        shift = recording.time[first.start + later] - begin
        inside &= (one.time + shift >= other.time[0]) & (one.time + shift <= other.time[-1])
        # The nearest sample: a mean of two would have less noise than one.
        at = np.searchsorted(
            other.time, one.time[inside] + shift - 0.5 / recording.sampling.recorded
        )
        difference = one.residual[inside] - other.residual[at]
        if len(difference) > 10:
            shares.append(float(np.mean(difference**2)) / 2.0)
    if len(shares) < MIN_PASSES:
        return None
    return Floor(value=float(np.sqrt(np.median(shares))), source="repeats")


def _above_the_band(recording: Recording, errors: Sequence[TrialError]) -> Floor | None:
    """Return the noise of the band above the movement, continued below it."""
    rate = recording.sampling.recorded
    edge = BEYOND * recording.sampling.fit_cutoff
    highest = 0.5 * rate
    if highest < WIDE * edge:
        return None
    found = _spectrum(recording, errors)
    if found is None:
        return None
    frequency, power, gain = found
    if _low_passed(frequency, power, edge, ALIASES * highest):
        return None
    above = frequency >= edge
    if np.ptp(gain) > 0.0:
        within = _through_the_filter(gain, power, above)[~above].sum() * frequency[1]
    else:
        near = above & (frequency <= WIDE * edge)
        within = np.median(power[near if near.sum() > 3 else above]) * edge
    square = float(within + power[above].sum() * frequency[1])
    return Floor(value=float(np.sqrt(square)), source="above the band")


def _spectrum(
    recording: Recording, errors: Sequence[TrialError]
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Return frequencies, Hz, power without narrow lines, and what declared low-passes let pass.

    None if gaps leave no piece of a trial as long as two windows.
    """
    rate = recording.sampling.recorded
    pieces = [
        (recording.session.trials[error.trial].effort_filter_hz, piece)
        for error in errors
        for piece in np.split(error.residual, np.flatnonzero(np.diff(error.time) > 5 / rate) + 1)
    ]
    longest = max((len(piece) for _, piece in pieces), default=0)
    window = next((window for window in WINDOWS if longest >= 2 * window), None)
    if window is None:
        return None
    pieces = [(filter_hz, piece) for filter_hz, piece in pieces if len(piece) >= 2 * window]
    spectra = [
        welch(p, rate, nperseg=window, detrend="linear", average="median") for _, p in pieces
    ]
    frequency, lengths = spectra[0][0], [len(piece) for _, piece in pieces]
    power = np.average([own for _, own in spectra], axis=0, weights=lengths)
    gain = np.average([_passed(frequency, hz) for hz, _ in pieces], axis=0, weights=lengths)
    lines = 2 * round(0.5 * SMOOTHED * window / 2.0) + 1
    return frequency, medfilt(power, lines), gain


def _passed(frequency: np.ndarray, filter_hz: float | None) -> np.ndarray:
    """Return what share of power a channel's declared low-pass, of the first order, lets pass."""
    return np.ones(len(frequency)) / (
        1.0 + (0.0 if filter_hz is None else frequency / filter_hz) ** 2
    )


def _through_the_filter(gain: np.ndarray, power: np.ndarray, above: np.ndarray) -> np.ndarray:
    """Return the spectrum of white noise before and after a low-pass that fits best above the band.

    Every line counts by its share: a line's error is as large as its level.
    """
    parts = np.column_stack([np.ones(len(gain)), gain])
    level = np.maximum(power[above], 1e-12 * power.max() + 1e-300)
    sizes, _ = nnls(parts[above] / level[:, None], np.ones(int(above.sum())))
    return np.asarray(parts @ sizes)


def _low_passed(frequency: np.ndarray, power: np.ndarray, low: float, high: float) -> bool:
    """Whether noise falls as a filter's: then its level says nothing of that within the band.

    Args:
        frequency: of the spectrum's lines, Hz.
        power: at each.
        low: from where on the movement has no part in it, Hz.
        high: up to where it is judged, Hz.
    """
    if high < RANGE * low or not np.any(power > 0):
        return False
    # Every octave counts alike.
    octaves = np.linspace(np.log(low), np.log(high), 32)
    level = np.log(np.maximum(power[1:], 1e-12 * power.max()))
    fall = np.polyfit(octaves, np.interp(octaves, np.log(frequency[1:]), level), 1)[0]
    return bool(fall < STEEP)
