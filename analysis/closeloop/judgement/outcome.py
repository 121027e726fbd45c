"""What a session comes to: its verdict, and the errors of the declared and the final model.

`adequate` is said only of a residual that is near its floor, goes with no signal and is not local
in time. Where a channel has no floor, nothing is concluded from the size of the error.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.ndimage import maximum_filter1d

from analysis.closeloop.contract import Verdict
from analysis.closeloop.identification.balance.accuracy import (
    left_out_errors,
    raw_errors,
    rms_by_joint,
    settled,
)
from analysis.closeloop.identification.balance.declared import declared_model
from analysis.closeloop.identification.balance.model import evaluate
from analysis.closeloop.identification.balance.regression import select_rows
from analysis.closeloop.identification.balance.terms import Candidate
from analysis.closeloop.identification.balance.trial_error import TrialError
from analysis.closeloop.identification.explainable import explainable
from analysis.closeloop.identification.findings import (
    AT_FLOOR,
    Carried,
    Errors,
    Event,
    Floor,
    Hidden,
    Outcome,
    Structure,
    Trace,
)
from analysis.closeloop.identification.spectrum import Peak, peaks
from analysis.closeloop.judgement.by_trial import by_trial
from analysis.closeloop.judgement.floor import floors
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.signals import rms

#: What goes with a signal counts from this share of the floor on, or of the joint's effort.
MIN_STRUCTURE, MIN_EFFORT = 0.25, 0.008
#: An oscillation counts from this share of the floor on: noise has colours. Set on one clean arm of
#: the unkind bench (tuning seeds): a third, near half of the rate.
MIN_LINE = 0.5
#: Most of what is left.
MOST = 0.5
#: An error that is so many times the effort is no noise's: a model without torque has 1, and one
#: that is right only adds to the noise of a joint that has hardly any effort.
WORSE_THAN_NONE = 1.5


def outcome_of(
    trace: Trace,
    events: Sequence[Event],
    loads: Sequence[Carried],
    goes_with: Mapping[int, list[Structure]],
    hidden: Mapping[int, Sequence[Hidden]],
) -> Outcome:
    """Compare the models' predictions with the trials and settle the verdict.

    Args:
        trace: what tracing found.
        events: torque that is local in time; the trace was spared it.
        loads: what trials carry without naming it.
        goes_with: signals that each joint's final residual goes with.
        hidden: effects that could move a stiffness unseen.
    """
    recording, rows = trace.rows.recording, trace.rows
    expected = [settled(*model) for model in trace.fits]
    holdouts = tuple(
        number for number, trial in enumerate(recording.session.trials) if trial.role == "holdout"
    )
    fit = [raw_errors(recording, effort, recording.fit_trials) for effort in expected]
    holdout = [raw_errors(recording, effort, holdouts) for effort in expected]
    lowest = floors(recording, [*fit[0], *holdout[0]], loads)
    events = _above(lowest, events)
    left_out = not holdout[0]
    if left_out:
        holdout = [left_out_errors(model, rows) for model, _ in trace.fits]
    rubs = any(term.rubs for term in trace.model.terms) or bool(np.any(recording.device.friction))
    outcome = Outcome(
        trace=trace,
        verdict=trace.verdict,
        fit=Errors(before=fit[0], after=fit[1]),
        holdout=Errors(before=holdout[0], after=holdout[1]),
        left_out=left_out,
        oscillations=oscillations(recording, fit[1]),
        floors=lowest,
        structures=_large(trace, goes_with, lowest),
        by_trial=by_trial(trace.model, rows),
        events=events,
        loads=loads,
        hidden=hidden,
        left=left_in_band(recording, expected[1], rubs=rubs),
        unsettled=(),
    )
    outcome = replace(outcome, unsettled=_unsettled(outcome, rubs=rubs))
    return replace(outcome, verdict=verdict_of(outcome))


def _above(lowest: Mapping[int, Floor], events: Sequence[Event]) -> tuple[Event, ...]:
    """Return the events that are stronger than the noise of their channel: nobody sees others.

    (A stranger's motor on a bench had pushes of a tenth of its noise.)
    """
    return tuple(e for e in events if e.joint not in lowest or abs(e.peak) > lowest[e.joint].value)


def verdict_of(outcome: Outcome) -> Verdict:
    """Return the trace's verdict, unless what is left or what may hide calls for another."""
    trace = outcome.trace
    # Whatever else trials cannot tell, somebody pushed.
    pushed = trace.verdict == Verdict.NOT_IDENTIFIABLE and not trace.steps and bool(outcome.events)
    if pushed:
        return Verdict.UNEXPLAINED
    if trace.verdict != Verdict.ADEQUATE:
        return trace.verdict
    if outcome.events or left_beside_events(outcome) or worse_than_none(outcome):
        return Verdict.UNEXPLAINED
    if outcome.unsettled or not all(map(outcome.identified, outcome.hidden)):
        return Verdict.NOT_IDENTIFIABLE
    return Verdict.ADEQUATE


def takes_too_little(outcome: Outcome) -> str:
    """Return why a limb's names do not hold, if all that they do a controller's answer does, too.

    To a torque that nobody knows a controller answers with one gain and one phase at each
    frequency, which a delay and inertia imitate where it answers most (Ljung 1999, System
    Identification, section 13.4). If they are the cause they leave noise, or else they take most of
    what is left without them. (Set on an opponent's loose cable and voluntary torque.)
    """
    trace, rows = outcome.trace, outcome.trace.rows
    found = [step.taken.candidate for step in trace.steps]
    if trace.verdict != Verdict.EFFECT_FOUND or not all(map(_linear, found)):
        return ""
    joints = {candidate.joint for candidate in found}
    if not joints or not joints <= {*rows.recording.limbs} & {*_far(outcome)}:
        return ""
    without = evaluate(trace.declared, rows).loss
    if without - trace.score.loss > MOST * without:
        return ""
    names = ", ".join(candidate.effect.name for candidate in found)
    return f"{names} came nearest, but left most of the residual; no name is given"


def _linear(candidate: Candidate) -> bool:
    """Whether an effect makes of the motion, or of the effort, what a linear filter does."""
    effect = candidate.effect
    return effect.channel or effect.filters or effect.adds_mass or effect.scales_effort


def worse_than_none(outcome: Outcome) -> dict[int, tuple[float, float]]:
    """Return error and effort of the joints of which no torque at all predicts more, Nm or N."""
    return {
        joint: (error, effort)
        for joint, (error, effort) in rms_by_joint(outcome.holdout.after).items()
        if error > WORSE_THAN_NONE * effort
    }


def left_beside_events(outcome: Outcome) -> bool:
    """Whether what a residual holds beside events, without a name, is more than noise."""
    far = set(_far(outcome)) - set(outcome.unsettled)
    structured = [joint for joint, own in outcome.structures.items() if own]
    shaken = [
        joint
        for joint, own in outcome.oscillations.items()
        if joint not in outcome.floors
        or max(peak.rms for peak in own) > MIN_LINE * outcome.floors[joint].value
    ]
    return bool(shaken or outcome.loads or far or structured or outcome.by_trial)


def _far(outcome: Outcome) -> list[int]:
    """Return the joints whose error in motion is not at its floor."""
    return [joint for joint in outcome.left if (outcome.over_floor(joint) or 0.0) > AT_FLOOR]


def _unsettled(outcome: Outcome, *, rubs: bool) -> tuple[int, ...]:
    """Return the joints that are far from their floor only for want of other trials to fit.

    The declared model, fitted to the held-out trials too, leaves no joint far from its floor: it
    lacks nothing, but what is declared of these joints is not determined without those trials.
    """
    trace, far = outcome.trace, _far(outcome)
    if trace.verdict != Verdict.ADEQUATE or outcome.left_out or not far:
        return ()
    recording = trace.rows.recording
    rows = select_rows(recording, tuple(range(len(recording.session.trials))))
    model = declared_model(recording, rows)
    noise = trace.explainable_before.noise
    if any(len(own) and joint not in noise for joint, own in rows.samples.items()):
        # A joint that only held-out trials move has none from those that were fitted.
        noise = {**explainable(model, rows).noise, **noise}
    rows = rows.reweighted(noise)
    expected = settled(model, evaluate(model, rows).coefficients)
    together = replace(outcome, left=left_in_band(recording, expected, rubs=rubs))
    return () if _far(together) else tuple(far)


def _large(
    trace: Trace, found: Mapping[int, list[Structure]], lowest: Mapping[int, Floor]
) -> dict[int, list[Structure]]:
    """Return what is large enough to matter next to floor and effort."""
    rows = trace.rows
    kept = {}
    for joint, own in found.items():
        count = max(len(rows.samples[joint]), 1)
        unit = np.sqrt(count) * rows.weight[rows.parts[joint].start]
        effort = MIN_EFFORT * np.sqrt(rows.effort_power(joint)) / unit
        smoothing = np.sqrt(rows.smoothing_power(joint)) / unit
        floor = lowest.get(joint)
        # What rounding leaves goes with what it rounds. (Set on a stranger's coarse arms.)
        rounds = floor is not None and floor.source == "quantisation"
        share = (1.0 if rounds else MIN_STRUCTURE) * (floor.value if floor else 0.0)
        least = max(share, float(min(effort, smoothing)))
        kept[joint] = [one for one in own if one.rms > least]
    return kept


def left_in_band(recording: Recording, expected: np.ndarray, *, rubs: bool) -> dict[int, float]:
    """Return what a prediction leaves of each joint in motion, without events, in the fit's band.

    Above it nothing is compared: an effort that a stiff controller drives there is no structure.
    Where friction passes through zero, and while the joint rests, the motion does not say what it
    is; the low-pass spreads that over its memory.

    Args:
        recording: all trials.
        expected: effort, (n, joints).
        rubs: whether there is friction in the model.

    Returns:
        Root mean square, Nm or N, of every joint that has an effort in motion.
    """
    edge = recording.edge
    memory = 2 * round(0.5 * recording.rate / recording.sampling.fit_cutoff) + 1
    smooth = recording.filtered(np.nan_to_num(expected))
    found = {}
    for joint in recording.joints:
        good = recording.usable & np.isfinite(recording.effort[:, joint])
        if recording.disturbed is not None:
            good &= ~recording.disturbed[:, joint]
        turning = recording.turning(joint)
        for piece in recording.slices:
            # What the filters touch at both ends, as in the fit.
            good[piece.start : piece.start + edge] = good[piece.stop - edge : piece.stop] = False
            if rubs:
                good[piece] &= ~maximum_filter1d(turning[piece], memory)
        if good.any():
            found[joint] = rms((recording.effort - smooth)[good, joint])
    return found


def oscillations(recording: Recording, errors: list[TrialError]) -> dict[int, list[Peak]]:
    """Return the narrow lines, or the band, of each joint's raw residual, if any."""
    rate = recording.sampling.recorded
    found = {}
    for joint in recording.joints:
        own = [error for error in errors if error.joint == joint and len(error.time) > 1]
        residuals, efforts = [], []
        for error in own:
            even = np.arange(error.time[0], error.time[-1], 1.0 / rate)
            residuals.append(np.interp(even, error.time, error.residual))
            efforts.append(np.interp(even, error.time, error.effort))
        highest = recording.sampling.fit_cutoff / 2.0
        if own and (alone := peaks(residuals, efforts, rate, highest)):
            found[joint] = alone
    return found
