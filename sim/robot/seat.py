"""How the arm comes into the exoskeleton: the pose in which its straps are closed, and buckles."""

from math import asin, atan2, cos, radians, sin

import mujoco
import numpy as np

from sim.assessment.system import System
from sim.body.skeleton import ELBOW, upper_arm_point
from sim.body.soft_tissue import Sleeve
from sim.interface.cuffs import Cuff, segment_names
from sim.parameters.wearer import Wearer
from sim.robot.device import ELBOW_JOINT, MOTOR_GROUP, Device, Start

#: Farthest a seated human elbow may be from the exoskeleton's, rad.
SEAT_REACH = radians(50.0)


def reset_to_start(system: System) -> mujoco.MjData:
    """Return data with the exoskeleton where the straps are closed, locked, the arm in it.

    That is the start of the movement, but for the condition `seat_angle`; motors are off.

    The human shoulder takes the exoskeleton's angles, and the elbow the angle at which the
    forearm's axis passes through the centre of its cuff: one start for every wearer, without a
    history.
    """
    data = mujoco.MjData(system.model)
    start = system.device.start(system.target.name)
    closed_at = elbow_angle(system.device, start) + system.conditions.seat_angle
    data.qpos[system.exo_qpos] = start.angles
    data.qpos[system.exo_qpos[system.elbow]] = closed_at
    data.qpos[system.human_qpos[:3]] = start.human_shoulder
    data.qpos[system.human_qpos[3]] = seated_elbow_angle(
        system.wearer, system.sleeves[1], system.cuffs[1], closed_at
    )
    data.eq_active[system.locks] = 1
    system.model.opt.disableactuator |= 1 << MOTOR_GROUP
    return data


def elbow_angle(device: Device, start: Start) -> float:
    """Return the angle of the device's elbow at a start, rad."""
    return start.angles[device.joints.index(ELBOW_JOINT)]


def seated_elbow_angle(wearer: Wearer, sleeve: Sleeve, cuff: Cuff, exo_angle: float) -> float:
    """Return the elbow angle (rad) at which the forearm's axis meets the centre of its cuff.

    Solved in the plane of flexion, in which the upper arms coincide, with the exoskeleton's elbow
    at `exo_angle`. When no angle does (an arm too long for it), the closest within reach.
    """
    elbow = upper_arm_point(wearer, ELBOW)[[0, 2]]
    along, across = forearm_cuff_centre(cuff, exo_angle) - elbow
    distance, low = float(np.hypot(along, across)), exo_angle - SEAT_REACH
    high = min(exo_angle + SEAT_REACH, radians(143.0))
    if abs(sleeve.axis_z) <= distance:
        angle = atan2(across, along) - asin(sleeve.axis_z / distance)
        if low <= angle <= high:
            return angle
    # How far the cuff's centre lies from the forearm's axis at both ends.
    misses = [abs(across * cos(end) - along * sin(end) - sleeve.axis_z) for end in (low, high)]
    return low if misses[0] < misses[1] else high


def forearm_cuff_centre(cuff: Cuff, exo_angle: float) -> np.ndarray:
    """Return the centre of the forearm's cuff in the flexion plane (along, across the arm), m."""
    along, _, across = cuff.limb_place
    return (
        np.array(cuff.limb_joint)
        + along * direction(exo_angle)
        + across * direction(exo_angle + np.pi / 2)
    )


def slacken_straps(system: System, data: mujoco.MjData) -> None:
    """Pull every strap with a nearly constant tension, as a hand does that closes it."""
    model, straps = system.model, system.straps
    mujoco.mj_fwdPosition(model, data)
    give = 0.1
    model.tendon_stiffness[straps] = row_tensions(system) / give
    model.tendon_lengthspring[straps] = (data.ten_length[straps] - give)[:, None]


def close_straps(system: System, data: mujoco.MjData, stiffness: np.ndarray) -> None:
    """Close the buckles: the strap keeps its present tension and regains its stiffness (N/m)."""
    model, straps = system.model, system.straps
    mujoco.mj_fwdPosition(model, data)
    rest = data.ten_length[straps] - row_tensions(system) / stiffness
    model.tendon_stiffness[straps] = stiffness
    model.tendon_lengthspring[straps] = rest[:, None]


def row_tensions(system: System) -> np.ndarray:
    """Return the tension of each strap segment when closed, N: rows share a strap's tension."""
    return np.array(
        [
            system.conditions.strap_tension / cuff.rows
            for cuff in system.cuffs
            for _ in segment_names(cuff)
        ]
    )


def direction(angle: float) -> np.ndarray:
    """Unit vector in the flexion plane (along, across the arm) at `angle` rad of flexion."""
    return np.array([np.cos(angle), np.sin(angle)])
