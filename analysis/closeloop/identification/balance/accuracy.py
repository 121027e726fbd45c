"""Errors over the raw effort samples: on trials no fit has touched, or with each group left out."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.signal import decimate

from analysis.closeloop.identification.balance.least_squares import gram_matrices, solve
from analysis.closeloop.identification.balance.model import Model, prediction, unfitted
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.balance.terms import kept_columns
from analysis.closeloop.identification.balance.trial_error import TrialError
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.signals import rms
from sim.effects.motion import PRESLIDING_SHARE

#: Rate, Hz, to which errors are decimated for comparison with published relative errors.
SMOOTH_RATE = 100.0
#: Ways over which friction turns where a joint creeps at rest, over the longest that is presliding.
WAYS = (1 / 64, 1 / 16, 1 / 4)


def settled(model: Model, coefficients: np.ndarray) -> np.ndarray:
    """Return the expected effort, (n, joints), with friction at rest as the trials show it.

    A stopped joint keeps a share of the friction that it stopped with: all of it if bristles or
    clamped links hold, none if they slip back. Where it creeps back by more than they give way,
    friction turns around (Dahl 1968), though its speed is none that counts. The share is fitted to
    the rests of the fit trials; where a share from the others predicts a trial's rests worse than
    friction that goes on with the velocity, as that of a joint that creeps through a reversal does,
    the friction is left so.
    """
    recording = model.recording
    predicted = prediction(model, coefficients)
    for term, own in model.split(coefficients):
        if not term.rubs or term.joint not in term.columns:
            continue
        joint = term.joint
        sliding = model.transformed(kept_columns(term))[joint] @ own
        held, rests = np.zeros(len(sliding)), np.zeros(len(sliding), dtype=bool)
        for piece in recording.slices:
            still = recording.resting(joint, piece)
            # Friction of the last sample in motion; a trial that begins at rest has none.
            last = np.maximum.accumulate(np.where(still, -1, np.arange(len(still))))
            held[piece] = np.where(last >= 0, sliding[piece][np.maximum(last, 0)], 0.0)
            rests[piece] = still
        fitted = rests & np.isin(recording.trial, recording.fit_trials)
        # A trial may lack the joint's effort.
        fitted &= np.isfinite(recording.effort[:, joint])
        missing = recording.effort[fitted, joint] - predicted[fitted, joint] + sliding[fitted]
        recorded = unfitted(recording, joint)
        longest = PRESLIDING_SHARE * recorded.travel[1]
        laws = [held, *(np.abs(held) * recorded.wound(share * longest) for share in WAYS)]
        course = _best(laws, sliding, missing, fitted, recording.trial)
        if course is None:
            continue
        kept = _share(course[fitted], missing) * course[rests]
        predicted[rests, joint] += kept - sliding[rests]
    return predicted


def _share(held: np.ndarray, missing: np.ndarray) -> float:
    """Return the share of held friction that samples at rest show, 0 to 1."""
    power = float(held @ held)
    return float(np.clip(held @ missing / power, 0.0, 1.0)) if power > 0 else 0.0


def _best(
    laws: Sequence[np.ndarray],
    sliding: np.ndarray,
    missing: np.ndarray,
    fitted: np.ndarray,
    trial: np.ndarray,
) -> np.ndarray | None:
    """Return the law of friction at rest that predicts best; None if it goes on with the velocity.

    Args:
        laws: friction as each has it, (n,).
        sliding: what the velocity makes of it, (n,).
        missing: what it has to be where it is fitted, (s,).
        fitted: where that is, (n,).
        trial: number of each sample's trial; its share comes from the other trials, if any, (n,).
    """
    least, best = float((missing - sliding[fitted]) @ (missing - sliding[fitted])), None
    for law in laws:
        lost = _lost(law[fitted], missing, trial[fitted])
        if lost <= least:
            least, best = lost, law
    return best


def _lost(held: np.ndarray, missing: np.ndarray, trial: np.ndarray) -> float:
    """Return the squares that shares of a law, of each trial from the others, leave of it."""
    lost = 0.0
    for number in np.unique(trial):
        own = trial == number
        others = own if own.all() else ~own
        left = missing[own] - _share(held[others], missing[others]) * held[own]
        lost += float(left @ left)
    return lost


def raw_errors(
    recording: Recording, predicted: np.ndarray, trials: tuple[int, ...]
) -> list[TrialError]:
    """Compare a prediction, (n, joints) at the working rate, with raw effort.

    Away from the ends of a stretch, where filters do not know the motion: of a start from a stop
    they make a torque that nothing had, and more of it behind a spring or a gap. A trial without
    any longer stretch is compared whole.
    """
    edge = recording.edge / recording.rate
    found = []
    for number in trials:
        trial = recording.session.trials[number]
        for joint in recording.joints:
            effort = recording.raw_effort(number, joint)
            if effort is None:
                continue
            times, efforts, expected = [], [], []
            pieces = recording.pieces_of(number)
            longer = [p for p in pieces if p.stop - p.start > 2 * recording.edge]
            ends = edge if longer else 0.0
            for piece in longer or pieces:
                clock = recording.time[piece]
                # One working step beyond the last sample at most: the clock is rounded down.
                last = clock[-1] + 1 / recording.rate - ends
                rows = (trial.time >= clock[0] + ends) & (trial.time <= last)
                times.append(trial.time[rows])
                efforts.append(effort[rows])
                expected.append(np.interp(trial.time[rows], clock, predicted[piece, joint]))
            if times:
                found.append(
                    TrialError(
                        trial=number,
                        joint=joint,
                        time=np.concatenate(times),
                        effort=np.concatenate(efforts),
                        predicted=np.concatenate(expected),
                        ends=ends,
                    )
                )
    return found


def left_out_errors(model: Model, rows: Rows) -> list[TrialError]:
    """Predict each fold's trials with coefficients fitted to the others.

    When all trials share one group, the folds are stretches of time; then each trial's samples are
    predicted by the fit to the other stretches.
    """
    recording = model.recording
    base, lower = model.base(rows)
    table = np.column_stack([base, model.target(rows)])
    grams = gram_matrices(table, rows.folds)
    found: list[TrialError] = []
    for number, fold in enumerate(rows.folds):
        predicted = settled(model, solve(grams.sum(axis=0) - grams[number], lower))
        trials = tuple(int(t) for t in np.unique(rows.trial[fold]))
        errors = raw_errors(recording, predicted, trials)
        samples = np.concatenate(list(rows.samples.values()))
        for error in errors:
            own = rows.trial == error.trial
            if set(rows.fold[own]) == {number}:
                found.append(error)
                continue
            # Only a part of the trial was left out.
            clock = recording.time[samples[own & (rows.fold == number)]]
            inside = (error.time >= clock.min()) & (error.time <= clock.max())
            found.append(error.where(inside))
    return found


def smooth_relative(errors: list[TrialError], joint: int, rate: float) -> float | None:
    """Return the relative error of a joint in the band of its motion, as identification papers do.

    Effort and prediction pass one zero-phase low-pass of 40 Hz and are decimated to `SMOOTH_RATE`
    (the parallel decimation of Gautier 1997; EMPS, Janot, Gautier and Brunot 2019); 2 % at each
    end, which filters touch, are left out. None if recorded too slowly for that.

    Args:
        errors: trials of all joints.
        joint: column number.
        rate: of the recording, Hz.
    """
    factor = round(rate / SMOOTH_RATE)
    if factor < 2:
        return None
    lost = power = 0.0
    for error in errors:
        if error.joint != joint or len(error.time) < 40 * factor:
            continue
        even = np.arange(error.time[0], error.time[-1], 1.0 / rate)
        effort, predicted = (
            decimate(np.interp(even, error.time, signal), factor, zero_phase=True)
            for signal in (error.effort, error.predicted)
        )
        out = round(error.ends * SMOOTH_RATE)
        edge = max((len(effort) + 2 * out) // 50 - out, 0)
        inside = slice(edge, len(effort) - edge)
        lost += float(((effort - predicted)[inside] ** 2).sum())
        power += float((effort[inside] ** 2).sum())
    return float(np.sqrt(lost / power)) if power > 0 else None


def rms_by_joint(errors: list[TrialError]) -> Mapping[int, tuple[float, float]]:
    """Return the root mean square of residual and of effort for every joint."""
    found = {}
    for joint in sorted({error.joint for error in errors}):
        own = [error for error in errors if error.joint == joint]
        residual = np.concatenate([error.residual for error in own])
        effort = np.concatenate([error.effort for error in own])
        if len(residual):
            found[joint] = rms(residual), rms(effort)
    return found
