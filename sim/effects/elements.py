"""Elements of a MuJoCo model that effects need.

What MuJoCo has no element for becomes an actuator named `effect_NAME_JOINT` and a custom text that
holds its parameters; `sim.effects.applied` computes the torque at every step.
"""

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from sim.effects.parameter import Values

if TYPE_CHECKING:
    import mujoco

#: Prefix of the custom texts and actuators of applied torques.
PREFIX = "effect_"
#: Share of a principal moment by which two others may fall short of it: rounding.
ROUNDING = 1e-9


def joint_of(spec: "mujoco.MjSpec", joint: str) -> "mujoco.MjsJoint":
    """Return a joint by its name.

    Raises:
        ValueError: there is none.
    """
    found = spec.joint(joint)
    if found is None:
        raise ValueError(f"the model has no joint {joint!r}")
    return found


def add_applied(spec: "mujoco.MjSpec", name: str, joint: str, parameters: Values) -> str:
    """Add the actuator and the text of an effect whose torque is computed at every step."""
    label = f"{PREFIX}{name}_{joint}"
    _add_motor(spec, label, joint)
    content = {"effect": name, "joint": joint, "parameters": dict(parameters)}
    spec.add_text(name=label, data=json.dumps(content).replace('"', "'"))
    return f"applied torque: actuator {label}, custom/text {label}"


def add_constant(spec: "mujoco.MjSpec", name: str, joint: str, torque: float) -> None:
    """Add a constant torque that the joint feels."""
    import mujoco

    actuator = _add_motor(spec, f"{PREFIX}{name}_{joint}", joint)
    actuator.gainprm[0] = 0.0
    actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    actuator.biasprm[0] = torque


def without_applied(spec: "mujoco.MjSpec") -> list[tuple[str, str]]:
    """Take out what `add_applied` and `add_constant` added; return names of effects and joints."""
    found = []
    for actuator in [*spec.actuators]:
        if actuator.name.startswith(PREFIX):
            joint = str(actuator.target)
            found.append((actuator.name.removeprefix(PREFIX).removesuffix(f"_{joint}"), joint))
            spec.delete(actuator)
    for text in [*spec.texts]:
        if text.name.startswith(PREFIX):
            spec.delete(text)
    return found


def add_filter(spec: "mujoco.MjSpec", joint: str, time_constant: float) -> None:
    """Let the joint's motors lag behind their controls."""
    import mujoco

    for motor in motors_of(spec, joint):
        motor.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
        motor.dynprm[0] = time_constant


def add_delay(spec: "mujoco.MjSpec", joint: str, delay: float) -> str:
    """Let the joint's motors act a fixed time late; return the element."""
    for motor in motors_of(spec, joint):
        motor.delay = delay
        motor.nsample = int(np.ceil(delay / spec.option.timestep)) + 1
    return "actuator/general/@delay"


def motors_of(spec: "mujoco.MjSpec", joint: str) -> "list[mujoco.MjsActuator]":
    """Return the joint's motors; a model without gets one, which is where the effort enters."""
    motors = [
        actuator
        for actuator in spec.actuators
        if actuator.target == joint and not actuator.name.startswith(PREFIX)
    ]
    return motors or [_add_motor(spec, f"{joint}_motor", joint)]


def _add_motor(spec: "mujoco.MjSpec", name: str, joint: str) -> "mujoco.MjsActuator":
    import mujoco

    joint_of(spec, joint)
    return spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=joint)


def add_damping(joint: "mujoco.MjsJoint", damping: float) -> None:
    """Add to a joint's linear damping, Nm s/rad."""
    polynomial = np.array(joint.damping)
    polynomial[0] += damping
    joint.damping = polynomial


def add_spring(joint: "mujoco.MjsJoint", stiffness: float, neutral: float) -> None:
    """Add a linear spring (Nm/rad, rad) to a joint that may have one; two springs make one."""
    polynomial = np.array(joint.stiffness)
    total = polynomial[0] + stiffness
    if abs(total) > 1e-12:
        joint.springref = (polynomial[0] * joint.springref + stiffness * neutral) / total
    polynomial[0] = total
    joint.stiffness = polynomial


def line_and_across(spec: "mujoco.MjSpec", joint: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the way to the centre of mass of what a joint moves, and that across it.

    Args:
        spec: a model.
        joint: its name.

    Returns:
        Two unit vectors in the body's frame, (3,) each; the second is the way the joint turns.
    """
    model = spec.copy().compile()
    number = model.joint(joint).id
    centre = np.array(model.body_ipos[model.jnt_bodyid[number]])
    length = float(np.linalg.norm(centre))
    line = centre / length if length > 1e-9 else np.array([1.0, 0.0, 0.0])
    return line, across(np.array(model.jnt_axis[number]), line)


def across(axis: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Return the way that an axis turns what is along `way`, a unit vector; zero if none, (3,)."""
    turned = np.cross(axis, way)
    return np.asarray(turned / max(float(np.linalg.norm(turned)), 1e-12))


def add_point_mass(
    spec: "mujoco.MjSpec",
    joint: str,
    mass: float,
    place: Sequence[float] | np.ndarray,
    own_inertia: float = 0.0,
) -> None:
    """Add `mass` (kg; negative takes away) to the body that a joint moves.

    Args:
        spec: changed in place.
        joint: its name.
        mass: kg.
        place: where in the body's frame, m.
        own_inertia: of the mass about every axis through its centre, kg m2.

    Raises:
        ValueError: no body can have the mass or the inertia that would be left.
    """
    import mujoco

    model = spec.copy().compile()
    number = int(model.jnt_bodyid[model.joint(joint).id])
    body = spec.body(model.body(number).name)
    centre, own = np.array(model.body_ipos[number]), float(model.body_mass[number])
    if own + mass <= 0:
        raise ValueError(f"{body.name} would have a mass of {own + mass:.3g} kg")
    at = np.array(place)
    frame = np.empty(9)
    mujoco.mju_quat2Mat(frame, model.body_iquat[number])
    axes = frame.reshape(3, 3)
    inertia = axes @ np.diag(model.body_inertia[number]) @ axes.T + own_inertia * np.eye(3)
    joined = (own * centre + mass * at) / (own + mass)
    for part, there in ((own, centre), (mass, at)):
        d = there - joined
        inertia = inertia + part * (d @ d * np.eye(3) - np.outer(d, d))
    if mass < 0:
        least, middle, most = np.linalg.eigvalsh(inertia)
        # A rod's are equal but for rounding.
        if min(least, least + middle - most) < -ROUNDING * most:
            raise ValueError(
                f"without {-mass:.3g} kg there, {body.name} would have an inertia that no body "
                "has; check its declared mass and inertia, and the unit of the effort"
            )
    _set_body(spec, body.name, own + mass, joined, inertia)


def set_inertia(
    spec: "mujoco.MjSpec",
    body: str,
    mass: float,
    first_moments: Sequence[float],
    inertia: Mapping[str, float],
) -> None:
    """Give a body other inertial parameters.

    Args:
        spec: changed in place.
        body: its name.
        mass: kg.
        first_moments: mass times centre of mass, kg m, (3,).
        inertia: xx, yy, zz, xy, xz and yz about the origin of its frame, kg m2.
    """
    centre = np.array(first_moments) / mass
    xx, yy, zz, xy, xz, yz = (inertia[name] for name in ("xx", "yy", "zz", "xy", "xz", "yz"))
    about_origin = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    shift = mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    _set_body(spec, body, mass, centre, about_origin - shift)


def _set_body(
    spec: "mujoco.MjSpec", name: str, mass: float, centre: np.ndarray, inertia: np.ndarray
) -> None:
    """Set mass, centre of mass and the inertia about it in place of what a body's geoms have."""
    import mujoco

    body = spec.body(name)
    moments, principal = np.linalg.eigh(inertia)
    if np.linalg.det(principal) < 0:
        principal[:, 0] *= -1
    orientation = np.empty(4)
    mujoco.mju_mat2Quat(orientation, principal.ravel())
    body.explicitinertial = True
    body.mass, body.ipos = mass, centre
    body.iquat, body.inertia = orientation, moments
    body.fullinertia = np.full(6, np.nan)
    for geom in body.geoms:
        geom.mass = 0.0
