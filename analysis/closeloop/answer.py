"""The whole answer to one session, in the contract's words."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from analysis.closeloop.accuracy import (
    TrialError,
    left_out_errors,
    raw_errors,
    rms_by_joint,
    settled,
)
from analysis.closeloop.catalogue import BY_NAME, VISCOELASTIC
from analysis.closeloop.device import load_device
from analysis.closeloop.interface import beyond_interface
from analysis.closeloop.model import Model, gains, impedances
from analysis.closeloop.plausibility import check_signs, check_trial
from analysis.closeloop.recording import Recording, record
from analysis.closeloop.session import Session, read_session
from analysis.closeloop.tracing import Step, Trace, p_value, trace
from analysis.closeloop.trial_csv import read_trial
from analysis.closeloop.uncertainty import bootstrap, interval
from analysis.closeloop.unexplained import narrow_lines, smooth_part, unexplained

SEED = 20231167
CONVENTION = "restoring"


@dataclass(frozen=True, kw_only=True)
class Answer:
    """The report and what its pictures and files are made of."""

    report: dict[str, Any]
    trace: Trace
    recording: Recording
    before: list[TrialError]
    after: list[TrialError]


def load_session(folder: Path) -> tuple[Session, Recording]:
    """Read a session, refuse what cannot be right, and bring it to one clock.

    Raises:
        SessionError: the first thing that is wrong.
    """
    session = read_session(folder, (VISCOELASTIC, *BY_NAME))
    device = load_device(session)
    declared = tuple(dict.fromkeys(entry.joint for entry in session.declared))
    trials = []
    for listed in session.trials:
        trial = read_trial(folder, listed, device.recorded_joints, declared)
        check_trial(trial, device)
        trials.append(trial)
    session = replace(session, trials=tuple(trials))
    recording = record(session, device)
    check_signs(recording)
    return session, recording


def answer(folder: Path, progress: Callable[[str], None] = lambda _: None) -> Answer:
    """Close the loop on a session's folder.

    Raises:
        SessionError: the session cannot be analysed.
    """
    progress("reading")
    session, recording = load_session(folder)
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
    lines = narrow_lines(recording, fitted[1])
    verdict = found.verdict
    if verdict == "adequate" and lines:
        verdict = "unexplained"
    rng = np.random.default_rng(SEED)
    report = {
        "schema": 1,
        "verdict": verdict,
        "convention": CONVENTION,
        "effects": _effects(found, rng),
        "error": {
            "holdout": _errors(recording, found, held[0], held[1], relative=True),
            "fit": _errors(recording, found, fitted[0], fitted[1], relative=False),
        },
        "impedance": _impedances(found, rng),
        "unexplained": unexplained(recording, found, fitted[1], lines, verdict),
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
    return Answer(
        report=_finite(report),
        trace=found,
        recording=recording,
        before=fitted[0] + ([] if not holdouts else held[0]),
        after=fitted[1] + ([] if not holdouts else held[1]),
    )


def _effects(found: Trace, rng: np.random.Generator) -> list[dict[str, Any]]:
    recording = found.rows.recording
    steps = sorted(found.steps, key=lambda step: -_share(step))
    named = found.verdict != "not_identifiable"
    model, coefficients = found.model, found.score.coefficients
    if not named and steps:
        model = found.steps[0].taken.model
        coefficients = found.steps[0].taken.score.coefficients
    draws, thetas = bootstrap(model, found.rows, coefficients, rng) if steps else (None, {})
    entries = []
    for step in steps:
        effect, joint = step.taken.candidate.effect, step.taken.candidate.joint
        others = list(dict.fromkeys(o.candidate.effect.name for o in step.equals))
        others = [name for name in others if name != effect.name]
        entries.append(
            {
                "name": effect.name,
                "joint": recording.device.joints[joint],
                "parameters": _parameters(model, coefficients, draws, thetas, effect.name, joint),
                "indistinguishable_from": others,
                "separating_trial": effect.separating_trial if others or not named else None,
                "evidence": {
                    "holdout_gain": _share(step),
                    "p_value": p_value(step.taken.z, len(step.ladder)),
                    "signature": effect.signature,
                },
                "mujoco_element": effect.element,
            }
        )
    return entries


def _share(step: Step) -> float:
    return step.taken.gain / max(step.before, 1e-300)


def _parameters(
    model: Model,
    coefficients: np.ndarray,
    draws: np.ndarray | None,
    thetas: Mapping[tuple[str, int, str], np.ndarray],
    name: str,
    joint: int,
) -> dict[str, Any]:
    """Return the physical parameters with their intervals."""
    effect, start = BY_NAME[name], 0
    theta: dict[str, float] = {}
    kept: tuple[int, ...] = ()
    own, own_draws = np.empty(0), np.empty((0, 0))
    for channel in model.channels:
        if channel.candidate.key == (name, joint):
            theta = dict(channel.theta)
    for term in model.terms:
        stop = start + len(term.kept)
        if term.candidate is not None and term.candidate.key == (name, joint):
            theta, kept, own = dict(term.theta), term.kept, coefficients[start:stop]
            own_draws = draws[:, start:stop] if draws is not None else own[None, :]
        start = stop
    scale = gains(model, coefficients).get(joint, 1.0)
    entries = {}
    for key, parameter in effect.parameters(model.recording, joint, theta).items():
        if parameter.column is not None:
            if parameter.column not in kept:
                continue
            at = kept.index(parameter.column)
            value, spread = float(own[at]), own_draws[:, at]
            if name == "torque_gain":
                value, spread = 1.0 / (1.0 + value), 1.0 / np.maximum(1.0 + spread, 0.05)
            else:
                value, spread = value * parameter.scale * scale, spread * parameter.scale * scale
        else:
            assert parameter.value is not None
            value, spread = parameter.value, np.array([parameter.value])
            for (own_name, own_joint, theta_name), values in thetas.items():
                if (own_name, own_joint) != (name, joint):
                    continue
                step = 1e-6 * max(1.0, abs(theta[theta_name]))
                moved = {**theta, theta_name: theta[theta_name] + step}
                shifted = effect.parameters(model.recording, joint, moved)[key].value
                assert shifted is not None
                slope = (shifted - value) / step
                if slope:
                    spread = value + slope * (values - theta[theta_name])
        entries[key] = {
            "value": value,
            "ci90": interval(spread, value),
            "unit": parameter.unit,
        }
    return entries


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
    return entries


def _impedances(found: Trace, rng: np.random.Generator) -> dict[str, Any]:
    recording = found.rows.recording
    both = []
    for model, score in ((found.declared, found.declared_score), (found.model, found.score)):
        draws, _ = bootstrap(model, found.rows, score.coefficients, rng)
        values = impedances(model, score.coefficients)
        spread = [impedances(model, draw) for draw in draws]
        both.append((values, spread))
    entries: dict[str, Any] = {}
    for joint in both[0][0]:
        name = recording.device.joints[joint]
        angle, unit = recording.device.angle_unit(name), recording.device.unit(name)
        units = {
            "stiffness": f"{unit}/{angle}",
            "damping": "Nm s/rad" if unit == "Nm" else "N s/m",
            "neutral_angle": angle,
        }
        entries[name] = {}
        for key, own_unit in units.items():
            entry: dict[str, Any] = {"unit": own_unit}
            for word, (values, spread) in zip(("before", "after"), both, strict=True):
                value = values[joint][key]
                draws = np.array([draw[joint][key] for draw in spread])
                entry[word] = value
                entry[f"ci90_{word}"] = interval(draws[np.isfinite(draws)], value)
            entries[name][key] = entry
    return entries


def _advice(found: Trace, verdict: str) -> list[str]:
    advice = []
    for step in found.steps:
        effect = step.taken.candidate.effect
        if step.equals or verdict == "not_identifiable":
            advice.append(
                f"To tell {effect.name} from what looks alike: {effect.separating_trial}."
            )
    if verdict == "not_identifiable":
        advice.append(
            "Record the movement to and fro, at two or more speeds, with every speed as its own "
            "group."
        )
    if verdict == "adequate" and not found.rows.grouped:
        advice.append(
            "All fit trials share one group; another speed or posture would show more effects."
        )
    if verdict == "unexplained":
        advice.append(
            "No catalogued effect explains what is left; `unexplained` says on which recorded "
            "signals it depends. Record more there (EMG, temperature, the limb's own angle)."
        )
    return advice


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
