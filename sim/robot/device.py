"""The exoskeleton as data: a chain of links in a file (paper, section 2.2.2).

A device is an MJCF file, and nothing here knows the NESM from another: `docs/use/devices.md` says
what a file needs. Those in the folder `devices` have names; any other is named by its path.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

import mujoco
import numpy as np

from sim.robot.control import Gains
from sim.robot.cuff import Cuff

#: Joints by the number of the human joint they move: abduction, flexion, rotation, elbow.
JOINTS = ("J1", "J2", "J3", "J4")
ELBOW_JOINT = JOINTS[3]
#: How names of joints begin that no motor turns.
PASSIVE = "passive_"
#: Actuators of this group are switched off while the start is locked.
MOTOR_GROUP = 1
#: Devices that have a name.
FOLDER = Path(__file__).parent / "devices"
DEVICES = tuple(sorted(path.stem for path in FOLDER.glob("*.xml")))
#: Sites that say where the cuffs are.
CUFF_SITES = ("upper_arm_cuff", "forearm_cuff")
#: How far a device may be from what its file must be, m and rad.
TOLERANCE = 1e-3
#: Figures read from a compiled file are rounded to so many decimals: its own, without the
#: compiler's noise.
_DECIMALS = 12


@dataclass(frozen=True, kw_only=True)
class Start:
    """Where an assessment begins."""

    #: Angles of the device's joints, rad, in its own order.
    angles: tuple[float, ...]
    #: Human abduction, flexion and rotation that lay the upper arm into its cuff there, rad.
    human_shoulder: tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Device:
    """What a file says of an exoskeleton."""

    #: A name in DEVICES, or the file's path.
    name: str
    path: Path
    #: Its joints, a subset of JOINTS, in the order of the chain.
    joints: tuple[str, ...]
    #: Angle of each of `joints` in the file's own pose, rad.
    zero: tuple[float, ...]
    gains: Gains
    #: Cuffs of upper arm and forearm.
    cuffs: tuple[Cuff, Cuff]
    #: By the name of the target.
    starts: Mapping[str, Start]
    #: Joints that no motor turns and no encoder sees: they begin at 0 and give way.
    passive: tuple[str, ...] = ()

    def __hash__(self) -> int:
        return hash(self.path)

    def start(self, target: str) -> Start:
        """Return where the assessment of `target` begins.

        Raises:
            ValueError: the device has no start for it, so it cannot assess it.
        """
        if target not in self.starts:
            raise ValueError(
                f"the device {self.name} cannot assess {target!r}: its file has keyframes for "
                f"{', '.join(self.starts) or 'nothing'}"
            )
        return self.starts[target]

    def spec(self) -> mujoco.MjSpec:
        """Return its links, joints and motors alone, to be attached."""
        return self._spec.copy()

    @cached_property
    def _spec(self) -> mujoco.MjSpec:
        spec = mujoco.MjSpec.from_file(str(self.path))
        marks = [site for site in spec.sites if site.name in CUFF_SITES]
        for part in (*spec.keys, *spec.numerics, *marks):
            spec.delete(part)
        return spec


@cache
def load_device(name: str) -> Device:
    """Return the device called `name`, or in the file of that path.

    Raises:
        ValueError: there is none, or the file says too little or what cannot be.
    """
    path = FOLDER / f"{name}.xml" if name in DEVICES else Path(name)
    if not path.is_file():
        raise ValueError(
            f"unknown device {name!r}: expected one of {', '.join(DEVICES)} or an MJCF file"
        )
    try:
        model = mujoco.MjSpec.from_file(str(path)).compile()
    except ValueError as error:
        raise ValueError(f"the device {name} is not an MJCF model: {error}") from None
    try:
        return _read(name, path.resolve(), model)
    except _WrongFileError as error:
        raise ValueError(f"the device {name}: {error}") from None


class _WrongFileError(Exception):
    """What a file lacks, as the end of a sentence."""


def _read(name: str, path: Path, model: mujoco.MjModel) -> Device:
    names = [model.joint(i).name for i in range(model.njnt)]
    joints = tuple(name for name in names if name in JOINTS)
    passive = tuple(name for name in names if name.startswith(PASSIVE))
    if ELBOW_JOINT not in joints or len(joints) + len(passive) < len(names):
        raise _WrongFileError(
            f"its joints must be {ELBOW_JOINT} (the elbow) and any of {', '.join(JOINTS[:3])}, "
            f"and passive ones {PASSIVE}..., not {', '.join(names) or 'none'}"
        )
    motors = {model.actuator(i).name for i in range(model.nu)}
    if motors != {f"{joint}_motor" for joint in joints}:
        raise _WrongFileError(
            f"its actuators must be {', '.join(f'{joint}_motor' for joint in joints)}, "
            f"not {', '.join(sorted(motors)) or 'none'}"
        )
    hinge, slide = mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE
    for i, joint in enumerate(names):
        kind = model.jnt_type[i]
        if not model.jnt_limited[i] or (kind != hinge and (kind != slide or joint in joints)):
            raise _WrongFileError("every joint must be a hinge with a range, or a passive slide")
    if model.neq or model.ntendon or model.nsensor:
        raise _WrongFileError("it may have no equality constraints, tendons or sensors")
    numerics = {model.numeric(i).name: model.numeric(i).data for i in range(model.nnumeric)}
    if len(numerics.get("gains", ())) != 3 or not (numerics["gains"] >= 0.0).all():
        raise _WrongFileError('it needs <numeric name="gains" data="kp kv ki"/>, none negative')
    keys = {model.key(i).name: model.key(i).qpos for i in range(model.nkey)}
    if "elbow" not in keys:
        raise _WrongFileError('it needs a keyframe "elbow" with the joint angles at the start')
    idle = [names.index(name) for name in passive]
    if any(pose[idle].any() for pose in (model.qpos0, *keys.values())):
        raise _WrongFileError("its passive joints must stand at 0, also in keyframes")
    sites = {model.site(i).name for i in range(model.nsite)}
    for site in CUFF_SITES:
        if site not in sites:
            raise _WrongFileError(f'it needs a site "{site}" on the link that carries that cuff')
        if model.site(site).type[0] != mujoco.mjtGeom.mjGEOM_CYLINDER:
            raise _WrongFileError(f'the site "{site}" must be a cylinder as large as the cuff')
    kp, kv, ki = numerics["gains"]
    return Device(
        name=name,
        path=path,
        joints=joints,
        zero=tuple(float(angle) for angle in model.qpos0[[names.index(j) for j in joints]]),
        gains=Gains(kp=float(kp), kv=float(kv), ki=float(ki)),
        cuffs=_read_cuffs(model, keys["elbow"]),
        starts={target: _start(model, joints, angles) for target, angles in keys.items()},
        passive=passive,
    )


def _read_cuffs(model: mujoco.MjModel, start: np.ndarray) -> tuple[Cuff, Cuff]:
    """Return both cuffs, placed along limbs that are straight while the elbow is."""
    straight = start.copy()
    straight[model.joint(ELBOW_JOINT).qposadr] = 0.0
    data = _posed(model, straight)
    limb = _limb_axes(data)
    forearm = _site_axes(data, CUFF_SITES[1])
    axis, anchor = data.joint(ELBOW_JOINT).xaxis, data.joint(ELBOW_JOINT).xanchor
    if np.abs(forearm - limb).max() > TOLERANCE:
        raise _WrongFileError(
            f"with {ELBOW_JOINT} at 0 both cuffs must point the same way: z along the straight "
            "arm, x out of the opening"
        )
    if np.abs(axis + limb[:, 1]).max() > TOLERANCE:
        raise _WrongFileError(
            f"{ELBOW_JOINT} must flex the elbow when it grows, and the cuffs must open medially: "
            "its axis is the opposite of the way out of the cuffs"
        )
    elbow = limb.T @ anchor
    shoulder_to_cuff = limb.T @ data.site(CUFF_SITES[0]).xpos
    inside = float(model.site(CUFF_SITES[0]).size[0])
    if abs(shoulder_to_cuff[2]) > TOLERANCE or abs(shoulder_to_cuff[1]) >= inside:
        raise _WrongFileError(
            "the axis of the upper arm's cuff must pass through the human shoulder, the origin, "
            "or beside it on the opening's line by less than the cuff's radius"
        )
    elbow_to_cuff = limb.T @ (data.site(CUFF_SITES[1]).xpos - anchor)
    return (
        _cuff(model, "upper_arm", (0.0, 0.0), shoulder_to_cuff),
        _cuff(
            model, "forearm", (float(elbow[0].round(_DECIMALS)), _exact(elbow)[2]), elbow_to_cuff
        ),
    )


def _cuff(model: mujoco.MjModel, name: str, joint: tuple[float, float], place: np.ndarray) -> Cuff:
    site = model.site(f"{name}_cuff")
    frame = np.empty(9)
    mujoco.mju_quat2Mat(frame, site.quat)
    axes = frame.reshape(3, 3)
    return Cuff(
        name=name,
        link=model.body(model.site_bodyid[site.id]).name,
        centre=_exact(site.pos),
        along=_exact(axes[:, 2]),
        opening=_exact(axes[:, 0]),
        length=2.0 * float(site.size[1]),
        radius=float(site.size[0]),
        limb_joint=joint,
        limb_place=_exact(place),
    )


def _start(model: mujoco.MjModel, joints: tuple[str, ...], angles: np.ndarray) -> Start:
    """Return a start; the human joints turn about left, up and the arm's own axis in turn."""
    flexion, abduction, rotation = _exact(_turns(_limb_axes(_posed(model, angles))))
    return Start(
        angles=tuple(float(angles[model.joint(joint).qposadr[0]]) for joint in joints),
        human_shoulder=(abduction, flexion - np.pi / 2, rotation),
    )


def _turns(axes: np.ndarray) -> np.ndarray:
    """Return the angles (rad) of turns about y, the new z and the new x that make these axes."""
    across = np.hypot(axes[0, 0], axes[2, 0])
    if across < 1e-7:
        # The first and the last turn are about one axis: all of them is the first.
        first, last = np.arctan2(axes[0, 2], axes[2, 2]), 0.0
    else:
        first, last = np.arctan2(-axes[2, 0], axes[0, 0]), np.arctan2(-axes[1, 2], axes[1, 1])
    return np.array([first, np.arctan2(axes[1, 0], across), last])


def _posed(model: mujoco.MjModel, angles: np.ndarray) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:] = angles
    mujoco.mj_kinematics(model, data)
    return data


def _site_axes(data: mujoco.MjData, site: str) -> np.ndarray:
    """Return along the limb, out of the opening, towards the upper wall as columns, (3, 3)."""
    axes: np.ndarray = data.site(site).xmat.reshape(3, 3)[:, [2, 0, 1]]
    return axes


def _limb_axes(data: mujoco.MjData) -> np.ndarray:
    return _site_axes(data, CUFF_SITES[0])


def _exact(values: np.ndarray) -> tuple[float, float, float]:
    # Adding zero takes the sign off a zero.
    x, y, z = np.round(values, _DECIMALS) + 0.0
    return float(x), float(y), float(z)


NESM = load_device("nesm")


def add_exoskeleton(
    spec: mujoco.MjSpec,
    gains: Gains,
    *,
    friction: float = 0.0,
    joint: str = ELBOW_JOINT,
    device: Device = NESM,
) -> None:
    """Add the chain with a controller in the engine on every joint.

    The derivative gain is implicit in the integrator, hence stable at every step.

    Args:
        spec: the model under construction.
        gains: of every motor.
        friction: Coulomb friction of `joint`, Nm, which the nominal model never knows.
        joint: the joint that has it.
        device: the exoskeleton.
    """
    prefix = "device/"
    spec.attach(device.spec(), prefix=prefix, frame=spec.worldbody.add_frame())
    # MuJoCo wants a prefix, but a file's names are those we ask for.
    for part in (*spec.bodies, *spec.joints, *spec.geoms, *spec.actuators):
        if part.name.startswith(prefix):
            part.name = part.name.removeprefix(prefix)
    for motor in spec.actuators:
        motor.target = motor.target.removeprefix(prefix)
    spec.joint(joint).frictionloss += friction
    for name in device.joints:
        motor = spec.actuator(f"{name}_motor")
        motor.group = MOTOR_GROUP
        motor.set_to_pid(kp=gains.kp, kv=gains.kv, ki=gains.ki)
