"""The whole answer to one session, in the contract's words."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from analysis.closeloop.contract import SCHEMA, Verdict
from analysis.closeloop.identification.accuracy import (
    TrialError,
    left_out_errors,
    raw_errors,
    rms_by_joint,
    settled,
    smooth_relative,
)
from analysis.closeloop.identification.impedance import impedance_entries, undecided
from analysis.closeloop.identification.interface import beyond_interface
from analysis.closeloop.identification.tracing import Trace, trace
from analysis.closeloop.identification.unexplained import oscillations, smooth_part, unexplained
from analysis.closeloop.load import load_session
from analysis.closeloop.report.diagnostics import diagnose
from analysis.closeloop.report.named import effect_entries
from analysis.closeloop.session.recording import Recording

CONVENTION = "restoring"


@dataclass(frozen=True, kw_only=True)
class Answer:
    """The report and what its pictures and files are made of."""

    report: dict[str, Any]
    trace: Trace
    recording: Recording
    before: list[TrialError]
    after: list[TrialError]


def answer(folder: Path, progress: Callable[[str], None] = lambda _: None) -> Answer:
    """Close the loop on a session's folder.

    Raises:
        SessionError: the session cannot be analysed.
    """
    progress("reading")
    recording = load_session(folder)
    session = recording.session
    found = beyond_interface(trace(recording, progress))
    progress("errors and intervals")
    rows = found.rows
    holdouts = tuple(i for i, trial in enumerate(session.trials) if trial.role == "holdout")
    warnings = list(found.notes)
    models = (
        (found.declared, found.declared_score.coefficients),
        (
            found.model,
            found.score.coefficients,
        ),
    )
    expected = [settled(*m) for m in models]
    fitted = [raw_errors(recording, e, recording.fit_trials) for e in expected]
    held = [raw_errors(recording, e, holdouts) for e in expected]
    if not held[0]:
        held = [left_out_errors(model, rows) for model, _ in models]
        warnings.append(
            "no trial has the role holdout: the errors under holdout are those of each group "
            "predicted from the others"
        )
    beyond = oscillations(recording, fitted[1])
    verdict = found.verdict
    if verdict == Verdict.ADEQUATE and beyond:
        verdict = Verdict.UNEXPLAINED
    effects, impedance = effect_entries(found), impedance_entries(found)
    report = {
        "schema": SCHEMA,
        "verdict": verdict,
        "convention": CONVENTION,
        "effects": effects,
        "error": {
            "holdout": _errors(recording, found, held[0], held[1], relative=True),
            "fit": _errors(recording, found, fitted[0], fitted[1], relative=False),
        },
        "impedance": impedance,
        "unexplained": unexplained(
            recording, found, fitted[1] + (held[1] if holdouts else []), beyond, verdict
        ),
        "diagnostics": _diagnostics(found),
        "advice": _advice(found, verdict),
        "warnings": warnings,
        "session": {
            "folder": folder.name,
            "model": session.model,
            "trials": [
                {"file": t.file, "label": t.label, "group": t.group, "role": t.role}
                for t in session.trials
            ],
            "rate_hz": recording.sampling.recorded,
            "kinematic_cutoff_hz": recording.sampling.cutoff,
            "fit_cutoff_hz": recording.sampling.fit_cutoff,
        },
        "ladder": _ladder(recording, found),
    }
    warnings += undecided(impedance)
    return Answer(
        report=_finite(report),
        trace=found,
        recording=recording,
        before=fitted[0] + ([] if not holdouts else held[0]),
        after=fitted[1] + ([] if not holdouts else held[1]),
    )


def _errors(
    recording: Recording,
    found: Trace,
    before: list[TrialError],
    after: list[TrialError],
    *,
    relative: bool,
) -> dict[str, Any]:
    first, last = rms_by_joint(before), rms_by_joint(after)
    left = found.ceiling_after
    share = (left.model_loss - left.ceiling_loss) / max(left.model_loss, 1e-300)
    entries = {}
    for joint, (error, effort) in first.items():
        name = recording.device.joints[joint]
        # The floor is what splines on the recorded signals would leave of the raw error.
        smooth = smooth_part(recording, found, joint) * max(share, 0.0)
        floor = float(np.sqrt(max(last[joint][0] ** 2 - smooth, 0.05 * last[joint][0] ** 2)))
        entries[name] = {
            "before": error,
            "after": last[joint][0],
            "floor": floor,
            "unit": recording.device.unit(name),
        }
        if relative:
            entries[name]["relative_before"] = error / max(effort, 1e-300)
            entries[name]["relative_after"] = last[joint][0] / max(effort, 1e-300)
            rate = recording.sampling.recorded
            for word, errors in (("before", before), ("after", after)):
                entries[name][f"smooth_relative_{word}"] = smooth_relative(errors, joint, rate)
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
    models = (
        ("before", found.declared, found.declared_score.coefficients),
        ("after", found.model, found.score.coefficients),
    )
    return {
        recording.device.joints[joint]: {
            word: diagnose(model, coefficients, found.rows, joint)
            for word, model, coefficients in models
        }
        for joint in recording.joints
    }


def _ladder(recording: Recording, found: Trace) -> list[list[dict[str, Any]]]:
    return [
        [
            {
                "name": option.candidate.effect.name,
                "joint": recording.device.joints[option.candidate.joint],
                "holdout_gain": option.gain / max(step.before, 1e-300),
                "z": option.z,
                "refused": option.refused or None,
            }
            for option in step.ladder
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
