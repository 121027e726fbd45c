"""The repaired model: the declared one with its fitted unknowns and the effects that were found."""

from collections.abc import Mapping
from typing import Any

from analysis.closeloop.contract import Verdict
from analysis.closeloop.session.device import Device
from sim.effects.catalogue import BY_NAME, VISCOELASTIC


def repaired_model(device: Device, report: Mapping[str, Any]) -> tuple[str, list[str], list[str]]:
    """Return the repaired model as XML, the element of every effect, and warnings.

    Args:
        device: the declared model.
        report: impedances and effects.
    """
    spec = device.spec.copy()
    warnings: list[str] = []
    for name, impedance in report["impedance"].items():
        values = {key: entry["after"] or 0.0 for key, entry in impedance.items()}
        VISCOELASTIC.add(spec, name, values)
        if values["stiffness"] < 0 or values["damping"] < 0:
            warnings.append(f"model_after.xml: the fitted impedance of {name} is not passive")
    elements = []
    for effect in report["effects"] if report["verdict"] == Verdict.EFFECT_FOUND else []:
        values = {name: entry["value"] for name, entry in effect["parameters"].items()}
        trial = spec.copy()
        try:
            element = BY_NAME[effect["name"]].add(trial, effect["joint"], values)
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
