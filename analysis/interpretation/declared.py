"""Whether the robot that a session declares is the one that banks are of.

Two models are one robot if the same motion takes the same torques, however their files write it
(what motions cannot tell apart are one set of base parameters: Gautier and Khalil 1990, Direct
calculation of minimum set of inertial parameters of serial robots), and if cuffs that both have are
in one place. Of two that are not, what differs is named.
"""

import mujoco
import numpy as np

from analysis.closeloop.session.contents import NOMINAL, Session
from analysis.closeloop.session.mjcf import load_device
from sim.assessment.nominal import NO_GAINS, nominal_spec
from sim.body.skeleton import empty_spec
from sim.parameters.target import ELBOW_TARGET
from sim.robot.device import CUFF_SITES, ELBOW_JOINT, NESM, TOLERANCE, add_exoskeleton

#: What torques of one robot may differ by, Nm: files round masses and inertias.
LARGEST = 0.01
#: What is compared of a joint, in which unit, and what it may differ by.
NUMBERS = {
    "the mass of the link": (" kg", 1e-3),
    "the axis": ("", 1e-3),
    "the damping": (" Nm s/rad", 1e-3),
    "the friction": (" Nm", 1e-6),
    "the armature": (" kg m2", 1e-3),
    "the centre of all mass from the link on": (" m", 1e-3),
}
#: Motions that are compared, and how far from the start of an assessment they are, rad.
MOTIONS, AROUND = 16, 0.5


def other_robot(session: Session) -> str | None:
    """Return in which number a declared robot differs from the NESM, or None.

    The model may be of the robot alone or, as `nominal` is, with a limb in it.

    Raises:
        SessionError: the model cannot be used.
    """
    if session.model == NOMINAL:
        return None
    declared = load_device(session).model
    alone = empty_spec()
    add_exoskeleton(alone, NO_GAINS)
    bare = alone.compile()
    height, mass = session.height_m, session.mass_kg
    worn = [
        nominal_spec(attachments=attachments, height_m=height, mass_kg=mass).compile()
        for attachments in (False, True)
    ]
    ours = [bare, *worn]
    apart = [float(np.abs(_torques(declared) - _torques(one)).max()) for one in ours]
    if min(apart) > LARGEST or (_friction(declared) != _friction(bare)).any():
        # A limb is bodies more than there are joints.
        nearest = 0 if declared.nbody <= bare.nbody else int(np.argmin(apart))
        return f"{_named(declared, ours[nearest])}, by {session.model}"
    if (cuff := _moved_cuff(declared)) is not None:
        return f"{cuff}, by {session.model}"
    return None


def _moved_cuff(declared: mujoco.MjModel) -> str | None:
    """Return which cuff is elsewhere, if the model says where cuffs are."""
    ours = mujoco.MjModel.from_xml_path(str(NESM.path))
    sites = {declared.site(i).name for i in range(declared.nsite)}
    for name in CUFF_SITES:
        if name not in sites:
            continue
        one, other = (_posed(model) for model in (declared, ours))
        away = [data.site(name).xpos - data.joint(ELBOW_JOINT).xanchor for data in (one, other)]
        off = float(np.linalg.norm(away[0] - away[1]))
        if off > TOLERANCE:
            return f"{name} is {1000.0 * off:.0f} mm from where the bank's is"
    return None


def _torques(model: mujoco.MjModel) -> np.ndarray:
    """Return what some motions take, Nm, shape (MOTIONS, joints of the NESM)."""
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    rng = np.random.default_rng(0)
    start = np.array(NESM.start(ELBOW_TARGET.name).angles)
    count = len(NESM.joints)
    positions = start + rng.uniform(-AROUND, AROUND, (MOTIONS, count))
    velocities, accelerations = rng.normal(size=(2, MOTIONS, count))
    dofs = [int(model.joint(joint).dofadr[0]) for joint in NESM.joints]
    places = [int(model.joint(joint).qposadr[0]) for joint in NESM.joints]
    data = mujoco.MjData(model)
    torques = np.empty((MOTIONS, count))
    for i in range(MOTIONS):
        data.qpos[places], data.qvel[dofs] = positions[i], velocities[i]
        data.qacc[dofs] = accelerations[i]
        mujoco.mj_inverse(model, data)
        torques[i] = data.qfrc_inverse[dofs]
    return torques


def _friction(model: mujoco.MjModel) -> np.ndarray:
    return np.array([model.joint(joint).frictionloss[0] for joint in NESM.joints])


def _named(declared: mujoco.MjModel, ours: mujoco.MjModel) -> str:
    """Return the first number that differs, of the joint farthest out first."""
    theirs, own = _numbers(declared), _numbers(ours)
    for what, (unit, tolerance) in NUMBERS.items():
        for number in reversed(range(len(NESM.joints))):
            one, other = (np.round(found[what][number], 6) + 0.0 for found in (theirs, own))
            if np.abs(one - other).max() > tolerance:
                said, usual = (" ".join(f"{x:.4g}" for x in np.atleast_1d(v)) for v in (one, other))
                return f"{what} of {NESM.joints[number]} is {said}{unit}, not {usual}"
    off = np.abs(_torques(declared) - _torques(ours)).max(axis=0)
    worst = int(np.argmax(off))
    return f"by its inertias {NESM.joints[worst]} needs up to {off[worst]:.2g} Nm more or less"


def _posed(model: mujoco.MjModel) -> mujoco.MjData:
    """Return where a robot is when an assessment of the elbow begins."""
    data = mujoco.MjData(model)
    for name, angle in zip(NESM.joints, NESM.start(ELBOW_TARGET.name).angles, strict=True):
        data.joint(name).qpos = angle
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    return data


def _numbers(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    """Return NUMBERS of each joint, shape (joints, ..)."""
    data = _posed(model)
    joints = [model.joint(joint) for joint in NESM.joints]
    bodies = np.array([model.jnt_bodyid[joint.id] for joint in joints])
    carried = np.array(model.body_subtreemass[bodies])
    return {
        "the mass of the link": carried - np.append(carried[1:], 0.0),
        "the axis": np.array([data.joint(joint).xaxis for joint in NESM.joints]),
        "the damping": np.array([joint.damping[0] for joint in joints]),
        "the friction": _friction(model),
        "the armature": np.array([joint.armature[0] for joint in joints]),
        "the centre of all mass from the link on": np.array(data.subtree_com[bodies]),
    }
