"""The repaired model: the declared one with its fitted unknowns and the effects that were found."""

from collections.abc import Mapping
from typing import Any

import mujoco

from analysis.closeloop.session.device import Device
from sim.effects.elements import add_damping, add_effect, add_spring


def repaired_model(device: Device, report: Mapping[str, Any]) -> tuple[str, list[str], list[str]]:
    """Return the repaired model as XML, the element of every effect, and warnings.

    Args:
        device: the declared model.
        report: impedances and effects.
    """
    spec = device.spec.copy()
    warnings: list[str] = []
    for name, impedance in report["impedance"].items():
        joint = spec.joint(name)
        stiffness, neutral = impedance["stiffness"]["after"], impedance["neutral_angle"]["after"]
        add_spring(joint, stiffness, neutral or 0.0)
        add_damping(joint, impedance["damping"]["after"])
        if stiffness < 0 or impedance["damping"]["after"] < 0:
            warnings.append(f"model_after.xml: the fitted impedance of {name} is not passive")
    elements = []
    for effect in report["effects"] if report["verdict"] == "effect_found" else []:
        values = {name: entry["value"] for name, entry in effect["parameters"].items()}
        trial = spec.copy()
        try:
            element = add_effect(trial, effect["name"], effect["joint"], values)
            trial.compile()
        except ValueError as error:
            element = None
            warnings.append(f"model_after.xml lacks {effect['name']}: {error}")
        if element is None:
            elements.append("none: described in the report only")
            warnings.append(
                f"model_after.xml lacks {effect['name']} of {effect['joint']}: "
                "MuJoCo has no element for it"
            )
            continue
        spec = trial
        elements.append(element)
    spec.compile()
    return spec.to_xml(), elements, warnings


def runs(xml: str, seconds: float = 0.1) -> bool:
    """Whether a model can be stepped without a warning of the engine."""
    from sim.effects.applied import AppliedEffects

    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    effects = AppliedEffects(model)
    for _ in range(max(1, int(seconds / model.opt.timestep))):
        effects.apply(data)
        mujoco.mj_step(model, data)
    return not any(warning.number for warning in data.warning)
