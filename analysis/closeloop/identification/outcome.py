"""What a session comes to: its verdict, and the errors of the declared and the final model."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from analysis.closeloop.contract import Verdict
from analysis.closeloop.identification.accuracy import (
    TrialError,
    left_out_errors,
    raw_errors,
    settled,
)
from analysis.closeloop.identification.findings import Trace
from analysis.closeloop.identification.spectrum import Peak, peaks
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.signals import rms


@dataclass(frozen=True, kw_only=True)
class Errors:
    """Errors of the same trials under the declared and under the final model."""

    before: list[TrialError]
    after: list[TrialError]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """The trace of a session, what it amounts to, and how well the models predict."""

    trace: Trace
    #: The trace's, unless an oscillation is left in a residual that seemed adequate.
    verdict: Verdict
    fit: Errors
    #: Of the trials with the role holdout, or of each group predicted from the others.
    holdout: Errors
    #: Whether it is the latter, for want of holdouts.
    left_out: bool
    #: Lines and bands in the spectrum of each joint's final residual.
    oscillations: Mapping[int, list[Peak]]

    @property
    def recorded(self) -> Errors:
        """Errors of every trial once: those that were fitted, then the holdouts."""
        trials = self.trace.rows.recording.session.trials
        if all(trial.role == "fit" for trial in trials):
            return self.fit
        return Errors(
            before=self.fit.before + self.holdout.before, after=self.fit.after + self.holdout.after
        )


def outcome_of(trace: Trace) -> Outcome:
    """Compare the models' predictions with the trials and settle the verdict."""
    recording, rows = trace.rows.recording, trace.rows
    expected = [settled(*model) for model in trace.fits]
    holdouts = tuple(
        number for number, trial in enumerate(recording.session.trials) if trial.role == "holdout"
    )
    fit = [raw_errors(recording, effort, recording.fit_trials) for effort in expected]
    holdout = [raw_errors(recording, effort, holdouts) for effort in expected]
    left_out = not holdout[0]
    if left_out:
        holdout = [left_out_errors(model, rows) for model, _ in trace.fits]
    found = oscillations(recording, fit[1])
    adequate = trace.verdict == Verdict.ADEQUATE
    return Outcome(
        trace=trace,
        verdict=Verdict.UNEXPLAINED if adequate and found else trace.verdict,
        fit=Errors(before=fit[0], after=fit[1]),
        holdout=Errors(before=holdout[0], after=holdout[1]),
        left_out=left_out,
        oscillations=found,
    )


def oscillations(recording: Recording, errors: list[TrialError]) -> dict[int, list[Peak]]:
    """Return the narrow lines, or the band, of each joint's raw residual, if any."""
    rate = recording.sampling.recorded
    found = {}
    for joint in recording.joints:
        own = [error for error in errors if error.joint == joint and len(error.time) > 1]
        residuals = []
        for error in own:
            even = np.arange(error.time[0], error.time[-1], 1.0 / rate)
            residuals.append(np.interp(even, error.time, error.residual))
        effort = np.concatenate([error.effort for error in own]) if own else np.zeros(1)
        highest = recording.sampling.fit_cutoff / 2.0
        if alone := peaks(residuals, rate, rms(effort), highest):
            found[joint] = alone
    return found
