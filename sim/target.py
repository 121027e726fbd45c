"""Which joint an assessment moves: the elbow of the paper's section 2.3, or one of the shoulder's.

Human and exoskeleton share their joints by number: abduction and J1, flexion and J2, rotation and
J3, elbow flexion and J4.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import Rotation

from sim.muscles import ELBOW_EXTENSORS, ELBOW_FLEXORS, SHOULDER_MUSCLES, Muscle


@dataclass(frozen=True, kw_only=True)
class Target:
    """One kind of assessment."""

    name: str
    #: Number of the joint, 0 to 3.
    joint: int
    #: Where J1 to J4 are when the movement begins, degrees.
    start_deg: tuple[float, float, float, float]
    #: Which way the joint moves: +1 or -1.
    direction: float
    #: Its movement as a share of the elbow's.
    reach: float
    #: What co-contracts, and at which share of the activation that the conditions name: the
    #: shoulder's muscles are far stronger than the robot's soft controller can hold at 0.4.
    muscles: tuple[Muscle, ...]
    contraction: float

    @property
    def start(self) -> np.ndarray:
        """Exoskeleton angles J1 to J4 at the start, rad, shape (4,)."""
        return np.radians(self.start_deg)

    @property
    def human_shoulder(self) -> np.ndarray:
        """Human abduction, flexion and rotation that align the humerus at the start, rad, (3,).

        The exoskeleton turns about forward, left and the arm's own axis in turn; the human joints
        turn about left, up and the arm's own axis.
        """
        j1, j2, j3, _ = self.start
        orientation = Rotation.from_euler("XYX", [j1, j2 + np.pi / 2, j3])
        flexion, abduction, rotation = orientation.as_euler("YZX")
        return np.array([abduction, flexion - np.pi / 2, rotation])


#: Nominally an activation of 0.1.
SHOULDER_CONTRACTION = 0.25
_ELBOW_MUSCLES = ELBOW_FLEXORS + ELBOW_EXTENSORS
ELBOW_TARGET = Target(
    name="elbow",
    joint=3,
    start_deg=(0.0, -90.0, 0.0, 110.0),
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
                start_deg=(0.0, -80.0, 0.0, 90.0),
                direction=1.0,
                reach=0.5,
                muscles=SHOULDER_MUSCLES,
                contraction=SHOULDER_CONTRACTION,
            ),
            Target(
                name="shoulder_abduction",
                joint=0,
                start_deg=(-65.0, -15.0, 0.0, 90.0),
                direction=1.0,
                reach=0.5,
                muscles=SHOULDER_MUSCLES,
                contraction=SHOULDER_CONTRACTION,
            ),
            Target(
                name="shoulder_rotation",
                joint=2,
                start_deg=(0.0, -80.0, -60.0, 90.0),
                direction=1.0,
                reach=0.6,
                muscles=SHOULDER_MUSCLES,
                contraction=SHOULDER_CONTRACTION,
            ),
        )
    }
)
