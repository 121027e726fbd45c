"""Which joint an assessment moves: the elbow of the paper's section 2.3, or one of the shoulder's.

Human and exoskeleton share their joints by number: abduction and J1, flexion and J2, rotation and
J3, elbow flexion and J4.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple


class Target(NamedTuple):
    """One kind of assessment."""

    name: str
    #: Number of the joint, 0 to 3.
    joint: int
    #: Which way the joint moves: +1 or -1.
    direction: float
    #: Its movement as a share of the elbow's.
    reach: float
    #: Which muscles co-contract (`sim.body.muscles.authors.CO_CONTRACTING`), and at which share of
    #: the activation that the conditions name: the shoulder's muscles are far stronger than the
    #: robot's soft controller can hold at 0.4.
    muscles: str
    contraction: float


ELBOW_TARGET = Target("elbow", 3, -1.0, 1.0, "elbow", 1.0)
#: Nominally an activation of 0.1.
SHOULDER_CONTRACTION = 0.25
TARGETS: Mapping[str, Target] = MappingProxyType(
    {
        target.name: target
        for target in (
            ELBOW_TARGET,
            Target("shoulder_flexion", 1, 1.0, 0.5, "shoulder", SHOULDER_CONTRACTION),
            Target("shoulder_abduction", 0, 1.0, 0.5, "shoulder", SHOULDER_CONTRACTION),
            Target("shoulder_rotation", 2, 1.0, 0.6, "shoulder", SHOULDER_CONTRACTION),
        )
    }
)
