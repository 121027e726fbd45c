"""Whether what a robot recorded can be what its sensors saw: readings that no bank has.

Each is looked at by itself, before the recording is compared with the bank's as a whole: a posture
or a coarse torque misleads by more than it is strange. Rounding errs as a uniform distribution
(Widrow and Kollar 2008, Quantization noise, section 1.3).
"""

import numpy as np

from sim.assessment.summary import AFTER, BEFORE, Motion, half_way
from sim.parameters.target import ELBOW_TARGET
from sim.robot.device import Device

#: No robot's angle, velocity or torque is larger, in rad, rad/s and Nm.
LARGEST = 1e6
#: How far held joints are from where an assessment holds them at most, rad. Ours: half as much
#: again as in 45 wearers of the population (seed 99), whose weight moves them by up to 0.04.
POSTURE = 0.06


def impossible(motion: Motion) -> str | None:
    """Return why no sensor can have read this, or None."""
    for name in ("theta", "velocity", "torque"):
        if np.abs(getattr(motion, name)).max() > LARGEST:
            return f"{name} has values above {LARGEST:g}: angles are in rad, torques in Nm"
    joint = motion.joint
    torque = motion.torque[:, joint]
    if np.ptp(torque) == 0.0:
        return (
            f"the torque of the moved joint is {torque[0] + 0.0:g} Nm in every sample: it was not "
            "recorded"
        )
    return None


def posture(motion: Motion, device: Device) -> str | None:
    """Return which joint is held elsewhere than in an assessment of the elbow, or None."""
    middle = half_way(motion.time, motion.theta[:, motion.joint])
    during = (motion.time > middle - BEFORE) & (motion.time < middle + AFTER)
    away = motion.theta[during].mean(axis=0) - device.start(ELBOW_TARGET.name).angles
    away[motion.joint] = 0.0
    worst = int(np.argmax(np.abs(away)))
    if abs(away[worst]) <= POSTURE:
        return None
    return (
        f"{device.joints[worst]} is {away[worst]:+.2f} rad from where it is held in the bank's "
        f"recordings ({POSTURE:g} rad at most)"
    )


def coarse(motion: Motion, device: Device, allowed: float) -> str | None:
    """Return whose torque is recorded in too large steps, or None.

    Args:
        motion: what was recorded.
        device: whose.
        allowed: standard deviation that rounding may add, Nm.
    """
    for name, torque in zip(device.joints, motion.torque.T, strict=True):
        apart = np.diff(np.unique(torque))
        if len(apart) and apart.min() / np.sqrt(12.0) > allowed:
            return (
                f"the torque of {name} is recorded in steps of {apart.min():.2g} Nm: the zero "
                f"error that the bank's have ({allowed:g} Nm) allows {allowed * 12**0.5:.2g}"
            )
    return None
