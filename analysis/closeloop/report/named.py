"""Effects that were named or declared: parameters, intervals, evidence, in the contract's words."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from analysis.closeloop.contract import Verdict
from analysis.closeloop.identification.findings import Trace
from analysis.closeloop.identification.model import Candidate, Channel, Model, Term, gain, unfitted
from analysis.closeloop.identification.regression import Rows
from analysis.closeloop.identification.uncertainty import Fits, leave_out
from sim.effects.catalogue import BY_NAME, VISCOELASTIC
from sim.effects.effect import Theta
from sim.effects.motion import RecordedJoint
from sim.effects.parameter import unit_at


def effect_entries(found: Trace) -> list[dict[str, Any]]:
    """Return one entry for every effect of the answer, by held-out gain."""
    recording = found.rows.recording
    steps = sorted(found.steps, key=lambda step: -step.share(step.taken))
    named = found.verdict != Verdict.NOT_IDENTIFIABLE
    model, coefficients = found.fit_of_steps
    fits = leave_out(model, found.rows, coefficients) if steps else None
    entries = []
    for step in steps:
        assert fits is not None
        candidate = step.taken.candidate
        effect, joint = candidate.effect, candidate.joint
        others = list(dict.fromkeys(o.candidate.effect.name for o in step.equals))
        others = [name for name in others if name != effect.name]
        entries.append(
            {
                "name": effect.name,
                "joint": recording.name(joint),
                "parameters": _parameters(model, coefficients, fits, _part(model, candidate)),
                "indistinguishable_from": others,
                "separating_trial": effect.separating_trial if others or not named else None,
                "evidence": {
                    "holdout_gain": step.share(step.taken),
                    "p_value": step.p_value,
                    "signature": effect.signature,
                },
                "mujoco_element": effect.element,
            }
        )
    return entries


def declared_entries(found: Trace) -> list[dict[str, Any]]:
    """Return the fitted values of every declared effect but the impedance, before and after.

    `value` and `ci90` are those of the repaired model. A coefficient that other declared effects
    explain whole has no value.
    """
    recording = found.rows.recording
    wanted = [d for d in recording.session.declared if d.effect != VISCOELASTIC.name]
    if not wanted:
        return []
    before, after = (_declared_values(*fit, found.rows) for fit in found.fits)
    entries = []
    for declared in wanted:
        key = declared.effect, declared.joint
        values = {
            name: {
                **entry,
                "before": before[key][name]["value"],
                "ci90_before": before[key][name]["ci90"],
            }
            for name, entry in after.get(key, {}).items()
        }
        entries.append({"effect": declared.effect, "joint": declared.joint, "parameters": values})
    return entries


def _declared_values(
    model: Model, coefficients: np.ndarray, rows: Rows
) -> dict[tuple[str, str], dict[str, Any]]:
    """Return the parameters of a fitted model's declared effects, by effect and joint."""
    fits = leave_out(model, rows, coefficients)
    return {
        (term.effect.name, model.recording.name(term.joint)): _parameters(
            model, coefficients, fits, term
        )
        for term in model.terms
        if term.candidate is None and term.effect not in (None, VISCOELASTIC)
    }


def without_value(entries: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a warning for every declared effect that the fit gives no value."""
    lines = []
    for entry in entries:
        if not entry["parameters"]:
            why = (
                "it acts on the whole effort channel, and only an undeclared one is looked for"
                if BY_NAME[entry["effect"]].channel
                else "other declared effects explain it whole, or its joint does not move"
            )
            lines.append(f"declared {entry['effect']} of {entry['joint']} has no value: {why}")
    return lines


def _part(model: Model, candidate: Candidate) -> Term | Channel:
    """Return the part of a model that a found effect is."""
    parts: list[Term | Channel] = [*model.terms, *model.channels]
    return next(part for part in parts if part.candidate == candidate)


def _parameters(
    model: Model, coefficients: np.ndarray, fits: Fits, part: Term | Channel
) -> dict[str, Any]:
    """Return the physical parameters of a part of the model with their intervals."""
    candidate, theta = part.at, part.theta
    effect, joint = candidate.effect, unfitted(model.recording, candidate.joint)
    own: dict[int, float] = {}
    refitted: dict[int, np.ndarray] = {}
    for (term, found), (_, spread) in zip(
        model.split(coefficients), model.split(fits.coefficients), strict=True
    ):
        if term is part:
            own = dict(zip(term.kept, found.tolist(), strict=True))
            refitted = dict(zip(term.kept, spread.T, strict=True))
    scale = gain(model, coefficients, candidate.joint)
    entries = {}
    for key, reading in effect.readings(joint, theta).items():
        if reading.column is None:
            value, lowest = reading.of({}), -np.inf
            every = _moved(fits, candidate, joint, theta, key)
        elif reading.column in own:
            value = reading.of(own, scale)
            lowest = reading.lowest(effect.bound(reading.column), scale)
            every = np.asarray(reading.of(refitted, scale))
        else:
            continue
        unit = unit_at(effect.unit(key, theta), hinge=model.recording.is_hinge(candidate.joint))
        interval = list(fits.interval(every, float(value), lowest))
        entries[key] = {"value": value, "ci90": interval, "unit": unit}
    return entries


def _moved(
    fits: Fits, candidate: Candidate, joint: RecordedJoint, theta: Theta, key: str
) -> np.ndarray:
    """Return a fixed parameter with the non-linear parameters of each fit, to first order."""
    value = candidate.effect.fixed(joint, theta)[key]
    spread = np.full(len(fits.coefficients), value)
    for (*named, theta_name), values in fits.thetas.items():
        if tuple(named) != candidate.key:
            continue
        step = 1e-6 * max(1.0, abs(theta[theta_name]))
        moved = {**theta, theta_name: theta[theta_name] + step}
        slope = (candidate.effect.fixed(joint, moved)[key] - value) / step
        if slope:
            spread = value + slope * (values - theta[theta_name])
    return spread
