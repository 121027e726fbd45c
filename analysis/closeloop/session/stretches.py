"""All trials of a session on one even clock, split at gaps, and the recording made of them."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.session.contents import Session, Trial
from analysis.closeloop.session.device import Device
from analysis.closeloop.session.files import SESSION_FILE
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.signals import choose_sampling, derivatives, lowpass

#: Steps longer than this many medians are gaps; nothing is interpolated across one.
GAP_STEPS = 5.0
#: Shortest stretch between gaps that is analysed: s, and samples.
MIN_STRETCH, MIN_SAMPLES = 0.5, 20
#: Least travel of a moving joint, rad or m: above what an encoder's last digits do.
MOVING = 5e-3


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """An evenly sampled piece of a trial at the recorded rate; arrays have shape (n, joints)."""

    trial: int
    time: np.ndarray
    position: np.ndarray
    #: NaN where a joint has no effort.
    effort: np.ndarray
    #: (n, extra columns), NaN where the trial lacks one.
    extra: np.ndarray


def record(session: Session, device: Device) -> Recording:
    """Bring a session's trials to one clock and differentiate them.

    Raises:
        SessionError: no joint both moves and has an effort in the trials that may be fitted.
    """
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
    joints = tuple(int(joint) for joint in np.flatnonzero(moving & measured))
    if not joints:
        raise SessionError(
            "no joint with a recorded effort moves; excite at least one joint", file=SESSION_FILE
        )
    sampling = choose_sampling([piece.position for piece in pieces], rate, moving)
    parts = [derivatives(piece.position, sampling) for piece in pieces]
    lengths = [len(part[0]) for part in parts]
    starts = np.concatenate([[0], np.cumsum(lengths)])
    every = slice(None, None, sampling.decimation)
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
        effort=np.concatenate(
            [lowpass(piece.effort, sampling.fit_cutoff, rate)[every] for piece in pieces]
        ),
        extra=np.concatenate([piece.extra[every] for piece in pieces]),
        extra_names=names,
        joints=joints,
        fit_trials=fit_trials,
    )


def stretches(
    trials: Sequence[Trial], device: Device, extra: Sequence[str]
) -> tuple[list[Stretch], float]:
    """Bring every trial to the session's one even clock and split it at gaps.

    `extra`: names of the columns that are no joint's own.

    Returns:
        The stretches in order, and their common rate in Hz.
    """
    step = float(np.median([_step(trial) for trial in trials]))
    pieces = []
    for number, trial in enumerate(trials):
        gaps = np.flatnonzero(np.diff(trial.time) > GAP_STEPS * max(step, _step(trial)))
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


def _step(trial: Trial) -> float:
    return float(np.median(np.diff(trial.time)))


def _stretch(
    number: int, trial: Trial, device: Device, extra: Sequence[str], step: float, rows: slice
) -> Stretch:
    """Interpolate the samples `rows` of a trial on an even clock of `step` seconds."""
    raw = trial.time[rows]
    time = raw[0] + step * np.arange(int((raw[-1] - raw[0]) / step + 1e-6) + 1)

    def signal(name: str, absent: float = np.nan) -> np.ndarray:
        if name not in trial.columns:
            return np.full(len(time), absent)
        return np.asarray(np.interp(time, raw, trial.columns[name][rows]))

    def position(joint: str) -> np.ndarray:
        still = float(device.reference[device.dof(joint)])
        if joint in device.ignored_joints:
            return np.full(len(time), still)
        return signal(f"{joint}.position", still)

    return Stretch(
        trial=number,
        time=time,
        position=np.column_stack([position(joint) for joint in device.joints]),
        effort=np.column_stack([signal(f"{joint}.effort") for joint in device.joints]),
        extra=np.column_stack([np.empty((len(time), 0)), *(signal(name) for name in extra)]),
    )
