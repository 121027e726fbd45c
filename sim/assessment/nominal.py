"""The nominal model of equations 4 to 6 and 20: a rigid arm perfectly aligned with the exoskeleton.

It is what a clinic knows: the reference wearer's lengths and masses, the device's inertias, dampers
and motors. The arm's segments ride rigidly on the links that carry their cuffs, so q = theta.
"""

from dataclasses import dataclass, replace
from functools import cache, cached_property

import mujoco
import numpy as np

from sim.assessment.chain import RigidChain, rigid_chain
from sim.body.skeleton import HUMAN_JOINTS, add_arm, empty_spec, fill_forearm, fill_upper_arm
from sim.body.soft_tissue import ELEMENT_RADIUS, SoftTissue, soft_tissues
from sim.interface.cuffs import quaternion
from sim.interface.straps import STRAP_MASS
from sim.parameters.wearer import NOMINAL_WEARER, Wearer
from sim.robot.control import Gains
from sim.robot.device import ELBOW_JOINT, NESM, Device, add_exoskeleton

#: Reference person of the paper's section 2.3.
REFERENCE_HEIGHT, REFERENCE_MASS = 1.75, 70.0

#: The nominal model's motors are not driven: their torque is measured.
NO_GAINS = Gains(kp=0.0, kv=0.0, ki=0.0)


@dataclass(frozen=True)
class NominalModel:
    """The declared model as MuJoCo sees it: the device's joints, no contact, no limits."""

    model: mujoco.MjModel

    def inverse_dynamics(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray, joint: int = 3
    ) -> np.ndarray:
        """Return one of the `torques`, Nm, shape (n,); of the NESM's elbow by default."""
        return self.torques(position, velocity, acceleration)[:, joint]

    def torques(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        """Return the joints' torques that the declared bodies need for a motion (equation 20).

        The sum of both M, C and g terms, the joints' dampers and the motors' inertia: everything on
        the right of equation 20 but the motor torque.

        Args:
            position: joint angles theta, rad, shape (n, number of the device's joints).
            velocity: rad/s, of that shape.
            acceleration: rad/s2, of that shape.

        Returns:
            Torque at each joint in Nm, of that shape.
        """
        of = self._by_recursion if self._is_rigid_chain else self._by_engine
        return of(position, velocity, acceleration)

    @cached_property
    def _chain(self) -> RigidChain:
        return rigid_chain(self.model)

    @cached_property
    def _is_rigid_chain(self) -> bool:
        """Whether the recursion finds what MuJoCo does: a device may have springs, say."""
        position, velocity, acceleration = np.random.default_rng(0).normal(
            size=(3, 8, self.model.nv)
        )
        recursion, engine = (
            of(position, velocity, acceleration) for of in (self._by_recursion, self._by_engine)
        )
        return np.allclose(recursion, engine, rtol=1e-9, atol=1e-9)

    def _by_recursion(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        torques = self._chain.torques(position, velocity, acceleration)
        torques += self.model.dof_armature * acceleration
        torques += self.model.dof_damping * velocity
        return torques

    def _by_engine(
        self, position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        data = mujoco.MjData(self.model)
        torques = np.empty_like(position)
        for i in range(len(position)):
            data.qpos, data.qvel, data.qacc = position[i], velocity[i], acceleration[i]
            mujoco.mj_inverse(self.model, data)
            torques[i] = data.qfrc_inverse
        return torques

    def bias(self, position: np.ndarray, velocity: np.ndarray, joint: int = 3) -> np.ndarray:
        """Return Coriolis, centrifugal and gravity torque at a joint, Nm, shape (n,)."""
        at_rest = np.zeros_like(position)
        damping = float(self.model.dof_damping[joint])
        inverse = self.inverse_dynamics(position, velocity, at_rest, joint)
        return inverse - damping * velocity[:, joint]


@cache
def nominal_model(device: Device = NESM, *, attachments: bool = True) -> NominalModel:
    """Build the nominal model; it is the same for every wearer, so it is built once a process.

    Args:
        device: the exoskeleton.
        attachments: whether tissue and straps are declared. The authors' published nominal model
            leaves both out, which their form of the regression needs.
    """
    return NominalModel(model=nominal_spec(device, attachments=attachments).compile())


def nominal_spec(
    device: Device = NESM,
    *,
    attachments: bool = True,
    height_m: float = REFERENCE_HEIGHT,
    mass_kg: float = REFERENCE_MASS,
) -> mujoco.MjSpec:
    """Return the nominal model as a spec, with the arm scaled to a subject.

    Segment lengths scale with height and segment masses with body mass, as the anthropometric
    tables do that the paper takes its reference person from (section 2.3). The joints stay aligned.

    Args:
        device: the exoskeleton.
        attachments: whether tissue and straps are declared.
        height_m: the subject's height, m.
        mass_kg: the subject's mass, kg.
    """
    wearer = _subject(height_m / REFERENCE_HEIGHT, mass_kg / REFERENCE_MASS)
    spec = empty_spec()
    # The declared joints have no stops: what a stop would add to the inverse is not a human torque.
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    add_exoskeleton(spec, NO_GAINS, device=device)
    # An aligned arm moves no passive joint, and no encoder would show it.
    for name in device.passive:
        spec.delete(spec.joint(name))
    upper_cuff, forearm_cuff = device.cuffs
    arm = _aligned_arm_poses(device)
    humerus = spec.body(upper_cuff.link).add_body(name="humerus", **arm["humerus"])
    # fill_upper_arm hangs an ulna on the humerus, which the forearm's link carries instead.
    spec.delete(fill_upper_arm(humerus, wearer))
    ulna = spec.body(forearm_cuff.link).add_body(name="ulna", **arm["ulna"])
    fill_forearm(ulna, wearer)
    if attachments:
        for cuff, tissue, bone in zip(
            device.cuffs, soft_tissues(wearer), (humerus, ulna), strict=True
        ):
            _add_tissue(bone, tissue)
            strap = spec.body(cuff.link).add_body(name=f"{cuff.name}_strap", pos=list(cuff.centre))
            _set_inertia(strap, STRAP_MASS, radius=cuff.radius, length=cuff.length, axis=cuff.along)
    return spec


def _subject(length_scale: float, mass_scale: float) -> Wearer:
    """Return the nominal wearer scaled; tissue keeps its mass, so the rest takes the difference."""
    upper_arm, forearm = (tissue.mass for tissue in soft_tissues(NOMINAL_WEARER))
    nominal = NOMINAL_WEARER
    return replace(
        nominal,
        upper_arm_length=nominal.upper_arm_length * length_scale,
        forearm_length=nominal.forearm_length * length_scale,
        upper_arm_mass=(nominal.upper_arm_mass + upper_arm) * mass_scale - upper_arm,
        forearm_mass=(nominal.forearm_mass + forearm) * mass_scale - forearm,
    )


def _aligned_arm_poses(device: Device) -> dict[str, dict[str, list[float]]]:
    """Return the pose of humerus and ulna in their links, both elbows straight."""
    spec = empty_spec()
    add_arm(spec, NOMINAL_WEARER)
    add_exoskeleton(spec, NO_GAINS, device=device)
    model = spec.compile()
    data = mujoco.MjData(model)
    start = device.start("elbow")
    straight = (*start.human_shoulder, 0.0)
    for joint, angle in (
        *zip(HUMAN_JOINTS, straight, strict=True),
        *zip(device.joints, start.angles, strict=True),
        (ELBOW_JOINT, 0.0),
    ):
        data.joint(joint).qpos = angle
    mujoco.mj_kinematics(model, data)
    poses = {}
    for bone, link in zip(("humerus", "ulna"), (cuff.link for cuff in device.cuffs), strict=True):
        frame = data.body(link).xmat.reshape(3, 3)
        pos = frame.T @ (data.body(bone).xpos - data.body(link).xpos)
        quat = quaternion(frame.T @ data.body(bone).xmat.reshape(3, 3))
        poses[bone] = {"pos": list(pos), "quat": list(quat)}
    return poses


def _add_tissue(bone: mujoco.MjsBody, tissue: SoftTissue) -> None:
    """Add the declared tissue: the mass of its elements, which lie on a cylinder."""
    body = bone.add_body(
        name=f"{tissue.name}_tissue",
        pos=[(tissue.start + tissue.end) / 2, tissue.axis_y, tissue.axis_z],
    )
    _set_inertia(
        body,
        tissue.mass,
        radius=tissue.radius - ELEMENT_RADIUS,
        length=tissue.end - tissue.start,
        axis=(1, 0, 0),
    )


def _set_inertia(
    body: mujoco.MjsBody,
    mass: float,
    *,
    radius: float,
    length: float,
    axis: tuple[float, float, float],
) -> None:
    """Give `body` the inertia of a thin-walled cylinder along `axis`."""
    across = mass * (radius**2 / 2 + length**2 / 12)
    body.explicitinertial = True
    # Said, because an explicit inertia without a place is put at the body's own offset once more.
    body.ipos = [0.0, 0.0, 0.0]
    body.mass = mass
    along = np.outer(axis, axis)
    tensor = mass * radius**2 * along + across * (np.eye(3) - along)
    if np.count_nonzero(tensor) == 3:
        body.inertia = np.diag(tensor)
    else:
        body.fullinertia = tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
