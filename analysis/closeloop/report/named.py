"""The effects that were named: parameters, intervals and evidence, in the words of the contract."""

from typing import Any

import numpy as np

from analysis.closeloop.catalogue import BY_NAME
from analysis.closeloop.identification.model import Model, gains
from analysis.closeloop.identification.tracing import Step, Trace, p_value
from analysis.closeloop.identification.uncertainty import Fits, leave_out


def effect_entries(found: Trace) -> list[dict[str, Any]]:
    """Return one entry for every effect of the answer, by held-out gain."""
    recording = found.rows.recording
    steps = sorted(found.steps, key=lambda step: -_share(step))
    named = found.verdict != "not_identifiable"
    model, coefficients = found.model, found.score.coefficients
    if not named and steps:
        model = found.steps[0].taken.model
        coefficients = found.steps[0].taken.score.coefficients
    fits = leave_out(model, found.rows, coefficients) if steps else None
    entries = []
    for step in steps:
        assert fits is not None
        effect, joint = step.taken.candidate.effect, step.taken.candidate.joint
        others = list(dict.fromkeys(o.candidate.effect.name for o in step.equals))
        others = [name for name in others if name != effect.name]
        entries.append(
            {
                "name": effect.name,
                "joint": recording.device.joints[joint],
                "parameters": _parameters(model, coefficients, fits, effect.name, joint),
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
    fits: Fits,
    name: str,
    joint: int,
) -> dict[str, Any]:
    """Return the physical parameters with their intervals."""
    effect, start = BY_NAME[name], 0
    theta: dict[str, float] = {}
    kept: tuple[int, ...] = ()
    own, refitted = np.empty(0), np.empty((0, 0))
    for channel in model.channels:
        if channel.candidate.key == (name, joint):
            theta = dict(channel.theta)
    for term in model.terms:
        stop = start + len(term.kept)
        if term.candidate is not None and term.candidate.key == (name, joint):
            theta, kept, own = dict(term.theta), term.kept, coefficients[start:stop]
            refitted = fits.coefficients[:, start:stop]
        start = stop
    scale = gains(model, coefficients).get(joint, 1.0)
    entries = {}
    for key, parameter in effect.parameters(model.recording, joint, theta).items():
        lowest = -np.inf
        if parameter.column is not None:
            if parameter.column not in kept:
                continue
            at = kept.index(parameter.column)
            value, spread = float(own[at]), refitted[:, at]
            if parameter.also is not None and parameter.also[0] in kept:
                other = kept.index(parameter.also[0])
                value += parameter.also[1] * float(own[other])
                spread = spread + parameter.also[1] * refitted[:, other]
            if name == "torque_gain":
                value, spread = 1.0 / (1.0 + value), 1.0 / np.maximum(1.0 + spread, 0.05)
            else:
                value, spread = value * parameter.scale * scale, spread * parameter.scale * scale
                if parameter.also is None and parameter.scale > 0:
                    bound = effect.lower[min(parameter.column, len(effect.lower) - 1)]
                    lowest = bound * parameter.scale * scale
        else:
            assert parameter.value is not None
            value = parameter.value
            spread = np.full(len(fits.coefficients), value)
            for (own_name, own_joint, theta_name), values in fits.thetas.items():
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
            "ci90": list(fits.interval(spread, value, lowest)),
            "unit": parameter.unit,
        }
    return entries
