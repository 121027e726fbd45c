"""The triceps as it passes the elbow: round the trochlea, not through it.

In the authors' model its heads are straight lines, whose lever falls from 31 mm to nothing between
30 and 130 degrees of flexion, where measured levers stay at 16 to 25 mm (Pigeon et al. 1996). Here
the heads pass the humerus at two points and wrap round a cylinder, as in the model of Holzbaur et
al. 2005, from which the figures are (MyoSuite's copy, github MyoHub/myo_sim). It is off by default,
because the paper's stiffness depends on those lines: `docs/simulation.md` says by how much.
"""

from dataclasses import replace

import mujoco
import numpy as np

from sim.muscles import ELBOW_EXTENSORS, Muscle, Point, on_wearer
from sim.skeleton import ELBOW, HUMERUS_SHRINK
from sim.wearer import Wearer


def _near_elbow(distal: float, medial: float, anterior: float) -> Point:
    """Return a point of the humerus, m from the elbow of the nominal wearer.

    The authors shrink the humerus so that the elbow lies on the robot's axis; that moves the elbow,
    but makes it no thinner.
    """
    x, y, z = ELBOW + np.array([distal, medial, anterior]) / HUMERUS_SHRINK
    return "humerus", (float(x), float(y), float(z))


#: The cylinder: centre, and radius at the nominal wearer, m.
TROCHLEA = _near_elbow(0.0015, 0.0054, -0.0033)
TROCHLEA_RADIUS = 0.016
#: The three heads' common way: two points behind the humerus, then the olecranon.
WAY = (
    _near_elbow(-0.0640, 0.0001, -0.0379),
    _near_elbow(-0.0228, 0.0002, -0.0235),
    ("ulna", (-0.0105, -0.0008, -0.0219)),
)
#: How far the heads are stretched from 0 to 120 degrees at the nominal wearer, m: in units of their
#: optimal fibre lengths (Holzbaur et al. 2005, table 1, m) the width of their operating ranges.
EXCURSION = 0.045
FIBRE_LENGTHS = {"triceps_long": 0.1340, "triceps_medial": 0.1138, "triceps_lateral": 0.1138}
#: Optimal lengths at full extension, and the scaling of the group's peak force: the two figures
#: fitted to the isometric tests of Amis et al. 1980 and Buchanan et al. 1998.
SHORTEST, FORCE_SCALE = 0.66, 1.17


def _wrapped(muscle: Muscle) -> Muscle:
    """Return a head of the triceps with its true way; another extensor as it is."""
    if muscle.name not in FIBRE_LENGTHS:
        return muscle
    (origin,) = (point for point in muscle.path if point[0] != "ulna")
    longest = SHORTEST + EXCURSION / FIBRE_LENGTHS[muscle.name]
    return replace(muscle, path=(origin, *WAY), operating_range=(SHORTEST, longest), wraps=True)


WRAPPED_EXTENSORS = tuple(_wrapped(muscle) for muscle in ELBOW_EXTENSORS)


def add_trochlea(spec: mujoco.MjSpec, wearer: Wearer) -> None:
    """Add the cylinder that the heads wrap round, and a site on the side they pass."""
    bone, place = TROCHLEA
    humerus, centre = spec.body(bone), on_wearer(bone, place, wearer)
    radius = TROCHLEA_RADIUS * wearer.upper_arm_scale
    geom = humerus.add_geom(
        name="trochlea",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[radius, radius, 0],
        pos=centre,
        # Along the elbow's axis, across the arm.
        quat=[0.7071067811865476, 0.7071067811865476, 0.0, 0.0],
        rgba=[0.93, 0.9, 0.84, 1.0],
    )
    geom.contype = geom.conaffinity = 0
    geom.mass = 0.0
    behind = radius * np.array([-1.0, 0.0, -2.0])
    humerus.add_site(name="behind_trochlea", pos=centre + behind, size=[0.002] * 3)
