"""The content of `report.json`: what was decided of a session, in the contract's words."""

from typing import Any

from analysis.closeloop.contract import SCHEMA, Verdict
from analysis.closeloop.identification.balance.accuracy import rms_by_joint, smooth_relative
from analysis.closeloop.identification.findings import Errors, Outcome, Trace
from analysis.closeloop.identification.nameable import ONE_WAY, moves_one_way
from analysis.closeloop.judgement.outcome import left_beside_events
from analysis.closeloop.report.diagnostics import diagnose
from analysis.closeloop.report.impedance import (
    identified_entries,
    impedance_entries,
    not_identified,
    off_by_form,
    trials_that_tell,
    undecided,
)
from analysis.closeloop.report.left_out import of_left_out
from analysis.closeloop.report.named import (
    declared_entries,
    effect_entries,
    late_efforts,
    of_gravity,
    refused_values,
    supposed,
    undetermined,
    without_value,
)
from analysis.closeloop.report.plain import CONVENTION, finite, session_entry
from analysis.closeloop.report.separating import separating_trial
from analysis.closeloop.report.shared import (
    link_values,
    of_unnamed_loads,
    payload_entries,
    undetermined_loads,
    unnamed_load_entries,
)
from analysis.closeloop.report.unexplained import (
    at_rest_where_worse,
    far_from_floor,
    floor_entries,
    not_settled,
    of_each_trial,
    of_wrong_torques,
    oscillating,
    unexplained,
    untouched,
)
from analysis.closeloop.report.unjudged import where_unjudged
from analysis.closeloop.session.recording import Recording


def json_report(outcome: Outcome) -> dict[str, Any]:
    """Return the report of a session, without what is known of the repaired model."""
    found, verdict = outcome.trace, outcome.verdict
    recording = found.rows.recording
    effects, impedance = effect_entries(found), impedance_entries(found)
    declared = declared_entries(found) + payload_entries(found.fits, found.rows)
    identified = identified_entries(outcome, impedance)
    unnamed = unnamed_load_entries(recording, outcome.loads)
    left = unexplained(outcome)
    warnings = [*_unread_effects(recording), *_model_remarks(recording), *found.notes]
    if outcome.left_out:
        warnings.append(
            "no trial has the role holdout: the errors under holdout are of each part of the fit "
            "trials, predicted by a fit to the other parts"
        )
    errors = {
        "holdout": _errors(outcome, outcome.holdout, relative=True),
        "fit": _errors(outcome, outcome.fit, relative=False),
    }
    report = {
        "schema": SCHEMA,
        "verdict": verdict,
        "convention": CONVENTION,
        "effects": effects,
        "error": errors,
        "impedance": impedance,
        "identified": identified,
        "declared": declared,
        "unnamed_loads": unnamed,
        "links": link_values(found.fit_of_steps[0]),
        "unexplained": left,
        "floor": floor_entries(recording, outcome.floors),
        "diagnostics": _diagnostics(found),
        "advice": [*advice(outcome), *trials_that_tell(identified)],
        "warnings": [
            *warnings,
            *of_left_out(recording, errors["fit"]),
            *far_from_floor(outcome),
            *where_unjudged(outcome, left),
            *of_each_trial(outcome),
            *of_wrong_torques(outcome),
            *at_rest_where_worse(recording, outcome.holdout),
            *not_settled(outcome),
            *not_identified(identified),
            *undecided(impedance),
            *off_by_form(found, impedance),
            *without_value(declared),
            *undetermined_loads(declared),
            *refused_values(effects),
            *undetermined(effects),
            *supposed(effects),
            *of_gravity(recording, effects),
            *late_efforts(effects),
            *of_unnamed_loads(unnamed, lone=len(recording.joints) == 1),
        ],
        "session": session_entry(recording),
        "ladder": _options(found),
    }
    report_of: dict[str, Any] = finite(report)
    return report_of


def _unread_effects(recording: Recording) -> list[str]:
    """Say which effects of a model that an earlier session repaired are not in this one."""
    left = [f"{name} of {joint}" for name, joint in recording.device.unread_effects]
    if not left:
        return []
    return [
        f"{recording.session.model} has effects of an earlier repair that are not read from it "
        f"({', '.join(left)}): name them in declared_effects to have them fitted again"
    ]


def _model_remarks(recording: Recording) -> list[str]:
    """Say what of the model's file is taken otherwise than it stands there."""
    return [f"{recording.session.model}: {remark}" for remark in recording.device.remarks]


def _errors(outcome: Outcome, errors: Errors, *, relative: bool) -> dict[str, Any]:
    recording = outcome.trace.rows.recording
    rate = recording.sampling.recorded
    first, last = rms_by_joint(errors.before), rms_by_joint(errors.after)
    entries = {}
    for joint, (before, effort) in first.items():
        name, after = recording.name(joint), last[joint][0]
        floor = outcome.floors.get(joint)
        entry = {
            "before": before,
            "after": after,
            "floor": None if floor is None else floor.value,
            "unit": recording.device.unit(name),
        }
        if relative:
            entry["relative_before"] = before / max(effort, 1e-300)
            entry["relative_after"] = after / max(effort, 1e-300)
            entry["smooth_relative_before"] = smooth_relative(errors.before, joint, rate)
            entry["smooth_relative_after"] = smooth_relative(errors.after, joint, rate)
        entries[name] = entry
    return entries


def advice(outcome: Outcome) -> list[str]:
    """Return what to record next, a sentence each; more follows from what is not identified."""
    found, verdict, recording = outcome.trace, outcome.verdict, outcome.trace.rows.recording
    lines = untouched(recording, outcome.events)
    for step in found.steps:
        taken = step.taken.candidate
        if step.equals or verdict == Verdict.NOT_IDENTIFIABLE:
            trial = separating_trial(recording, taken.joint, taken.effect)
            lines.append(f"To tell {taken.effect.name} from what looks alike: {trial}.")
    if verdict == Verdict.NOT_IDENTIFIABLE and (
        moves_one_way(found.rows) or not found.rows.grouped
    ):
        lines.append(
            "Record the movement to and fro, at two or more speeds, with every speed as its own "
            "group."
        )
    if verdict == Verdict.ADEQUATE and not found.rows.grouped:
        lines.append(
            "All fit trials share one group; another speed or posture would show more effects."
        )
    pushed_only = found.verdict != Verdict.UNEXPLAINED and not left_beside_events(outcome)
    if verdict == Verdict.UNEXPLAINED and moves_one_way(found.rows):
        lines.append(f"Move to and fro, at two or more speeds: {ONE_WAY}.")
    elif verdict == Verdict.UNEXPLAINED and not pushed_only:
        more = (
            "EMG, temperature, the limb's own angle" if recording.limbs else "temperature, currents"
        )
        lines += oscillating(outcome) or [
            "No catalogued effect explains what is left; `unexplained` names the recorded signals "
            f"that it goes with. Record more signals ({more})."
        ]
    return lines


def _diagnostics(found: Trace) -> dict[str, Any]:
    recording = found.rows.recording
    return {
        recording.name(joint): {
            word: diagnose(model, coefficients, found.rows, joint)
            for word, (model, coefficients) in zip(("before", "after"), found.fits, strict=True)
        }
        for joint in recording.joints
    }


def _options(found: Trace) -> list[list[dict[str, Any]]]:
    """Return every candidate that was tried at each step, best first."""
    recording = found.rows.recording
    return [
        [
            {
                "name": option.candidate.effect.name,
                "joint": recording.name(option.candidate.joint),
                "holdout_gain": step.share(option),
                "z": option.z,
                "refused": option.refused or None,
            }
            for option in step.options
        ]
        for step in found.steps
    ]
