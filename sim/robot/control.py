"""The reference movement and the exoskeleton's controller (paper, section 2.3, equation 19)."""

from dataclasses import dataclass

import numpy as np

from sim.parameters.conditions import Conditions


@dataclass(frozen=True, kw_only=True)
class Gains:
    """Gains of every motor: kp in Nm/rad, kv in Nm s/rad, ki in Nm/(rad s)."""

    kp: float
    kv: float
    ki: float

    def under(self, conditions: Conditions) -> "Gains":
        """Return a device's gains times what `conditions` multiply them by."""
        return Gains(
            kp=conditions.proportional_gain * self.kp,
            kv=conditions.derivative_gain * self.kv,
            ki=conditions.integral_gain * self.ki,
        )


#: "pid": the device's own gains. "pd": without the integral, equation 19 to the letter.
CONTROLLERS = ("pid", "pd")

#: Centre of the sigmoid, s; its amplitude and rate are conditions of an assessment.
CENTRE = 2.5
#: Duration of the movement, s.
DURATION = 6.0


def extension_reference(
    time: np.ndarray, *, start: float, amplitude: float, rate: float, direction: float = -1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return the moved joint's desired angle (rad) and velocity (rad/s): a sigmoid from `start`.

    Args:
        time: seconds since the movement began, shape (n,).
        start: angle at time 0, rad.
        amplitude: how far the angle moves in the end, rad (authors' code: 1/1.1 of the elbow's
            start).
        rate: of the sigmoid, 1/s (authors' code: 2).
        direction: +1 or -1; the elbow extends.

    Returns:
        Two arrays of shape (n,).
    """
    sigmoid = 1.0 / (1.0 + np.exp(-rate * (time - CENTRE)))
    offset = 1.0 / (1.0 + np.exp(rate * CENTRE))
    angle = start + direction * amplitude * (sigmoid - offset)
    velocity = direction * amplitude * rate * sigmoid * (1.0 - sigmoid)
    return angle, velocity
