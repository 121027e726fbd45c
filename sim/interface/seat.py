"""How the arm lies in the exoskeleton when its straps are closed: geometry in the flexion plane."""

from math import asin, atan2, cos, radians, sin

import numpy as np

from sim.body.skeleton import ELBOW, upper_arm_point
from sim.body.soft_tissue import SoftTissue
from sim.parameters.wearer import Wearer
from sim.robot.cuff import Cuff

#: Farthest a seated human elbow may be from the exoskeleton's, rad.
SEAT_REACH = radians(50.0)


def seated_elbow_angle(wearer: Wearer, tissue: SoftTissue, cuff: Cuff, exo_angle: float) -> float:
    """Return the elbow angle (rad) at which the forearm's axis meets the centre of its cuff.

    Solved in the plane of flexion, in which the upper arms coincide, with the exoskeleton's elbow
    at `exo_angle`. When no angle does (an arm too long for it), the closest within reach.
    """
    elbow = upper_arm_point(wearer, ELBOW)[[0, 2]]
    along, across = forearm_cuff_centre(cuff, exo_angle) - elbow
    distance, low = float(np.hypot(along, across)), exo_angle - SEAT_REACH
    high = min(exo_angle + SEAT_REACH, radians(143.0))
    if abs(tissue.axis_z) <= distance:
        angle = atan2(across, along) - asin(tissue.axis_z / distance)
        if low <= angle <= high:
            return angle
    # How far the cuff's centre lies from the forearm's axis at both ends.
    misses = [abs(across * cos(end) - along * sin(end) - tissue.axis_z) for end in (low, high)]
    return low if misses[0] < misses[1] else high


def forearm_cuff_centre(cuff: Cuff, exo_angle: float) -> np.ndarray:
    """Return the centre of the forearm's cuff in the flexion plane (along, across the arm), m."""
    along, _, across = cuff.limb_place
    return (
        np.array(cuff.limb_joint)
        + along * _direction(exo_angle)
        + across * _direction(exo_angle + np.pi / 2)
    )


def seats_in_bones(
    wearer: Wearer, tissue: SoftTissue, cuffs: tuple[Cuff, Cuff], exo_angle: float
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return where each cuff's centre and axes lie in its bone at the start: (3,) and (3, 3).

    The axes are columns: along the limb, out of the opening, towards the upper wall.
    """
    upper, fore = cuffs
    at_shoulder = np.array(upper.limb_place)
    angle = seated_elbow_angle(wearer, tissue, fore, exo_angle)
    elbow = upper_arm_point(wearer, ELBOW)
    offset = forearm_cuff_centre(fore, exo_angle) - elbow[[0, 2]]
    local = np.array([offset @ _direction(angle), offset @ _direction(angle + np.pi / 2)])
    centre = np.array([local[0], fore.limb_place[1] - elbow[1], local[1]])
    turn = exo_angle - angle
    tilted = np.array(
        [[np.cos(turn), 0.0, -np.sin(turn)], [0.0, 1.0, 0.0], [np.sin(turn), 0.0, np.cos(turn)]]
    )
    return [(at_shoulder, np.eye(3)), (centre, tilted)]


def _direction(angle: float) -> np.ndarray:
    """Return the unit vector in the flexion plane (along, across the arm) at a flexion, rad."""
    return np.array([np.cos(angle), np.sin(angle)])
