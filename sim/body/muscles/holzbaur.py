"""The elbow's muscles as Holzbaur et al. 2005 published them: paths, wrapping, fibres, peak forces.

Figures are those of OpenSim's Arm26 and, for brachioradialis and anconeus, of MyoSuite's copy
(github opensim-org/opensim-models, MyoHub/myo_sim). Nothing is fitted. What cannot be the same
here: the authors' shorter humerus; the elbow's axis, which they tilt by 3.5 degrees; tendons are
rigid; MuJoCo's curves of force over length, nearest to theirs; the two ellipsoids at the elbow are
cylinders of the radius that MyoSuite gives their spheres. Lengths of paths are those of MyoSuite's
copy with the elbow straight and the shoulder flexed to 90 degrees, the scapula turning with it.
"""

from math import cos, radians

from sim.body.muscles.authors import ELBOW_FLEXORS
from sim.body.muscles.muscle import ElbowMuscles, Fibres, Muscle, MuscleGroup, Point, Wrap
from sim.body.muscles.places import by_elbow, on_forearm, on_humerus

#: Where the published cylinders and ellipsoids at the elbow are: behind it and in front.
_TRICEPS, _BICEPS, _ANCONEUS = (
    by_elbow(0.0028, -0.2919, -0.0069),
    by_elbow(0.0019, -0.2890, -0.0140),
    by_elbow(0.0134, -0.2861, -0.0008),
)
_BEHIND, _BEFORE = (-1.0, -2.0), (-1.0, 2.0)
#: Origins on the scapula are the authors', which follow the same source.
_SCAPULA = {muscle.name: muscle.path[0] for muscle in ELBOW_FLEXORS[:2]}
_LONG_HEAD: Point = ("scapula", (0.03083, 0.02581, -0.04169))

_BEHIND_HUMERUS = (
    on_humerus(-0.03184, -0.22637, -0.01217),
    by_elbow(-0.01743, -0.26757, -0.01208),
)
_OLECRANON = on_forearm("ulna", -0.0219, 0.01046, -0.00078)
#: The biceps' way round the radius, pronation neutral.
_TUBEROSITY = on_forearm("radius", -0.0016, -0.0490, 0.0180)


def _muscle(
    name: str,
    force: float,
    fibres: tuple[float, float, float],
    path: tuple[Point, ...],
    wrap: tuple[Point, float, tuple[float, float], int],
    pennation: float = 0.0,
) -> Muscle:
    """Return a muscle: `pennation` in degrees takes its share of the force."""
    centre, radius, side, part = wrap
    optimal, slack, extended = fibres
    return Muscle(
        name=name,
        force=force * cos(radians(pennation)),
        path=path,
        fibres=Fibres(optimal=optimal, slack=slack, extended=extended),
        wrap=Wrap(name=f"{name}_wrap", centre=centre, radius=radius, side=side, part=part),
    )


def _head(
    name: str,
    force: float,
    fibres: tuple[float, float, float],
    origin: tuple[Point, ...],
    pennation: float,
) -> Muscle:
    path = (*origin, *_BEHIND_HUMERUS, _OLECRANON)
    return _muscle(name, force, fibres, path, (_TRICEPS, 0.016, _BEHIND, len(path) - 2), pennation)


#: Parameters of MuJoCo's curves that come nearest to the published ones (Thelen 2003, Gaussian of
#: width 0.5 and exponential of strain 0.6), 0.039 rms from half to 1.6 optimal lengths.
SHORTEST_ACTIVE, LONGEST_ACTIVE, PASSIVE_FORCE = -0.09, 2.13, 1.37

HOLZBAUR_MUSCLES = ElbowMuscles(
    flexors=MuscleGroup(
        shortest_active=SHORTEST_ACTIVE,
        longest_active=LONGEST_ACTIVE,
        passive_force=PASSIVE_FORCE,
        muscles=(
            _muscle(
                "biceps_long",
                624.3,
                (0.1157, 0.2723, 0.4269),
                (
                    _SCAPULA["biceps_long"],
                    on_humerus(0.02131, 0.01793, 0.01028),
                    on_humerus(0.02378, -0.00511, 0.01201),
                    on_humerus(0.01345, -0.02827, 0.00136),
                    on_humerus(0.01068, -0.07736, -0.00165),
                    on_humerus(0.01703, -0.12125, 0.00024),
                    on_humerus(0.0228, -0.1754, -0.0063),
                    on_forearm("radius", -0.00630, -0.04066, 0.00727),
                    _TUBEROSITY,
                ),
                (_BICEPS, 0.015, _BEFORE, 6),
            ),
            _muscle(
                "biceps_short",
                435.56,
                (0.1321, 0.1923, 0.3723),
                (
                    _SCAPULA["biceps_short"],
                    on_humerus(0.01117, -0.07576, -0.01101),
                    on_humerus(0.01703, -0.12125, -0.01079),
                    on_humerus(0.0228, -0.1754, -0.0063),
                    on_forearm("radius", -0.00734, -0.03706, 0.00689),
                    _TUBEROSITY,
                ),
                (_BICEPS, 0.015, _BEFORE, 3),
            ),
            _muscle(
                "brachialis",
                987.26,
                (0.0858, 0.0535, 0.1471),
                (
                    on_humerus(0.0068, -0.1739, -0.0036),
                    on_forearm("ulna", -0.0032, -0.0239, 0.0009),
                ),
                (_TRICEPS, 0.016, _BEFORE, 0),
            ),
            _muscle(
                "brachioradialis",
                261.33,
                (0.1726, 0.1330, 0.3322),
                (
                    on_humerus(-0.0098, -0.19963, 0.00223),
                    on_forearm("radius", 0.03617, -0.13892, 0.04315),
                    on_forearm("radius", 0.0423, -0.2325, 0.0424),
                ),
                (_BICEPS, 0.015, _BEFORE, 0),
            ),
        ),
    ),
    extensors=MuscleGroup(
        shortest_active=SHORTEST_ACTIVE,
        longest_active=LONGEST_ACTIVE,
        passive_force=PASSIVE_FORCE,
        muscles=(
            _head(
                "triceps_long",
                798.52,
                (0.1340, 0.1430, 0.3167),
                (_LONG_HEAD, on_humerus(-0.02714, -0.11441, -0.00664)),
                12.0,
            ),
            _head(
                "triceps_medial",
                624.3,
                (0.1138, 0.0908, 0.1542),
                (
                    on_humerus(-0.00838, -0.13695, -0.00906),
                    on_humerus(-0.02601, -0.15139, -0.0108),
                ),
                9.0,
            ),
            _head(
                "triceps_lateral",
                624.3,
                (0.1138, 0.0980, 0.1666),
                (
                    on_humerus(-0.00599, -0.12646, 0.00428),
                    on_humerus(-0.02344, -0.14528, 0.00928),
                ),
                9.0,
            ),
            _muscle(
                "anconeus",
                350.0,
                (0.0270, 0.0180, 0.0215),
                (
                    by_elbow(-0.00744, -0.28359, 0.00979),
                    on_forearm("ulna", -0.02532, -0.00124, 0.006),
                ),
                (_ANCONEUS, 0.020, _BEHIND, 0),
            ),
        ),
    ),
)
