"""The elbow's muscles, fitted twice to the isometric torques of Amis et al. 1980 and Buchanan et
al. 1998: by the authors, and anew (the default), with a triceps that passes round the elbow.

In the authors' model the heads of the triceps are straight lines, whose lever falls from 31 mm to
nothing between 30 and 130 degrees of flexion, so that extension peaks 25 degrees before the
measured torques. Refitted, they pass two points of the humerus and wrap round a cylinder, as in
Holzbaur et al. 2005 (points from MyoSuite's copy, github MyoHub/myo_sim), and relaxed muscles are
slacker. Both then peak where measured torques do. `docs/understand/muscles.md` has the two side by
side.
"""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from sim.body.muscles.holzbaur import ELBOW_EXTENSORS, ELBOW_FLEXORS
from sim.body.muscles.muscle import ElbowMuscles, Muscle, MuscleGroup, Point
from sim.body.skeleton import ELBOW, HUMERUS_SHRINK


def _near_elbow(distal: float, medial: float, anterior: float) -> Point:
    """Return a point of the humerus, m from the elbow of the nominal wearer.

    The authors shrink the humerus so that the elbow lies on the robot's axis; that moves the elbow,
    but makes it no thinner.
    """
    x, y, z = ELBOW + np.array([distal, medial, anterior]) / HUMERUS_SHRINK
    return "humerus", (float(x), float(y), float(z))


#: The cylinder round which heads wrap: its centre, and its radius at the nominal wearer, m. The
#: radius is Holzbaur's; the centre lies 4 mm proximal to theirs and 2 mm behind, where the lever
#: falls with flexion as it does in cadavers (Pigeon et al. 1996: from 50 degrees on within 1.2 mm).
TROCHLEA = _near_elbow(-0.0029, 0.0054, -0.0052)
TROCHLEA_RADIUS = 0.016
#: The side of it that they pass: a point of the humerus, in radii from its centre.
TROCHLEA_SIDE = np.array([-1.0, 0.0, -2.0])
#: The heads' common way: two points behind the humerus, then the olecranon.
_WAY = (
    _near_elbow(-0.0640, 0.0001, -0.0379),
    _near_elbow(-0.0228, 0.0002, -0.0235),
    ("ulna", (-0.0105, -0.0008, -0.0219)),
)
#: How far the heads are stretched from 0 to 120 degrees at the nominal wearer, m, and their optimal
#: fibre lengths (Holzbaur et al. 2005, table 1, m).
EXCURSION = 0.0443
FIBRE_LENGTHS = {"triceps_long": 0.1340, "triceps_medial": 0.1138, "triceps_lateral": 0.1138}
#: Fitted anew: optimal lengths of the heads at full extension, and the share of a stretch that
#: fibres take; their tendons take the rest.
_SHORTEST, _FIBRE_SHARE = 0.52, 0.85


def _round_the_elbow(muscle: Muscle) -> Muscle:
    """Return a head of the triceps with its way round the elbow; another extensor as it is."""
    if muscle.name not in FIBRE_LENGTHS:
        return muscle
    (origin,) = (point for point in muscle.path if point[0] != "ulna")
    longest = _SHORTEST + _FIBRE_SHARE * EXCURSION / FIBRE_LENGTHS[muscle.name]
    return replace(muscle, path=(origin, *_WAY), operating_range=(_SHORTEST, longest), wraps=True)


#: The authors' fit.
PAPER_MUSCLES = ElbowMuscles(
    flexors=MuscleGroup(muscles=ELBOW_FLEXORS, force_scale=0.71, operating_range=(0.95, 1.2)),
    extensors=MuscleGroup(muscles=ELBOW_EXTENSORS, force_scale=1.23, operating_range=(0.7, 0.9)),
)
#: Fitted anew to both peaks. Active force vanishes between MuJoCo's half of the optimal length and
#: the zero that makes its curve the Gaussian of Thelen 2003; with this passive force a relaxed
#: elbow has the stiffness that Wiegner and Watts 1986 measured, 0.4 to 1.8 Nm/rad.
REFITTED_MUSCLES = ElbowMuscles(
    flexors=MuscleGroup(
        muscles=ELBOW_FLEXORS,
        force_scale=0.749,
        operating_range=(0.95, 1.2),
        shortest_active=0.25,
        passive_force=0.25,
    ),
    extensors=MuscleGroup(
        muscles=tuple(_round_the_elbow(muscle) for muscle in ELBOW_EXTENSORS),
        force_scale=1.436,
        operating_range=(0.7, 0.9),
        shortest_active=0.25,
        passive_force=0.25,
    ),
)
#: Every fit by the name under which it can be chosen.
ELBOW_FITS: Mapping[str, ElbowMuscles] = MappingProxyType(
    {"paper": PAPER_MUSCLES, "refitted": REFITTED_MUSCLES}
)
