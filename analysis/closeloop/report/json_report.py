"""The content of `report.json`: what was decided of a session, in the contract's words."""

from typing import Any

import numpy as np

from analysis.closeloop.contract import SCHEMA, Verdict
from analysis.closeloop.identification.accuracy import rms_by_joint, smooth_relative
from analysis.closeloop.identification.findings import Trace
from analysis.closeloop.identification.outcome import Errors, Outcome
from analysis.closeloop.report.diagnostics import diagnose
from analysis.closeloop.report.impedance import impedance_entries, undecided
from analysis.closeloop.report.links import link_values
from analysis.closeloop.report.named import (
    declared_entries,
    effect_entries,
    refused_values,
    without_value,
)
from analysis.closeloop.report.unexplained import smooth_part, unexplained
from analysis.closeloop.session.recording import Recording

CONVENTION = "restoring"


def json_report(outcome: Outcome) -> dict[str, Any]:
    """Return the report of a session, without what is known of the repaired model."""
    found, verdict = outcome.trace, outcome.verdict
    recording = found.rows.recording
    effects, impedance = effect_entries(found), impedance_entries(found)
    declared = declared_entries(found)
    warnings = list(found.notes)
    if outcome.left_out:
        warnings.append(
            "no trial has the role holdout: the errors under holdout are those of each group "
            "predicted from the others"
        )
    report = {
        "schema": SCHEMA,
        "verdict": verdict,
        "convention": CONVENTION,
        "effects": effects,
        "error": {
            "holdout": _errors(found, outcome.holdout, relative=True),
            "fit": _errors(found, outcome.fit, relative=False),
        },
        "impedance": impedance,
        "declared": declared,
        "links": link_values(found.fit_of_steps[0]),
        "unexplained": unexplained(found, outcome.recorded.after, outcome.oscillations, verdict),
        "diagnostics": _diagnostics(found),
        "advice": _advice(found, verdict),
        "warnings": [
            *warnings,
            *undecided(impedance),
            *without_value(declared),
            *refused_values(effects),
        ],
        "session": _session(recording),
        "ladder": _options(found),
    }
    finite: dict[str, Any] = _finite(report)
    return finite


def _session(recording: Recording) -> dict[str, Any]:
    session, sampling = recording.session, recording.sampling
    return {
        "folder": session.folder.name,
        "model": session.model,
        "trials": [
            {"file": t.file, "label": t.label, "group": t.group, "role": t.role}
            for t in session.trials
        ],
        "rate_hz": sampling.recorded,
        "kinematic_cutoff_hz": sampling.cutoff,
        "kinematic_cutoff_from": sampling.cutoff_from,
        "fit_cutoff_hz": sampling.fit_cutoff,
    }


def _errors(found: Trace, errors: Errors, *, relative: bool) -> dict[str, Any]:
    recording, left = found.rows.recording, found.ceiling_after
    rate = recording.sampling.recorded
    first, last = rms_by_joint(errors.before), rms_by_joint(errors.after)
    share = left.remains / max(left.model_loss, 1e-300)
    entries = {}
    for joint, (before, effort) in first.items():
        name, after = recording.name(joint), last[joint][0]
        # The floor is what splines on the recorded signals would leave of the raw error.
        smooth = smooth_part(found, joint) * max(share, 0.0)
        entry = {
            "before": before,
            "after": after,
            "floor": float(np.sqrt(max(after**2 - smooth, 0.05 * after**2))),
            "unit": recording.device.unit(name),
        }
        if relative:
            entry["relative_before"] = before / max(effort, 1e-300)
            entry["relative_after"] = after / max(effort, 1e-300)
            entry["smooth_relative_before"] = smooth_relative(errors.before, joint, rate)
            entry["smooth_relative_after"] = smooth_relative(errors.after, joint, rate)
        entries[name] = entry
    return entries


def _advice(found: Trace, verdict: Verdict) -> list[str]:
    advice = []
    for step in found.steps:
        effect = step.taken.candidate.effect
        if step.equals or verdict == Verdict.NOT_IDENTIFIABLE:
            advice.append(
                f"To tell {effect.name} from what looks alike: {effect.separating_trial}."
            )
    if verdict == Verdict.NOT_IDENTIFIABLE:
        advice.append(
            "Record the movement to and fro, at two or more speeds, with every speed as its own "
            "group."
        )
    if verdict == Verdict.ADEQUATE and not found.rows.grouped:
        advice.append(
            "All fit trials share one group; another speed or posture would show more effects."
        )
    if verdict == Verdict.UNEXPLAINED:
        advice.append(
            "No catalogued effect explains what is left; `unexplained` says on which recorded "
            "signals it depends. Record more there (EMG, temperature, the limb's own angle)."
        )
    return advice


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


def _finite(content: Any) -> Any:
    """Return JSON content with plain numbers; what is not finite becomes null."""
    if isinstance(content, dict):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    if isinstance(content, np.floating | np.integer):
        content = content.item()
    if isinstance(content, float) and not np.isfinite(content):
        return None
    return content
