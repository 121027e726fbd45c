"""The four-degree-of-freedom exoskeleton (paper, section 2.2.2), as data.

Masses, inertias, axes and ranges are facts of the authors' public model of the NESM (github
stesfazgi/rehyb_mujoco, models/exo_with_patient), after Trigili et al. 2020. A device is a chain of
`Link`; another chain replaces it if its last two links carry the upper arm's and the forearm's
cuff.
"""

from dataclasses import dataclass
from math import radians

import mujoco

from sim.control import Gains


@dataclass(frozen=True, kw_only=True)
class Link:
    """One link with the joint that moves it: SI units, angles in degrees."""

    name: str
    #: Pose in the parent link (the world for the first).
    pos: tuple[float, float, float] = (0.0, 0.0, 0.0)
    quat: tuple[float, float, float, float]
    mass: float
    centre: tuple[float, float, float]
    #: xx, yy, zz, xy, xz, yz about the centre, kg m2.
    inertia: tuple[float, float, float, float, float, float]
    joint: str
    axis: tuple[int, int, int]
    range_deg: tuple[float, float]
    #: Joint angle of the chain's zero pose (the arm held forward).
    ref_deg: float = 0.0


_HALF = 0.7071067811865476
NESM = (
    Link(
        name="link_1",
        quat=(0.0, _HALF, 0.0, _HALF),
        mass=6.712,
        centre=(0.0, 0.0191, -0.1279),
        inertia=(0.3787893, 0.192833, 0.1956839, -0.0006556, -0.0006709, 0.0540633),
        joint="J1",
        axis=(0, 0, 1),
        range_deg=(-90.0, 0.0),
    ),
    Link(
        name="link_2",
        quat=(_HALF, _HALF, 0.0, 0.0),
        mass=3.487,
        centre=(0.0001, 0.0881, -0.1201),
        inertia=(0.1108677, 0.0689688, 0.0569634, -0.0000977, 0.0000399, 0.0384741),
        joint="J2",
        axis=(0, 0, 1),
        range_deg=(-90.0, 0.0),
        ref_deg=-90.0,
    ),
    Link(
        name="link_3",
        pos=(0.0, 0.25, 0.0),
        quat=(_HALF, -_HALF, 0.0, 0.0),
        mass=1.663,
        centre=(-0.0006, 0.1679, -0.03),
        inertia=(0.0266938, 0.007941, 0.0235228, 0.0001282, -0.0000556, 0.0038772),
        joint="J3",
        axis=(0, 0, 1),
        range_deg=(-86.0, 30.0),
    ),
    Link(
        name="link_4",
        quat=(_HALF, _HALF, 0.0, 0.0),
        mass=0.494,
        centre=(0.0, 0.0707, -0.0803),
        inertia=(0.0069974, 0.0035498, 0.0037622, -0.0000009, -0.0000004, 0.001812),
        joint="J4",
        axis=(0, 0, -1),
        # The authors stop at 0; the controller overshoots, and a stop in the data is not stiffness.
        range_deg=(-20.0, 125.0),
    ),
)

JOINTS = tuple(link.joint for link in NESM)
#: The joint that an elbow assessment moves.
ELBOW_JOINT = "J4"
#: Viscous damping of each joint, Nm s/rad (authors' class exoskeleton).
JOINT_DAMPING = 1.0
#: Reflected motor inertia of each joint, kg m2: without it the forearm's link is so light that the
#: controller's damping dominates a time step.
MOTOR_INERTIA = 0.15
#: Largest motor torque, Nm (paper, section 2.2.2; Trigili et al. 2020).
MOTOR_LIMIT = 60.0
#: Actuators of this group are switched off while the start is locked.
MOTOR_GROUP = 1


def add_exoskeleton(
    spec: mujoco.MjSpec,
    gains: Gains,
    *,
    friction: float = 0.0,
    joint: str = ELBOW_JOINT,
    links: tuple[Link, ...] = NESM,
) -> None:
    """Add the chain with a controller in the engine on every joint.

    The derivative gain is implicit in the integrator, hence stable at every step.

    Args:
        spec: the model under construction.
        gains: of every motor.
        friction: Coulomb friction of `joint`, Nm, which the nominal model never knows.
        joint: the joint that has it.
        links: the device.
    """
    body = spec.worldbody
    for link in links:
        body = body.add_body(name=link.name, pos=list(link.pos), quat=list(link.quat))
        body.explicitinertial = True
        body.mass = link.mass
        body.ipos = list(link.centre)
        body.fullinertia = list(link.inertia)
        body.add_joint(
            name=link.joint,
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=list(link.axis),
            ref=radians(link.ref_deg),
            range=[radians(angle) for angle in link.range_deg],
            limited=mujoco.mjtLimited.mjLIMITED_TRUE,
            damping=[JOINT_DAMPING, 0.0, 0.0],
            armature=MOTOR_INERTIA,
            frictionloss=friction if link.joint == joint else 0.0,
        )
        motor = spec.add_actuator(
            name=f"{link.joint}_motor",
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            target=link.joint,
            forcelimited=True,
            forcerange=[-MOTOR_LIMIT, MOTOR_LIMIT],
            group=MOTOR_GROUP,
        )
        motor.set_to_pid(kp=gains.kp, kv=gains.kv, ki=gains.ki)
    _draw(spec)


def _draw(spec: mujoco.MjSpec) -> None:
    """Draw the frame: bars beside the arm that touch nothing and weigh nothing."""
    for name, body, start, end in (
        ("shoulder_frame", "link_2", (0.0, 0.0, -0.12), (0.0, 0.25, -0.12)),
        ("elbow_bracket", "link_3", (0.0, 0.12, 0.0), (0.0, 0.06, -0.1)),
        ("forearm_bar", "link_4", (0.0, 0.0, -0.1), (0.0, 0.16, -0.1)),
        ("forearm_bracket", "link_4", (0.0, 0.14, -0.1), (0.0108, 0.14, -0.07)),
    ):
        geom = spec.body(body).add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            size=[0.012, 0, 0],
            rgba=[0.25, 0.3, 0.36, 1.0],
        )
        geom.fromto = [*start, *end]
        geom.contype = geom.conaffinity = 0
        geom.mass = 0.0
