"""Which joint an assessment moves: the elbow of the paper's section 2.3, or one of the shoulder's.

Human and exoskeleton share their joints by number: abduction and J1, flexion and J2, rotation and
J3, elbow flexion and J4.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from sim.body.muscle_tables import ELBOW_EXTENSORS, ELBOW_FLEXORS, SHOULDER_MUSCLES, Muscle


@dataclass(frozen=True, kw_only=True)
class Target:
    """One kind of assessment."""

    name: str
    #: Number of the joint, 0 to 3.
    joint: int
    #: Which way the joint moves: +1 or -1.
    direction: float
    #: Its movement as a share of the elbow's.
    reach: float
    #: What co-contracts, and at which share of the activation that the conditions name: the
    #: shoulder's muscles are far stronger than the robot's soft controller can hold at 0.4.
    muscles: tuple[Muscle, ...]
    contraction: float


#: Nominally an activation of 0.1.
SHOULDER_CONTRACTION = 0.25
_ELBOW_MUSCLES = ELBOW_FLEXORS + ELBOW_EXTENSORS
ELBOW_TARGET = Target(
    name="elbow",
    joint=3,
    direction=-1.0,
    reach=1.0,
    muscles=_ELBOW_MUSCLES,
    contraction=1.0,
)
TARGETS: Mapping[str, Target] = MappingProxyType(
    {
        target.name: target
        for target in (
            ELBOW_TARGET,
            Target(
                name="shoulder_flexion",
                joint=1,
                direction=1.0,
                reach=0.5,
                muscles=SHOULDER_MUSCLES,
                contraction=SHOULDER_CONTRACTION,
            ),
            Target(
                name="shoulder_abduction",
                joint=0,
                direction=1.0,
                reach=0.5,
                muscles=SHOULDER_MUSCLES,
                contraction=SHOULDER_CONTRACTION,
            ),
            Target(
                name="shoulder_rotation",
                joint=2,
                direction=1.0,
                reach=0.6,
                muscles=SHOULDER_MUSCLES,
                contraction=SHOULDER_CONTRACTION,
            ),
        )
    }
)
