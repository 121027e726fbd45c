"""How each effect enters a MuJoCo model.

Native elements need nothing at run time. What MuJoCo has no element for becomes an actuator named
`effect_NAME_JOINT` and a custom text that holds its parameters; `sim.effects.applied` computes the
torque at every step.
"""

import json
from collections.abc import Mapping

import mujoco
import numpy as np

#: Effects that `sim.effects.applied` can compute.
APPLIED = (
    "stribeck_friction",
    "asymmetric_friction",
    "load_dependent_friction",
    "position_dependent_friction",
    "nonlinear_stiffness",
    "end_range_torque",
    "torque_ripple",
    "hysteresis",
    "stretch_reflex",
    "thixotropy",
    "drift",
    "cross_joint_coupling",
)
#: Prefix of the custom texts and actuators of applied torques.
PREFIX = "effect_"


def add_effect(
    spec: mujoco.MjSpec, name: str, joint: str, parameters: Mapping[str, float]
) -> str | None:
    """Add an effect to a joint of `spec`.

    Args:
        spec: the model under construction; changed in place.
        name: an effect of the catalogue.
        joint: the joint's name.
        parameters: the effect's parameters, SI units.

    Returns:
        The element that now carries it, or None if no MuJoCo model can (it is left unchanged).

    Raises:
        ValueError: a parameter is missing or the result is not physical.
    """
    target = spec.joint(joint)
    if target is None:
        raise ValueError(f"the model has no joint {joint!r}")
    if name in APPLIED:
        return _add_applied(spec, name, joint, parameters)
    match name:
        case "coulomb_friction":
            target.frictionloss += parameters["torque"]
            return "joint/@frictionloss"
        case "viscous_friction":
            add_damping(target, parameters["damping"])
            return "joint/@damping"
        case "joint_stiffness":
            k = parameters["stiffness"]
            add_spring(target, k, -parameters["torque_at_zero"] / k if k else 0.0)
            return "joint/@stiffness"
        case "added_inertia":
            if target.armature + parameters["inertia"] < 0:
                raise ValueError("the joint's inertia would be negative")
            target.armature += parameters["inertia"]
            return "joint/@armature"
        case "payload":
            add_point_mass(spec, joint, parameters["mass"], parameters["distance"])
            return "body/@mass"
        case "torque_offset":
            # The motor has to add this torque, so the joint feels its opposite.
            _add_constant(spec, joint, -parameters["torque"])
            return "actuator/general/@biasprm"
        case "position_offset":
            target.ref += parameters["offset"]
            return "joint/@ref"
        case "torque_gain":
            for motor in _motors(spec, joint):
                motor.gainprm[0] *= parameters["gain"]
                motor.biasprm[:3] = np.array(motor.biasprm[:3]) * parameters["gain"]
            return "actuator/general/@gainprm"
        case "actuator_lag" if parameters["time_constant"] > 0:
            for motor in _motors(spec, joint):
                motor.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
                motor.dynprm[0] = parameters["time_constant"]
            return "actuator/general/@dynprm (filter)"
        case "time_delay" if parameters["delay"] > 0:
            for motor in _motors(spec, joint):
                motor.delay = parameters["delay"]
                motor.nsample = int(np.ceil(parameters["delay"] / spec.option.timestep)) + 1
            return "actuator/general/@delay"
    return None


def add_damping(joint: mujoco.MjsJoint, damping: float) -> None:
    """Add to a joint's linear damping, Nm s/rad."""
    polynomial = np.array(joint.damping)
    polynomial[0] += damping
    joint.damping = polynomial


def add_spring(joint: mujoco.MjsJoint, stiffness: float, neutral: float) -> None:
    """Add a linear spring (Nm/rad, rad) to a joint that may have one; two springs make one."""
    polynomial = np.array(joint.stiffness)
    total = polynomial[0] + stiffness
    if abs(total) > 1e-12:
        joint.springref = (polynomial[0] * joint.springref + stiffness * neutral) / total
    polynomial[0] = total
    joint.stiffness = polynomial


def add_point_mass(spec: mujoco.MjSpec, joint: str, mass: float, distance: float) -> None:
    """Add `mass` (kg; negative takes away) on the line from the joint's body to its centre of mass.

    Raises:
        ValueError: what is left would have no mass.
    """
    model = spec.copy().compile()
    number = int(model.jnt_bodyid[model.joint(joint).id])
    body = spec.body(model.body(number).name)
    centre, own = np.array(model.body_ipos[number]), float(model.body_mass[number])
    if own + mass <= 0:
        raise ValueError(f"{body.name} would have a mass of {own + mass:.3g} kg")
    length = float(np.linalg.norm(centre))
    direction = centre / length if length > 1e-9 else np.array([1.0, 0.0, 0.0])
    at = direction * distance
    frame = np.empty(9)
    mujoco.mju_quat2Mat(frame, model.body_iquat[number])
    axes = frame.reshape(3, 3)
    inertia = axes @ np.diag(model.body_inertia[number]) @ axes.T
    joined = (own * centre + mass * at) / (own + mass)
    for part, place in ((own, centre), (mass, at)):
        d = place - joined
        inertia = inertia + part * (d @ d * np.eye(3) - np.outer(d, d))
    moments, principal = np.linalg.eigh(inertia)
    if np.linalg.det(principal) < 0:
        principal[:, 0] *= -1
    orientation = np.empty(4)
    mujoco.mju_mat2Quat(orientation, principal.ravel())
    body.explicitinertial = True
    body.mass, body.ipos = own + mass, joined
    body.iquat, body.inertia = orientation, moments
    body.fullinertia = np.full(6, np.nan)
    for geom in body.geoms:
        geom.mass = 0.0


def _add_constant(spec: mujoco.MjSpec, joint: str, torque: float) -> None:
    actuator = spec.add_actuator(
        name=f"{PREFIX}torque_offset_{joint}", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint
    )
    actuator.gainprm[0] = 0.0
    actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    actuator.biasprm[0] = torque


def _motors(spec: mujoco.MjSpec, joint: str) -> list[mujoco.MjsActuator]:
    """Return the joint's motors; a model without gets one, which is where the effort enters."""
    motors = [
        actuator
        for actuator in spec.actuators
        if actuator.target == joint and not actuator.name.startswith(PREFIX)
    ]
    return motors or [
        spec.add_actuator(name=f"{joint}_motor", trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint)
    ]


def _add_applied(
    spec: mujoco.MjSpec, name: str, joint: str, parameters: Mapping[str, float]
) -> str:
    label = f"{PREFIX}{name}_{joint}"
    spec.add_actuator(name=label, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint)
    content = {"effect": name, "joint": joint, "parameters": dict(parameters)}
    spec.add_text(name=label, data=json.dumps(content).replace('"', "'"))
    return f"applied torque: actuator {label}, custom/text {label}"
