"""All trials of a session on one even clock, split at gaps, and the recording made of them."""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from analysis.closeloop.errors import SessionError
from analysis.closeloop.session.contents import Session, Trial
from analysis.closeloop.session.cutoff import Stretch, choose_sampling
from analysis.closeloop.session.device import Device
from analysis.closeloop.session.files import SESSION_FILE
from analysis.closeloop.session.missing import (
    GAP_STEPS,
    clock_step,
    measured_at,
    with_missing_counted,
    without_stale,
)
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.runs import MOVING, runs
from analysis.closeloop.session.signals import (
    LEAST_MEASURED,
    MeasuredLowpass,
    Sampling,
    derivatives,
    lowpass,
)

#: Gaps end a stretch if they are longer than this, s: over shorter ones friction and tissue
#: remember what the joint did before.
BRIDGED = 0.3
#: Cutoff before samples are thinned to the working rate, over that.
ALIASES = 0.4
#: Share of measured samples around one below which nothing is known of it.
SEEN = 0.05
#: Shortest stretch between gaps that is analysed: s, and samples.
MIN_STRETCH, MIN_SAMPLES = 0.5, 20


def record(session: Session, device: Device) -> Recording:
    """Bring a session's trials to one clock and differentiate them.

    Raises:
        SessionError: no joint has an effort in the trials that may be fitted.
    """
    trials = [with_missing_counted(without_stale(trial)) for trial in session.trials]
    session = replace(session, trials=tuple(trials))
    names = extra_columns(session.trials, device)
    pieces, rate = stretches(session.trials, device, names)
    fit_trials = tuple(i for i, trial in enumerate(session.trials) if trial.role == "fit")
    if not any(piece.trial in fit_trials for piece in pieces):
        raise SessionError(
            "no trial has half a second of samples without a gap", file=session.trials[0].file
        )
    moving = np.zeros(len(device.joints), dtype=bool)
    measured = np.zeros(len(device.joints), dtype=bool)
    for piece in pieces:
        if piece.trial in fit_trials:
            moving |= np.ptp(piece.position, axis=0) > MOVING
            measured |= ~np.isnan(piece.effort).any(axis=0)
    # Of what moves without an effort nothing is known; whoever pushes one that rests is told.
    still = not (moving & measured).any()
    joints = tuple(int(joint) for joint in np.flatnonzero(measured & (moving | still)))
    if not joints:
        raise SessionError(
            "no joint has an effort throughout a piece of a trial that may be fitted",
            file=SESSION_FILE,
        )
    fitted = [piece for piece in pieces if piece.trial in fit_trials]
    sampling = choose_sampling(fitted, rate, session, device, joints)
    # What remembers its past goes on over a gap, and no fit sees the samples beside one.
    pieces, _ = stretches(session.trials, device, names, BRIDGED)
    pieces = [replace(piece, measured=away_from_gaps(piece, sampling)) for piece in pieces]
    parts = [derivatives(piece.position, sampling) for piece in pieces]
    lengths = [len(part[0]) for part in parts]
    starts = np.concatenate([[0], np.cumsum(lengths)])
    every = slice(None, None, sampling.decimation)
    efforts = [effort_for_fit(piece, sampling) for piece in pieces]
    return Recording(
        device=device,
        session=session,
        sampling=sampling,
        slices=[slice(int(a), int(b)) for a, b in itertools.pairwise(starts)],
        trial=np.repeat([piece.trial for piece in pieces], lengths),
        time=np.concatenate([piece.time[every] for piece in pieces]),
        position=np.concatenate([part[0] for part in parts]),
        velocity=np.concatenate([part[1] for part in parts]),
        acceleration=np.concatenate([part[2] for part in parts]),
        effort=np.concatenate([effort for effort, _, _ in efforts]),
        unfiltered=np.concatenate([unfiltered for _, unfiltered, _ in efforts]),
        measured=np.concatenate([measured for _, _, measured in efforts]),
        extra=np.concatenate([piece.extra[every] for piece in pieces]),
        extra_names=names,
        joints=joints,
        fit_trials=fit_trials,
        still=still,
    )


def away_from_gaps(piece: Stretch, sampling: Sampling) -> np.ndarray:
    """Return which samples of a stretch are measured, and no gap's bridge reaches them, (n,).

    The filters carry it as far as they do the end of a stretch (`Recording.edge`).
    """
    known = np.array(piece.measured)
    reach = int(sampling.recorded / sampling.fit_cutoff)
    for run in runs(~piece.measured):
        if run.stop - run.start >= GAP_STEPS - 1:
            known[max(run.start - reach, 0) : run.stop + reach] = False
    return known


def without_forgotten(recording: Recording) -> Recording:
    """Return the recording without what comes so soon after a gap that what was in it matters.

    A reflex answers a stretch that no sample shows.
    """
    after = np.zeros(len(recording.time), dtype=bool)
    for piece in recording.slices:
        for run in runs(recording.measured[piece] < LEAST_MEASURED):
            if run.stop - run.start >= GAP_STEPS:
                end = piece.start + run.stop
                after[end : min(end + int(BRIDGED * recording.rate), piece.stop)] = True
    if not after.any():
        return recording
    return replace(recording, disturbed=np.repeat(after[:, None], len(recording.device.joints), 1))


def effort_for_fit(piece: Stretch, sampling: Sampling) -> tuple[np.ndarray, ...]:
    """Return the effort for the fit, the same before its low-pass, and what is measured.

    At the working rate, (m, joints) twice and (m,). Regressors pass the same low-pass with the same
    missing samples (`Recording.filtered`).
    """
    measured, effort, rate = piece.measured.astype(float), piece.effort, sampling.recorded
    if sampling.decimation > 1:
        narrow = ALIASES * sampling.working
        whole = lowpass(effort, narrow, rate)
        if not piece.measured.all():
            share, known = (
                lowpass(signal, narrow, rate) for signal in (measured, effort * measured[:, None])
            )
            # What counts by its share has to be over that share, however small.
            seen = share > SEEN
            whole = np.where(seen[:, None], known / np.maximum(share, SEEN)[:, None], whole)
            measured = np.where(seen, np.minimum(share, 1.0), 0.0)
        effort = whole
        every = slice(None, None, sampling.decimation)
        effort, measured = effort[every], measured[every]
    low = MeasuredLowpass(measured, sampling.fit_cutoff, sampling.working)
    return low(effort), effort, measured


def stretches(
    trials: Sequence[Trial], device: Device, extra: Sequence[str], bridged: float = 0.0
) -> tuple[list[Stretch], float]:
    """Bring every trial to the session's one even clock and split it at gaps.

    Args:
        trials: of the session.
        device: the declared chain.
        extra: names of the columns that are no joint's own.
        bridged: a gap that is no longer, s, ends no stretch.

    Returns:
        The stretches in order, and their common rate in Hz.
    """
    steps = [clock_step(trial.time) for trial in trials]
    step = float(np.median(steps))
    pieces = []
    for number, trial in enumerate(trials):
        longest = max(bridged, GAP_STEPS * max(step, steps[number]))
        gaps = np.flatnonzero(np.diff(trial.time) > longest)
        bounds = [0, *(gaps + 1), len(trial.time)]
        for start, stop in itertools.pairwise(bounds):
            seconds = trial.time[stop - 1] - trial.time[start]
            if stop - start >= MIN_SAMPLES and seconds >= MIN_STRETCH:
                pieces.append(_stretch(number, trial, device, extra, step, slice(start, stop)))
    return pieces, 1.0 / step


def extra_columns(trials: Sequence[Trial], device: Device) -> tuple[str, ...]:
    """Return the columns that are no joint's own signal, in order of appearance."""
    own = {
        f"{joint}.{word}"
        for joint in device.joints
        for word in ("position", "velocity", "acceleration", "effort")
    }
    names = dict.fromkeys(name for trial in trials for name in trial.columns if name not in own)
    return tuple(names)


def _stretch(
    number: int, trial: Trial, device: Device, extra: Sequence[str], step: float, rows: slice
) -> Stretch:
    """Bring the samples `rows` of a trial to an even clock of `step` seconds.

    Where a sample is missing its place holds an interpolated position, for the filter needs one,
    and is marked: no regression sees it.
    """
    raw = trial.time[rows]
    time = raw[0] + step * np.arange(int((raw[-1] - raw[0]) / step + 1e-6) + 1)

    def signal(name: str) -> np.ndarray:
        if name not in trial.columns:
            return np.full(len(time), np.nan)
        return np.asarray(np.interp(time, raw, trial.columns[name][rows]))

    def position(joint: str) -> np.ndarray:
        values = trial.columns.get(f"{joint}.position")
        if joint in device.ignored_joints or values is None:
            return np.full(len(time), float(device.reference[device.dof(joint)]))
        if not np.ptp(values[rows]):
            return np.full(len(time), values[rows.start])
        # Straight lines between samples would put corners into the velocity.
        slope = np.gradient(values[rows], raw)
        return np.asarray(CubicHermiteSpline(raw, values[rows], slope)(time))

    return Stretch(
        trial=number,
        time=time,
        position=np.column_stack([position(joint) for joint in device.joints]),
        effort=np.column_stack([signal(f"{joint}.effort") for joint in device.joints]),
        extra=np.column_stack([np.empty((len(time), 0)), *(signal(name) for name in extra)]),
        measured=measured_at(time, raw, step),
    )
