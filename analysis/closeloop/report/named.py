"""The effects that were named: parameters, intervals and evidence, in the words of the contract."""

from typing import Any

import numpy as np

from analysis.closeloop.contract import Verdict
from analysis.closeloop.identification.findings import Trace
from analysis.closeloop.identification.model import Candidate, Channel, Model, Term, gain, unfitted
from analysis.closeloop.identification.uncertainty import Fits, leave_out
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
                "parameters": _parameters(model, coefficients, fits, candidate),
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


def _parameters(
    model: Model, coefficients: np.ndarray, fits: Fits, candidate: Candidate
) -> dict[str, Any]:
    """Return the physical parameters with their intervals."""
    effect, joint = candidate.effect, unfitted(model.recording, candidate.joint)
    parts: list[Term | Channel] = [*model.terms, *model.channels]
    theta = next(part.theta for part in parts if part.candidate == candidate)
    own: dict[int, float] = {}
    refitted: dict[int, np.ndarray] = {}
    for (term, found), (_, spread) in zip(
        model.split(coefficients), model.split(fits.coefficients), strict=True
    ):
        if term.candidate == candidate:
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
