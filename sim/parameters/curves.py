"""Curves that an assessment gives if it is asked to."""

from collections.abc import Mapping
from types import MappingProxyType

from models.curves import Curve

#: Over the share of the movement's time that has passed, in percent steps: the human torque that is
#: inferred from the motor's (paper, equation 20), by how much the robot's angle exceeds the human
#: joint's, and the larger of the resultant forces on both limbs.
OVER_PHASE: Mapping[str, Curve] = MappingProxyType(
    {
        name: Curve(points=101, over="phase")
        for name in ("torque_over_phase", "angle_error_over_phase", "contact_force_over_phase")
    }
)
#: Their units.
UNITS = MappingProxyType(dict(zip(OVER_PHASE, ("Nm", "rad", "N"), strict=True)))
