"""Places of Holzbaur et al. 2005 on our bones.

Their frames hang down: x forward, y up the bone, z to the right. Ours run along the bone. The
authors shorten the humerus until the elbow lies on the robot's axis; that brings the elbow nearer
to the shoulder, but makes it no thinner.
"""

import numpy as np

from sim.body.muscles.muscle import Point
from sim.body.skeleton import ELBOW, HUMERUS_SHRINK, RADIUS

#: The published elbow in the published humerus, m.
_PUBLISHED_ELBOW = np.array([0.0061, -0.2904, -0.0123])


def near_elbow(distal: float, medial: float, anterior: float) -> Point:
    """Return a point of the humerus, m from the elbow of the nominal wearer."""
    x, y, z = ELBOW + np.array([distal, medial, anterior]) / HUMERUS_SHRINK
    return "humerus", (float(x), float(y), float(z))


def on_humerus(x: float, y: float, z: float) -> Point:
    """Return a point of the published humerus, m: as far down the bone, and as far from its line
    from shoulder to elbow."""
    share = y / _PUBLISHED_ELBOW[1]
    off = (np.array([x, y, z]) - share * _PUBLISHED_ELBOW) / HUMERUS_SHRINK
    place = share * ELBOW + np.array([0.0, -off[2], off[0]])
    return "humerus", (float(place[0]), float(place[1]), float(place[2]))


def by_elbow(x: float, y: float, z: float) -> Point:
    """Return a point of the published humerus near its elbow, m: as far from that."""
    forward, up, right = np.array([x, y, z]) - _PUBLISHED_ELBOW
    return near_elbow(-up, -right, forward)


def on_forearm(bone: str, x: float, y: float, z: float) -> Point:
    """Return a point of the published ulna, m, on our `bone`: "ulna" or "radius"."""
    place = np.array([-y, -z, x]) - (RADIUS if bone == "radius" else 0.0)
    return bone, (float(place[0]), float(place[1]), float(place[2]))
