"""What is left that no catalogued effect explains: described, never given a physical name."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.signal import welch

from analysis.closeloop.contract import Verdict
from analysis.closeloop.identification.balance.accuracy import rms_by_joint
from analysis.closeloop.identification.balance.trial_error import TrialError
from analysis.closeloop.identification.findings import (
    AT_FLOOR,
    Errors,
    Event,
    Floor,
    Outcome,
    Trace,
)
from analysis.closeloop.identification.spectrum import Peak
from analysis.closeloop.judgement.outcome import worse_than_none
from analysis.closeloop.report.unjudged import MOSTLY, OF_ALL, beyond_floor
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.runs import MOVING
from intake.xml import listed

#: A trial or a moment whose residual is this many times the usual one stands out.
ODD = 1.5
ODD_SECONDS = 0.25
#: Share of a joint's declared range within which it is at an end of it.
END_OF_RANGE = 0.01
#: What the size of the unexplained is the root mean square of: of several parts, the largest.
OF_SIGNALS = "what goes with a signal or oscillates, over the fitted trials"
OF_TRIALS = "the error of a trial that stands out, less the usual one"
OF_FLOOR = "the error in motion, less the floor"
OF_EVENTS = "the error during the events alone, not over all of the trials"
OF_PEAKS = "the events, as half sines of their peaks"
#: What a stiffness that differs from trial to trial goes with.
TRIAL = "trial"
#: Signals of one joint that are listed.
MAX_SIGNALS = 3


def unexplained(outcome: Outcome) -> dict[str, Any]:
    """Describe, per joint, what no effect explains: size, signals it depends on, band, when.

    A joint is there whose residual goes with a signal, stands above its floor, is larger in some
    trials than in the others, or holds events; and one whose held-out error in motion is far above
    its floor in frequencies that are not judged, unless what else stands there is most of it.
    """
    found, beyond = outcome.trace, outcome.oscillations
    recording, left = found.rows.recording, found.explainable_after
    entries = {}
    rubbing = {term.joint for term in found.model.terms if term.rubs}
    for joint in recording.joints:
        name = recording.name(joint)
        own = [e for e in outcome.recorded.after if e.joint == joint]
        held_out = [e for e in outcome.holdout.after if e.joint == joint]
        if joint in rubbing:
            own, held_out = (
                [_in_motion(recording, error) for error in errors] for errors in (own, held_out)
            )
        own = [error for error in own if len(error.time) > 1]
        if not own:
            continue
        events = event_entries(recording, [e for e in outcome.events if e.joint == joint])
        depends = [signal for signal, _ in left.depends_on]
        depends += [one.signal for one in outcome.structures.get(joint, [])[:MAX_SIGNALS]]
        if joint in outcome.by_trial:
            depends.append(TRIAL)
        if joint in beyond:
            depends.append("time")
        ratio = outcome.over_floor(joint) or 0.0
        # A trial that leaves far more than the fitted ones holds something they did not show.
        fitted = [_mean_square(error) for error in own if error.trial in recording.fit_trials]
        usual = float(np.median(fitted)) if fitted else np.inf
        disturbed = {event.trial for event in outcome.events if event.joint == joint}
        odd = [error for error in own if _mean_square(error) > ODD**2 * usual]
        alone = [error for error in odd if error.trial not in disturbed]
        far = beyond_floor(held_out, outcome.floors.get(joint))
        said = depends or events or ratio > AT_FLOOR or alone or far
        if not said and outcome.verdict != Verdict.UNEXPLAINED:
            continue
        share = max(0.0, 1.0 - left.splines_loss / max(left.model_loss, 1e-300))
        lines = sum(peak.rms**2 for peak in beyond.get(joint, []))
        sizes = [one.rms for one in outcome.structures.get(joint, [])]
        sizes += [outcome.by_trial[joint].rms] if joint in outcome.by_trial else []
        strongest = max(sizes, default=0.0)
        squares = {
            OF_SIGNALS: max(share * smooth_part(found, joint) + lines, strongest**2),
            OF_TRIALS: max([0.0, *(_mean_square(error) - usual for error in odd)]),
        }
        if ratio > AT_FLOOR:
            squares[OF_FLOOR] = (ratio**2 - 1.0) * outcome.floors[joint].value ** 2
        if events:
            squares[OF_EVENTS] = _power(recording, own, events)
        if max(squares.values()) < MOSTLY * far:
            squares[OF_ALL] = far
        largest = max(squares, key=lambda part: squares[part])
        size = float(np.sqrt(squares[largest]))
        if not said and not size:
            continue
        entries[name] = {
            "rms": size,
            "rms_of": largest,
            "unit": recording.device.unit(name),
            "depends_on": list(dict.fromkeys(depends)),
            "band_hz": _band(
                recording,
                own,
                [] if odd or largest == OF_ALL else beyond.get(joint, []),
            ),
            "mostly_in": [_where(recording, error, usual) for error in odd],
            "events": events,
        }
    # A joint that rests all the time has no balance to explain; somebody may push it all the same.
    for joint in sorted({event.joint for event in outcome.events} - set(recording.joints)):
        own_events = [event for event in outcome.events if event.joint == joint]
        entries[recording.name(joint)] = only_events(recording, own_events)
    return entries


def only_events(recording: Recording, events: Sequence[Event]) -> dict[str, Any]:
    """Return the entry of a joint that does not move, with its events."""
    name = recording.name(events[0].joint)
    return {
        "rms": float(np.sqrt(np.mean([event.peak**2 for event in events]) / 2.0)),
        "rms_of": OF_PEAKS,
        "unit": recording.device.unit(name),
        "depends_on": [],
        "band_hz": None,
        "mostly_in": [],
        "events": event_entries(recording, events),
    }


def event_entries(recording: Recording, events: Sequence[Event]) -> list[dict[str, Any]]:
    """Return events in the contract's words.

    `peak` has the residual's sign, what the motor must add; `on_joint` is what somebody puts on
    the joint.
    """
    return [
        {
            "file": recording.session.trials[event.trial].file,
            "from": event.begin,
            "to": event.end,
            "peak": event.peak,
            "on_joint": -event.peak,
        }
        for event in events
    ]


def untouched(recording: Recording, events: Sequence[Event]) -> list[str]:
    """Return what to do about events: repeat their trials with nobody near but whose limb it is."""
    files = dict.fromkeys(recording.session.trials[event.trial].file for event in events)
    nobody = "nothing and nobody touching the robot"
    if recording.limbs:
        nobody = "the limb relaxed, and nothing and nobody else touching the robot"
    return [
        f"Repeat {file} with {nobody}: something seems to have pushed it at the times that are "
        "listed as events under `unexplained`. If they come back, the model lacks what acts there."
        for file in files
    ] + _at_ends(recording, events)


def _at_ends(recording: Recording, events: Sequence[Event]) -> list[str]:
    """Say of events at the end of a joint's declared range that a stop may have pushed it."""
    said: dict[str, list[str]] = {}
    for event in events:
        name = recording.name(event.joint)
        low, high = recording.device.range(name)
        near = END_OF_RANGE * (high - low)
        during = (recording.time >= event.begin) & (recording.time <= event.end)
        place = recording.position[during & (recording.trial == event.trial), event.joint]
        if low < high and np.any((place < low + near) | (place > high - near)):
            said.setdefault(name, []).append(f"{event.begin:.2f} s")
    return [
        f"{name} was at the end of the range that the model declares at {listed(times)}: it may "
        "have run into a stop."
        for name, times in said.items()
    ]


def oscillating(outcome: Outcome) -> list[str]:
    """Return what to look for where an oscillation makes most of a joint's error, a line each."""
    recording, lines = outcome.trace.rows.recording, []
    for joint, own in outcome.oscillations.items():
        strongest = max(own, key=lambda peak: peak.rms)
        errors = [error for error in outcome.recorded.after if error.joint == joint]
        if strongest.rms**2 > MOSTLY * np.mean([_mean_square(error) for error in errors]):
            lines.append(
                f"What is left of {recording.name(joint)} oscillates at {strongest.low_hz:.3g} to "
                f"{strongest.high_hz:.3g} Hz: look for what vibrates there (a pump, a fan, a loose "
                "part, a tremor, a controller that rings) and repeat without it."
            )
    return lines


def floor_entries(recording: Recording, found: Mapping[int, Floor]) -> dict[str, Any]:
    """Return every joint's floor, and where it is from; null where a channel has none."""
    entries: dict[str, Any] = {}
    for joint in recording.joints:
        name, floor = recording.name(joint), found.get(joint)
        entries[name] = {
            "value": None if floor is None else floor.value,
            "unit": recording.device.unit(name),
            "from": None if floor is None else floor.source,
        }
    return entries


def far_from_floor(outcome: Outcome) -> list[str]:
    """Return a warning for every joint whose error is not at its floor, or that has none."""
    recording = outcome.trace.rows.recording
    lines = []
    for joint in recording.joints:
        name, ratio = recording.name(joint), outcome.over_floor(joint)
        unit = recording.device.unit(name)
        if ratio is None:
            lines.append(
                f"{name}: the noise of its effort (its floor) is not known, so the size of its "
                "error says nothing: no movement is repeated, noise above the band of the movement "
                "cannot be seen (the rate is too low, or a low-pass removed it), and no noise is "
                "declared under sensors"
            )
        elif ratio > AT_FLOOR:
            floor = outcome.floors[joint]
            lines.append(
                f"{name}: the error in motion is {ratio:.1f} times the noise of its effort (its "
                f"floor, {floor.value:.3g} {unit}; {floor.source})"
            )
    return lines


def of_each_trial(outcome: Outcome) -> list[str]:
    """Return a warning for every limb whose stiffness differs from trial to trial."""
    recording, lines = outcome.trace.rows.recording, []
    for joint, own in outcome.by_trial.items():
        name = recording.name(joint)
        unit = f"{recording.device.unit(name)}/{recording.device.angle_unit(name)}"
        each = [
            f"{stiffness:.3g} {unit} in {recording.session.trials[trial].file}"
            for trial, stiffness in own.stiffness.items()
        ]
        lines.append(
            f"the stiffness of {name} differs from trial to trial, and no one number describes it "
            f"({listed(each)}): muscles whose tone changes do that, or a limb held otherwise"
        )
    return lines


def of_wrong_torques(outcome: Outcome) -> list[str]:
    """Return a warning for every joint whose effort the final model predicts worse than none."""
    recording = outcome.trace.rows.recording
    return [
        f"{recording.name(joint)}: the model's error is {error:.3g}, and the effort itself only "
        f"{effort:.3g} {recording.device.unit(recording.name(joint))}: are units, sign, columns "
        "and masses as declared?"
        for joint, (error, effort) in worse_than_none(outcome).items()
    ]


def at_rest_where_worse(recording: Recording, holdout: Errors) -> list[str]:
    """Return a warning for every joint whose error grows where it only rests."""
    before, after = map(rms_by_joint, (holdout.before, holdout.after))
    held_out = np.isin(recording.trial, [error.trial for error in holdout.after])
    lines = []
    for joint, (error, _) in after.items():
        way = float(np.ptp(recording.position[held_out, joint]))
        begun, ended = f"{before[joint][0]:.3g}", f"{error:.3g}"
        if error <= before[joint][0] or begun == ended or way > MOVING:
            continue
        name = recording.name(joint)
        grows = f"{begun} to {ended} {recording.device.unit(name)}"
        lines.append(
            f"{name}: its error grows, {grows}, in held-out trials in which it only rests; at rest "
            "friction balances any torque, so neither number tells whether what was found is "
            "right: hold out a trial that moves it"
        )
    return lines


def not_settled(outcome: Outcome) -> list[str]:
    """Return a warning for every joint of which the trials do not settle what is declared."""
    recording = outcome.trace.rows.recording
    lines = []
    for joint in outcome.unsettled:
        name = recording.name(joint)
        own = ", ".join(d.effect for d in recording.session.declared if d.joint == name)
        there = f" there ({own})" if own else ""
        lines.append(
            f"{name}: the fit trials do not determine what is declared{there}: fitted to the "
            "held-out trials too, the same model predicts them down to the noise; add fit trials "
            "that move it as the held-out ones do, at two or more speeds"
        )
    return lines


def _in_motion(recording: Recording, error: TrialError) -> TrialError:
    """Return the error where the joint moves: at rest its friction has any value."""
    own = recording.trial == error.trial
    clock, turning = recording.time[own], recording.turning(error.joint)[own]
    nearest = np.minimum(np.searchsorted(clock, error.time), len(clock) - 1)
    return error.where(~turning[nearest])


def _mean_square(error: TrialError) -> float:
    return float(np.mean(error.residual**2))


def _power(
    recording: Recording, errors: Sequence[TrialError], events: Sequence[Mapping[str, Any]]
) -> float:
    """Return the mean square of the residual within events, Nm2 or N2."""
    parts = [
        error.residual[(error.time >= event["from"]) & (error.time <= event["to"])]
        for error in errors
        for event in events
        if recording.session.trials[error.trial].file == event["file"]
    ]
    every = np.concatenate(parts) if parts else np.zeros(1)
    return float(np.mean(every**2)) if len(every) else 0.0


def _where(recording: Recording, error: TrialError, usual: float) -> dict[str, Any]:
    """Say in which file, and from when to when, a trial's residual is larger than usual."""
    count = max(1, min(int(ODD_SECONDS * recording.sampling.recorded), len(error.time)))
    power = np.convolve(error.residual**2, np.full(count, 1.0 / count), mode="same")
    rows = np.flatnonzero(power > ODD**2 * usual)
    first, last = (rows[0], rows[-1]) if len(rows) else (0, len(power) - 1)
    return {
        "file": recording.session.trials[error.trial].file,
        "rms": float(np.sqrt(_mean_square(error))),
        "time": [float(error.time[first]), float(error.time[last])],
    }


def _band(recording: Recording, errors: list[TrialError], beyond: list[Peak]) -> list[float] | None:
    """Return where 80 % of the residual's power above the white floor lies, Hz; None if nowhere.

    Of a joint that is held but for an instant a few samples are left, and they may show no band.
    """
    if beyond:
        return [min(peak.low_hz for peak in beyond), max(peak.high_hz for peak in beyond)]
    rate = recording.sampling.recorded
    worst = max(errors, key=_mean_square)
    frequency, power = welch(worst.residual, rate, nperseg=min(len(worst.time), int(4 * rate)))
    above = np.maximum(power - np.median(power[len(power) // 2 :]), 0.0)
    if not above.any():
        return None
    total = np.cumsum(above) / float(above.sum())
    low, high = np.searchsorted(total, [0.1, 0.9])
    return [float(frequency[low]), float(frequency[min(high, len(frequency) - 1)])]


def smooth_part(found: Trace, joint: int) -> float:
    """Return the mean square of a joint's low-passed residual under the final model."""
    rows, part = found.rows, found.rows.parts[joint]
    base, _ = found.model.base(rows)
    left = found.model.target(rows) - base @ found.score.coefficients
    if not len(left[part]):
        return 0.0
    return float(np.mean((left[part] / rows.weight[part]) ** 2))
