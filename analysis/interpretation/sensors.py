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
#: A joint that moves by more than this has a velocity, rad: no encoder's last digit is as large.
MOVES = 0.005
#: How far held joints are from where an assessment of the elbow in the NESM holds them, rad: in 120
#: wearers of the population (seed 99) and 14 with contact their weight moves them one way.
STRAYS = {"J1": (-0.034, 0.0), "J2": (0.0, 0.046), "J3": (-0.034, 0.0)}
#: What else they may stray, rad; ours.
MARGIN = 0.01


def impossible(motion: Motion) -> str | None:
    """Return why no sensor can have read this, or None."""
    for name in ("theta", "velocity", "torque"):
        if np.abs(getattr(motion, name)).max() > LARGEST:
            return f"{name} has values above {LARGEST:g}: angles are in rad, torques in Nm"
    if dead := [
        f"J{number + 1}"
        for number, (angle, velocity) in enumerate(
            zip(motion.theta.T, motion.velocity.T, strict=True)
        )
        if np.ptp(velocity) == 0.0 and np.ptp(angle) > MOVES
    ]:
        return (
            f"the velocity of {', '.join(dead)} is the same in every sample although the angle "
            "changes: it was not recorded"
        )
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
    for name, by in zip(device.joints, away, strict=True):
        low, high = STRAYS.get(name, (-np.inf, np.inf))
        if not low - MARGIN <= by <= high + MARGIN:
            return (
                f"{name} is {by:+.3f} rad from where an assessment holds it, and the bank's "
                f"recordings {low - MARGIN:+.3f} to {high + MARGIN:+.3f}"
            )
    return None


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
