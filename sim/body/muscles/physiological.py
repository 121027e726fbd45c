"""Elbow muscles of ours: the authors' with a triceps that passes round the elbow and slack fibres.

In the authors' model the heads of the triceps are straight lines, whose lever falls from 31 mm to
nothing between 30 and 130 degrees of flexion, so that extension peaks 25 degrees before the
measured torques. Here they pass two points of the humerus and wrap round a cylinder, as in Holzbaur
et al. 2005, and relaxed muscles are slacker. `python -m benchmarks.simulation.muscles` fits every
constant that is called fitted, and shows the fit on data that it did not see.
"""

from dataclasses import replace

from sim.body.muscles.authors import ELBOW_EXTENSORS, ELBOW_FLEXORS
from sim.body.muscles.holzbaur import LONGEST_ACTIVE, PASSIVE_FORCE, SHORTEST_ACTIVE
from sim.body.muscles.muscle import ElbowMuscles, Muscle, MuscleGroup, Wrap
from sim.body.muscles.places import near_elbow

#: The cylinder round which heads wrap. Its radius is Holzbaur's; the centre lies 8 mm proximal to
#: theirs and 3 mm behind: fitted to the levers of Pigeon et al. 1996.
TROCHLEA = Wrap(
    name="trochlea",
    centre=near_elbow(-0.0069, 0.0054, -0.0067),
    radius=0.016,
    side=(-1.0, -2.0),
    part=2,
)
#: The heads' common way: two points behind the humerus, then the olecranon (Holzbaur et al. 2005).
_WAY = (
    near_elbow(-0.0640, 0.0001, -0.0379),
    near_elbow(-0.0228, 0.0002, -0.0235),
    ("ulna", (-0.0105, -0.0008, -0.0219)),
)
#: How far the heads are stretched from 0 to 120 degrees at the nominal wearer, m, and their optimal
#: fibre lengths (Holzbaur et al. 2005, table 1, m).
EXCURSION = 0.0442
FIBRE_LENGTHS = {"triceps_long": 0.1340, "triceps_medial": 0.1138, "triceps_lateral": 0.1138}
#: Fitted to Buchanan et al. 1998: optimal lengths of the heads at full extension.
SHORTEST = 0.598


def round_the_elbow(
    muscle: Muscle, trochlea: Wrap = TROCHLEA, shortest: float = SHORTEST
) -> Muscle:
    """Return a head of the triceps with its way round the elbow; another extensor as it is.

    Fibres take the whole stretch: tendons are rigid.
    """
    if muscle.name not in FIBRE_LENGTHS:
        return muscle
    (origin,) = (point for point in muscle.path if point[0] != "ulna")
    longest = shortest + EXCURSION / FIBRE_LENGTHS[muscle.name]
    return replace(muscle, path=(origin, *_WAY), operating_range=(shortest, longest), wrap=trochlea)


#: Fitted to Buchanan et al. 1998.
FLEXORS_SCALE, EXTENSORS_SCALE = 0.706, 1.318
PHYSIOLOGICAL_MUSCLES = ElbowMuscles(
    flexors=MuscleGroup(
        muscles=ELBOW_FLEXORS,
        force_scale=FLEXORS_SCALE,
        operating_range=(0.95, 1.2),
        shortest_active=SHORTEST_ACTIVE,
        longest_active=LONGEST_ACTIVE,
        passive_force=PASSIVE_FORCE,
    ),
    extensors=MuscleGroup(
        muscles=tuple(round_the_elbow(muscle) for muscle in ELBOW_EXTENSORS),
        force_scale=EXTENSORS_SCALE,
        operating_range=(0.7, 0.9),
        shortest_active=SHORTEST_ACTIVE,
        longest_active=LONGEST_ACTIVE,
        passive_force=PASSIVE_FORCE,
    ),
)
