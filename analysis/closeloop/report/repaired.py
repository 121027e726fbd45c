"""The repaired model: the declared one with its fitted unknowns and the effects that were found."""

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco

from analysis.closeloop.contract import Verdict
from analysis.closeloop.session.device import Device
from models.mjcf.compiling import compiled, written
from sim.effects.catalogue import BY_NAME, LINK_INERTIA, VISCOELASTIC
from sim.effects.elements import set_inertia
from sim.effects.laws.inertia import TurnedGravity
from sim.effects.laws.loose_link import DAMPED

COULOMB = "coulomb_friction"
ALL = "these trials do not determine all its parameters"


def repaired_model(device: Device, report: Mapping[str, Any]) -> tuple[str, list[str], list[str]]:
    """Return the repaired model as XML, the element of every effect, and warnings.

    Args:
        device: the declared model.
        report: impedances, declared values and effects.
    """
    spec = device.spec.copy()
    warnings: list[str] = []
    for declared in report["declared"]:
        # A payload hangs there in some trials only: it is no part of the model.
        if "joint" not in declared:
            continue
        if values := {name: entry["value"] for name, entry in declared["parameters"].items()}:
            spec, _, lacking = _with_effect(spec, declared["effect"], declared["joint"], values)
            warnings += lacking
    found = report["effects"] if report["verdict"] == Verdict.EFFECT_FOUND else []
    for name, impedance in report["impedance"].items():
        values = {key: entry["after"] or 0.0 for key, entry in impedance.items()}
        values["damping"] /= _behind(found, name)
        VISCOELASTIC.add(spec, name, values)
        if values["stiffness"] < 0 or values["damping"] < 0:
            warnings.append(
                f"model_after.xml: the fitted impedance of {name} is not passive (it gives energy)"
            )
    elements = []
    for effect in found:
        if effect["name"] == LINK_INERTIA:
            for name, link in report["links"].items():
                set_inertia(spec, name, link["mass"], link["first_moments"], link["inertia"])
            elements.append("body/inertial")
            continue
        values = {name: entry["value"] for name, entry in effect["parameters"].items()}
        name = effect["name"]
        # An effect that was fitted beside others makes up the error with them, known or not.
        unknown = [key for key, value in values.items() if value is None]
        values |= {key: effect["parameters"][key].get("fitted") for key in unknown}
        if effect.get("mujoco_element") == TurnedGravity.element:
            # Of the base, and of no joint.
            elements.append(TurnedGravity().add(spec, effect["joint"], values))
            continue
        where = f"{name} of {effect['joint']}: {ALL}"
        if unknown and None not in values.values():
            warnings.append(f"model_after.xml has the fitted values of {where}")
        elif unknown:
            if COULOMB not in BY_NAME[name].includes or values.get("torque") is None:
                elements.append("none: not every parameter is determined")
                warnings.append(f"model_after.xml lacks {where}")
                continue
            warnings.append(f"model_after.xml has {COULOMB} instead of {where}")
            name, values = COULOMB, {"torque": values["torque"]}
        spec, element, lacking = _with_effect(spec, name, effect["joint"], values)
        elements.append(element or "none: described in the report only")
        warnings += lacking
    compiled(spec)
    return written(spec), elements, warnings


def _behind(effects: Sequence[Mapping[str, Any]], joint: str) -> float:
    """Return the share of a joint's damping that is the limb's: the rest is its motor's friction.

    The model has no spring between the two.
    """
    shares = [
        e["parameters"][DAMPED]
        for e in effects
        if e["joint"] == joint and DAMPED in e["parameters"]
    ]
    return next((entry["value"] or entry.get("fitted") or 1.0 for entry in shares), 1.0)


def _with_effect(
    spec: mujoco.MjSpec, name: str, joint: str, values: Mapping[str, float]
) -> tuple[mujoco.MjSpec, str | None, list[str]]:
    """Return `spec` with an effect, its element, and warnings; as it was if MuJoCo cannot have it.

    A coefficient that a declared effect took over is nothing of this effect's own.
    """
    effect, trial = BY_NAME[name], spec.copy()
    try:
        element = effect.add(trial, joint, {**dict.fromkeys(effect.coefficients, 0.0), **values})
    except ValueError as error:
        return spec, None, [f"model_after.xml lacks {name} of {joint}: {error}"]
    if element is None:
        why = "MuJoCo has no element for it"
        return spec, None, [f"model_after.xml lacks {name} of {joint}: {why}"]
    try:
        compiled(trial)
    except ValueError:
        why = "it makes a body or joint that cannot exist; check the declared model and the data"
        return spec, None, [f"model_after.xml lacks {name} of {joint}: {why}"]
    return trial, element, []
