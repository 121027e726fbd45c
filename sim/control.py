"""The reference movement and the exoskeleton's controller (paper, section 2.3, equation 19)."""

from dataclasses import dataclass
from math import radians

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Gains:
    """Gains of every motor: kp in Nm/rad, kv in Nm s/rad, ki in Nm/(rad s)."""

    kp: float
    kv: float
    ki: float


#: The authors' code. With equation 19 alone the loaded shoulder sags by more than 20 degrees.
PID = Gains(kp=50.0, kv=15.0, ki=25.0)
#: Paper, equation 19 and the gains below it.
PD = Gains(kp=50.0, kv=15.0, ki=0.0)
CONTROLLERS = {"pid": PID, "pd": PD}

#: Start of an elbow assessment: J1 to J4, rad (authors' code).
START = np.radians([0.0, -90.0, 0.0, 110.0])
#: Share of the start angle that the movement covers is 1/1.1 (authors' code).
AMPLITUDE = radians(110.0) / 1.1
#: Rate and centre of the sigmoid, 1/s and s.
RATE, CENTRE = 2.0, 2.5
#: Duration of the movement, s.
DURATION = 6.0


def elbow_reference(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the elbow's desired angle (rad) and velocity (rad/s): a sigmoid extension from START.

    Args:
        time: seconds since the movement began, shape (n,).

    Returns:
        Two arrays of shape (n,). The angle is exactly START at time 0.
    """
    sigmoid = 1.0 / (1.0 + np.exp(-RATE * (time - CENTRE)))
    offset = 1.0 / (1.0 + np.exp(RATE * CENTRE))
    angle = START[3] - AMPLITUDE * (sigmoid - offset)
    velocity = -AMPLITUDE * RATE * sigmoid * (1.0 - sigmoid)
    return angle, velocity
