"""The declared chain of a session: joints, bodies, and the torques that a motion of it needs."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import mujoco
import numpy as np

from models.mjcf.compiling import compiled

# A declared model may draw a warning, which MuJoCo would append to a file in the working directory.
mujoco.set_mju_user_warning(lambda message: None)


#: A hinge of a limb, or one with a declared range, that goes further is recorded in degrees.
MAX_HINGE = 2 * np.pi
#: How far beyond the last link a load may hang, m.
GRIP = 0.15


class Load(Protocol):
    """Something that a chain can carry."""

    def hang(self, spec: mujoco.MjSpec) -> None:
        """Add the load to `spec`."""


@dataclass(frozen=True)
class Device:
    """The declared chain; positions, velocities and accelerations have shape (n, nv)."""

    spec: mujoco.MjSpec
    ignored_joints: tuple[str, ...]
    #: Effects and their joints that an earlier session wrote into the model, and that it left out.
    unread_effects: tuple[tuple[str, str], ...] = ()
    #: What of its file is taken otherwise than it stands there, in sentences.
    remarks: tuple[str, ...] = ()

    @cached_property
    def model(self) -> mujoco.MjModel:
        return compiled(self.spec)

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

    def body(self, joint: int) -> int:
        """Return the number of the body that a joint moves."""
        return int(self.model.jnt_bodyid[joint])

    def is_last(self, joint: str) -> bool:
        """Whether no other joint is behind a joint."""
        behind = {int(self.model.joint(joint).bodyid[0])}
        for body in range(min(behind) + 1, self.model.nbody):
            if int(self.model.body_parentid[body]) in behind:
                behind.add(body)
        own = self.model.joint(joint).id
        return not any(int(b) in behind for j, b in enumerate(self.model.jnt_bodyid) if j != own)

    def centre_of_mass(self, joint: int) -> np.ndarray | None:
        """Return that of a joint's body in its frame, m, (3,); None if it lies on the axis."""
        body = self.body(joint)
        centre = np.array(self.model.body_ipos[body])
        if self.model.body_mass[body] <= 0.0 or np.linalg.norm(centre) < 1e-3:
            geoms = np.flatnonzero(self.model.geom_bodyid == body)
            if len(geoms) == 0:
                return None
            centre = np.array(self.model.geom_pos[geoms[0]])
        return centre if np.linalg.norm(centre) >= 1e-3 else None

    def axis(self, joint: int) -> np.ndarray:
        """Return a joint's axis in the frame of its body, a unit vector, (3,)."""
        return np.array(self.model.jnt_axis[joint])

    def reach(self, joint: int) -> float:
        """Return how far from a joint its device, with what hangs on it, can be, m.

        The longest way along the links to a centre of mass, and as far again beyond it, or to the
        far side of a geom; a tool or a hand holds `GRIP` beyond that.
        """
        model, first = self.model, int(self.model.jnt_bodyid[joint])
        far, away = 0.0, {first: 0.0}
        for body in range(first, model.nbody):
            parent = int(model.body_parentid[body])
            if body not in away and parent in away:
                away[body] = away[parent] + float(np.linalg.norm(model.body_pos[body]))
            if body in away:
                far = max(far, away[body] + 2.0 * float(np.linalg.norm(model.body_ipos[body])))
        for geom, body in enumerate(model.geom_bodyid):
            if int(body) in away:
                ends = float(np.linalg.norm(model.geom_pos[geom])) + float(model.geom_rbound[geom])
                far = max(far, away[int(body)] + ends)
        return far + GRIP

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
        masses: Sequence[Load] = (),
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
            mass.hang(spec)
        spec.option.disableflags |= (
            mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_CONTACT
        )
        model = compiled(spec)
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
