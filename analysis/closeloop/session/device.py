"""The declared model of a session: an open chain in MuJoCo, and what inverse dynamics it has."""

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np

from analysis.closeloop.errors import SessionError
from analysis.closeloop.session.reading import NOMINAL, SESSION_FILE, AddedMass, Session, inside
from sim.assessment.nominal import nominal_spec

# A declared model may draw a warning, which MuJoCo would append to a file in the working directory.
mujoco.set_mju_user_warning(lambda message: None)

MAX_MODEL_BYTES = 5_000_000
#: Deepest nesting of elements, and how many bodies: beyond, no arm and no robot is meant.
MAX_DEPTH, MAX_BODIES = 100, 200
#: Elements and attributes of an MJCF file that reach outside it or break an open chain.
REFUSED_ELEMENTS = {
    "include": "an included file",
    "plugin": "a plugin",
    "extension": "a plugin",
    "freejoint": "a free joint",
    "attach": "an attached model",
    "model": "an attached model",
    "equality": "an equality constraint, which closes the chain",
    "replicate": "a generator of bodies",
    "composite": "a generator of bodies",
    "flexcomp": "a generator of bodies",
    "flex": "a deformable body",
}


@dataclass(frozen=True)
class Device:
    """The declared chain; positions, velocities and accelerations have shape (n, nv)."""

    spec: mujoco.MjSpec
    file: str
    ignored_joints: tuple[str, ...]

    @cached_property
    def model(self) -> mujoco.MjModel:
        return _compiled(self.spec, self.file)

    @cached_property
    def joints(self) -> tuple[str, ...]:
        return tuple(self.model.joint(i).name for i in range(self.model.njnt))

    @cached_property
    def recorded_joints(self) -> tuple[str, ...]:
        """Joints whose position every trial records."""
        return tuple(joint for joint in self.joints if joint not in self.ignored_joints)

    @cached_property
    def bodies(self) -> tuple[str, ...]:
        return tuple(self.model.body(i).name for i in range(self.model.nbody))

    def dof(self, joint: str) -> int:
        return int(self.model.joint(joint).dofadr[0])

    def is_hinge(self, joint: str) -> bool:
        return bool(self.model.joint(joint).type[0] == mujoco.mjtJoint.mjJNT_HINGE)

    def unit(self, joint: str) -> str:
        """Unit of the joint's effort."""
        return "Nm" if self.is_hinge(joint) else "N"

    def angle_unit(self, joint: str) -> str:
        return "rad" if self.is_hinge(joint) else "m"

    def range(self, joint: str) -> tuple[float, float]:
        """Declared range, rad or m; (0, 0) if unlimited."""
        number = self.model.joint(joint).id
        if not self.model.jnt_limited[number]:
            return 0.0, 0.0
        low, high = self.model.jnt_range[number]
        return float(low), float(high)

    @cached_property
    def friction(self) -> np.ndarray:
        """Declared Coulomb friction of every degree of freedom, Nm or N, shape (nv,)."""
        return np.array(self.model.dof_frictionloss)

    @cached_property
    def reference(self) -> np.ndarray:
        """Where a joint stands that nobody recorded, shape (nv,)."""
        return np.array(self.model.qpos0)

    def inverse_dynamics(
        self,
        position: np.ndarray,
        velocity: np.ndarray,
        acceleration: np.ndarray,
        *,
        masses: tuple[AddedMass, ...] = (),
    ) -> np.ndarray:
        """Return the joint torques that the declared chain needs, shape (n, nv).

        Inertia, gravity, dampers, springs and armature by MuJoCo. Coulomb friction is left out: as
        a constraint of MuJoCo it depends on the solver's softness; `friction` goes with the sign
        of a smoothed velocity instead.

        Args:
            position: rad or m, shape (n, nv).
            velocity: shape (n, nv).
            acceleration: shape (n, nv).
            masses: known point masses to carry beside the declared ones.
        """
        spec = self.spec.copy()
        for mass in masses:
            carry(spec, mass)
        spec.option.disableflags |= (
            mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_CONTACT
        )
        model = _compiled(spec, self.file)
        data = mujoco.MjData(model)
        torque = np.empty_like(position)
        qpos, qvel, qacc, out = data.qpos, data.qvel, data.qacc, data.qfrc_inverse
        moving = bool(velocity.any() or acceleration.any())
        qvel[:] = qacc[:] = 0.0
        for i, place in enumerate(position):
            qpos[:] = place
            if moving:
                qvel[:] = velocity[i]
                qacc[:] = acceleration[i]
            mujoco.mj_inverse(model, data)
            torque[i] = out
        return torque


def carry(spec: mujoco.MjSpec, mass: AddedMass) -> None:
    """Hang a point mass on a body of `spec`."""
    body = spec.body(mass.body).add_body(pos=list(mass.position))
    body.explicitinertial = True
    body.mass = mass.mass
    # Without it MuJoCo takes the body's own position for its centre of mass, and doubles the lever.
    body.ipos = [0.0, 0.0, 0.0]
    # MuJoCo wants a positive inertia; this one is a sphere of a millimetre.
    body.inertia = [max(1e-12, 4e-7 * mass.mass)] * 3


def load_device(session: Session) -> Device:
    """Load the session's model and check every name in `session.json` against it.

    Raises:
        SessionError: the model cannot be used, or a name is not in it.
    """
    if session.model == NOMINAL:
        spec = nominal_spec(height_m=session.height_m, mass_kg=session.mass_kg)
    else:
        spec = _read_mjcf(inside(session.folder, session.model, field_name="model"), session.model)
    device = Device(spec=spec, file=session.model, ignored_joints=session.ignored_joints)
    kinds = {mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE}
    for joint in range(device.model.njnt):
        if mujoco.mjtJoint(device.model.jnt_type[joint]) not in kinds:
            raise SessionError("may have hinge and slide joints only", file=session.model)
    if not device.joints or not all(device.joints):
        raise SessionError("must have joints, each with a name", file=session.model)
    for name in session.ignored_joints:
        _known(name, device.joints, "ignored_joints")
    for number, declared in enumerate(session.declared):
        _known(declared.joint, device.recorded_joints, f"declared_effects[{number}].joint")
    for number, trial in enumerate(session.trials):
        if trial.added_mass is not None:
            _known(trial.added_mass.body, device.bodies, f"trials[{number}].added_mass.body")
    if not device.recorded_joints:
        raise SessionError("ignored_joints leaves no joint to analyse", file=SESSION_FILE)
    return device


def _known(name: str, names: tuple[str, ...], where: str) -> None:
    if name not in names:
        raise SessionError(
            f"{where} {name!r} is unknown; the model has {', '.join(n for n in names if n)}",
            file=SESSION_FILE,
        )


def _read_mjcf(path: Path, name: str) -> mujoco.MjSpec:
    if path.stat().st_size > MAX_MODEL_BYTES:
        raise SessionError(f"is larger than {MAX_MODEL_BYTES // 1_000_000} MB", file=name)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise SessionError("is not UTF-8 text", file=name) from None
    except OSError as error:
        raise SessionError(f"cannot be read: {error.strerror}", file=name) from None
    # Entities could unfold without end, and only a document type can define them.
    if re.search(r"<!(DOCTYPE|ENTITY)", text, re.IGNORECASE):
        raise SessionError("may not define a document type or entities", file=name)
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise SessionError(f"is not XML: {error}", file=name, line=error.position[0]) from None
    if root.tag != "mujoco":
        raise SessionError(f"must be an MJCF file (<mujoco>), not <{root.tag}>", file=name)
    _check_size(root, name)
    for element in root.iter():
        if element.tag in REFUSED_ELEMENTS:
            raise SessionError(
                f"<{element.tag}> is {REFUSED_ELEMENTS[element.tag]}; "
                "a session's model is one open chain in one file",
                file=name,
            )
        if any(key.startswith("file") for key in element.attrib):
            raise SessionError(
                f"<{element.tag}> needs an external file; draw with primitive geoms", file=name
            )
    try:
        return mujoco.MjSpec.from_string(text)
    except ValueError as error:
        raise SessionError(
            f"MuJoCo refuses it: {' '.join(str(error).split())}", file=name
        ) from None


def _check_size(root: ElementTree.Element, name: str) -> None:
    """Refuse what MuJoCo would take very long for, or nest itself to death."""
    level, depth = [root], 0
    while level:
        depth += 1
        if depth > MAX_DEPTH:
            raise SessionError(f"nests elements more than {MAX_DEPTH} deep", file=name)
        level = [child for element in level for child in element]
    count = sum(1 for _ in root.iter("body"))
    if count > MAX_BODIES:
        raise SessionError(f"has {count} bodies; at most {MAX_BODIES}", file=name)


def _compiled(spec: mujoco.MjSpec, name: str) -> mujoco.MjModel:
    try:
        return spec.compile()
    except ValueError as error:
        raise SessionError(
            f"MuJoCo refuses it: {' '.join(str(error).split())}", file=name
        ) from None
