"""The bones of the arm: five degrees of freedom, a rigid wrist and hand (paper, section 2.2.1).

World frame: the right shoulder is the origin, x points forward, y to the left (medial), z up. In
the model's zero pose the arm is held forward and horizontal, the elbow straight; gravity pulls
along -z.

Geometry, inertia radii and joint ranges are facts of the authors' public model (github
stesfazgi/rehyb_mujoco, models/exo_with_patient), which follows Holzbaur et al. 2005. Its humerus is
drawn 0.2907 m long and shrunk so that the nominal elbow lies on the exoskeleton's axis. The authors
shrink it by 0.86267, which leaves the axes 4.3 mm apart; here it is shrunk and turned about the
shoulder by a degree until they coincide, but for the condition `elbow_offset`.
"""

from math import asin, atan2, cos, hypot, radians, sin

import mujoco
import numpy as np

from sim.parameters.wearer import Wearer

#: Elbow in the authors' humerus frame before scaling, m.
ELBOW = np.array([0.2907, -0.0058, -0.0049])
#: Shoulder to elbow of the nominal wearer and of the exoskeleton, across the elbow's axis, m.
UPPER_ARM_LINK = 0.25
#: What brings the nominal elbow onto the exoskeleton's elbow axis: a scale, and in which direction
#: the authors' elbow lies, rad.
HUMERUS_SHRINK = UPPER_ARM_LINK / hypot(ELBOW[0], ELBOW[2])
_ELBOW_DIRECTION = atan2(ELBOW[2], ELBOW[0])
#: `elbow_offset` of the authors' own wearer, m.
AUTHORS_ELBOW_OFFSET = UPPER_ARM_LINK * sin(_ELBOW_DIRECTION)
#: Proximal end of the radius in the ulna frame at nominal forearm length, m.
RADIUS = np.array([0.0133, -0.0171, 0.0163])
#: Wrist in the radius frame at nominal forearm length, m.
WRIST = np.array([0.265, 0.0, 0.0])
#: Radii of the cylinders whose inertia the segments have, m.
UPPER_ARM_RADIUS = 0.045
FOREARM_RADIUS = 0.03
#: Half of the forearm's mass turns with the radius (authors' ulna_M_frac).
RADIUS_MASS_SHARE = 0.5
#: Viscous damping of every human joint, Nm s/rad (authors' class human_body).
JOINT_DAMPING = 0.6

#: Human joints that correspond to the exoskeleton's J1 to J4.
HUMAN_JOINTS = ("shoulder_abduction", "shoulder_flexion", "shoulder_rotation", "elbow_flexion")
PRONATION = "forearm_pronation"
#: Anatomical range of the elbow, rad; the authors' 0 to 120 degrees is met by long upper arms.
ELBOW_RANGE = (radians(-10.0), radians(145.0))
#: Where an extension stop begins, and the stretch that doubles its stiffness, rad.
STOP_ANGLE, STOP_HARDENING = radians(5.0), radians(5.0)

#: Hand: palm 0.5 kg, twelve finger capsules of 0.01 kg, thumb 3 x 0.005 kg; rigid here.
HAND_BOXES = (
    # name, mass kg, centre m, half sizes m (in the hand frame at nominal length)
    ("palm", 0.5, (0.045, 0.0, 0.0), (0.045, 0.04, 0.01)),
    ("fingers", 0.12, (0.125, 0.0, -0.005), (0.035, 0.032, 0.008)),
    ("thumb", 0.015, (0.063, 0.068, -0.012), (0.028, 0.014, 0.008)),
)

_SKIN = (0.85, 0.75, 0.68, 1.0)
BONE_COLOUR = (0.93, 0.9, 0.84, 1.0)
#: Of a geom that is only drawn: it meets nothing and weighs nothing.
DRAWN = {"contype": 0, "conaffinity": 0, "mass": 0.0}


def empty_spec() -> mujoco.MjSpec:
    """Return a spec that takes angles in rad, as all of ours do."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    return spec


def upper_arm_point(wearer: Wearer, point: object) -> np.ndarray:
    """Turn and scale a figure of the authors' humerus frame (shape (3,), m) to the wearer."""
    turn = asin(wearer.elbow_offset / UPPER_ARM_LINK) - _ELBOW_DIRECTION
    x, y, z = np.asarray(point, dtype=float) * HUMERUS_SHRINK * wearer.upper_arm_scale
    return np.array([x * cos(turn) - z * sin(turn), y, x * sin(turn) + z * cos(turn)])


def forearm_point(wearer: Wearer, point: object) -> np.ndarray:
    """Scale a figure of the authors' ulna, radius or hand frame (shape (3,), m) to the wearer."""
    return np.asarray(point, dtype=float) * wearer.forearm_scale


def bone_point(wearer: Wearer, bone: str, point: object) -> np.ndarray:
    """Scale a figure of the authors' frame of any bone (shape (3,), m) to the wearer."""
    if bone == "humerus":
        return upper_arm_point(wearer, point)
    if bone in ("ulna", "radius"):
        return forearm_point(wearer, point)
    return np.asarray(point, dtype=float)


def add_torso(spec: mujoco.MjSpec) -> None:
    """Add thorax, clavicle and scapula: where the shoulder's and the long muscles begin."""
    thorax = spec.worldbody.add_body(name="thorax", pos=[-0.0157, 0.2097, 0.0231])
    capsule, sphere = mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_SPHERE
    across, upright = (0.7071067811865476, 0.7071067811865476, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
    for name, kind, pos, size, quat in (
        ("chest", capsule, (0.0634, 0.0114, -0.0437), (0.07, 0.07, 0.0), across),
        ("waist", capsule, (0.0534, 0.0114, -0.2337), (0.06, 0.11, 0.0), upright),
        ("head", sphere, (0.0634, 0.0114, 0.1463), (0.09, 0.0, 0.0), upright),
    ):
        thorax.add_geom(name=name, type=kind, pos=pos, size=size, quat=quat, rgba=_SKIN, **DRAWN)
    clavicle = thorax.add_body(name="clavicle")
    _bone(clavicle, "clavicle", np.zeros(3), np.array([-0.0282, -0.2077, -0.0001]))
    scapula = clavicle.add_body(name="scapula", pos=[-0.0282, -0.2077, -0.0001])
    _bone(scapula, "scapula", np.zeros(3), np.array([0.0439, -0.002, -0.023]))


def add_arm(spec: mujoco.MjSpec, wearer: Wearer, *, pronates: bool = True) -> None:
    """Add humerus, ulna, radius and hand with their five joints, angles in rad.

    Without `pronates` the radius is rigid on the ulna: four joints, and no grip to hold the fifth.

    The shoulder's joints are named after the exoskeleton axis they lie on; at the paper's start
    pose (0, -90, 0, 110) degrees both chains share their angles when the wearer is aligned.
    """
    humerus = spec.worldbody.add_body(name="humerus")
    _hinge(humerus, HUMAN_JOINTS[1], (0, 1, 0), (-95.0, 5.0), ref=-90.0)
    _hinge(humerus, HUMAN_JOINTS[0], (0, 0, 1), (-95.0, 5.0))
    _hinge(humerus, HUMAN_JOINTS[2], (1, 0, 0), (-80.0, 85.0))
    ulna = fill_upper_arm(humerus, wearer)
    _hinge(ulna, HUMAN_JOINTS[3], (0, -1, 0), tuple(np.degrees(ELBOW_RANGE)))
    radius = fill_forearm(ulna, wearer)
    if not pronates:
        return
    _hinge(radius, PRONATION, (-1, 0, 0), (-175.0, 5.0))
    # The hand holds the exoskeleton's handle: during an assessment the forearm does not pronate.
    grip = spec.add_equality(
        name="grip", type=mujoco.mjtEq.mjEQ_JOINT, name1=PRONATION, solref=[0.02, 1.0]
    )
    grip.solimp[:3] = [0.95, 0.99, 0.001]


def add_extension_stop(spec: mujoco.MjSpec, stiffness: float) -> None:
    """Add what resists extension beyond STOP_ANGLE passively: ligaments and bone, Nm/rad.

    `extension_stop_torque` is what it does.
    """
    stop = spec.add_tendon(
        name="extension_stop",
        stiffness=[stiffness, 0.0, stiffness / STOP_HARDENING**2],
        springlength=[STOP_ANGLE, 2.0 * ELBOW_RANGE[1]],
    )
    stop.wrap_joint(HUMAN_JOINTS[3], 1.0)


def add_passive_impedance(
    spec: mujoco.MjSpec, *, stiffness: float, damping: float, neutral_angle: float
) -> None:
    """Add a linear spring and damper to the human elbow (paper, equation 3).

    Args:
        spec: with the arm.
        stiffness: Nm/rad; it resists.
        damping: Nm s/rad, beside JOINT_DAMPING.
        neutral_angle: where the spring is slack, rad.
    """
    elbow = spec.joint(HUMAN_JOINTS[3])
    elbow.stiffness = [stiffness, 0.0, 0.0]
    elbow.springref = neutral_angle
    elbow.damping = [JOINT_DAMPING + damping, 0.0, 0.0]


def extension_stop_torque(angle: np.ndarray, stiffness: float) -> np.ndarray:
    """Return the torque of an extension stop, Nm, flexion positive.

    It hardens as it is stretched, doubling its stiffness after STOP_HARDENING, and is nothing at
    angles above STOP_ANGLE.

    Args:
        angle: of the human elbow, rad, of any shape.
        stiffness: at STOP_ANGLE, Nm/rad.
    """
    stretch = np.maximum(0.0, STOP_ANGLE - angle)
    return np.asarray(stiffness * stretch * (1.0 + (stretch / STOP_HARDENING) ** 2))


def fill_upper_arm(humerus: mujoco.MjsBody, wearer: Wearer) -> mujoco.MjsBody:
    """Give the body `humerus` its bone and inertia; return the ulna's body at the elbow."""
    elbow = upper_arm_point(wearer, ELBOW)
    _set_cylinder_inertia(
        humerus,
        centre=elbow / 2,
        mass=wearer.upper_arm_mass,
        radius=UPPER_ARM_RADIUS * HUMERUS_SHRINK * wearer.upper_arm_scale,
        length=elbow[0],
    )
    _bone(humerus, "humerus", np.zeros(3), elbow)
    return humerus.add_body(name="ulna", pos=elbow)


def fill_forearm(ulna: mujoco.MjsBody, wearer: Wearer) -> mujoco.MjsBody:
    """Give ulna, radius and hand their bones and inertias; return the radius' body."""
    head, wrist = forearm_point(wearer, RADIUS), forearm_point(wearer, WRIST)
    cylinder = {"radius": FOREARM_RADIUS * wearer.forearm_scale, "length": wrist[0]}
    _set_cylinder_inertia(
        ulna,
        centre=(head + wrist) / 2,
        mass=wearer.forearm_mass * (1 - RADIUS_MASS_SHARE),
        **cylinder,
    )
    _bone(ulna, "ulna", np.zeros(3), head)
    radius = ulna.add_body(name="radius", pos=head)
    _set_cylinder_inertia(
        radius, centre=wrist / 2, mass=wearer.forearm_mass * RADIUS_MASS_SHARE, **cylinder
    )
    _bone(radius, "radius", np.zeros(3), wrist)
    hand = radius.add_body(name="hand", pos=wrist)
    for name, mass, centre, half_sizes in HAND_BOXES:
        hand.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=centre,
            size=half_sizes,
            rgba=_SKIN,
            **DRAWN | {"mass": mass},
        )
    return radius


def _hinge(
    body: mujoco.MjsBody,
    name: str,
    axis: tuple[int, int, int],
    range_deg: tuple[float, ...],
    ref: float = 0.0,
) -> None:
    body.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=list(axis),
        range=[radians(angle) for angle in range_deg],
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        ref=radians(ref),
        damping=[JOINT_DAMPING, 0.0, 0.0],
    )


def _set_cylinder_inertia(
    body: mujoco.MjsBody, *, centre: np.ndarray, mass: float, radius: float, length: float
) -> None:
    """Give `body` the inertia of a solid cylinder along its x axis."""
    across = mass * (radius**2 / 4 + length**2 / 12)
    body.explicitinertial = True
    body.ipos = centre
    body.mass = mass
    body.inertia = [mass * radius**2 / 2, across, across]


def _bone(body: mujoco.MjsBody, name: str, start: np.ndarray, end: np.ndarray) -> None:
    body.add_geom(
        name=f"{name}_bone",
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        size=[0.01, 0, 0],
        fromto=[*start, *end],
        rgba=BONE_COLOUR,
        **DRAWN,
    )
