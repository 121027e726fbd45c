"""Whether what a robot recorded can be what its sensors saw: readings that no bank has.

Each is looked at by itself, before the recording is compared with the bank's as a whole: a posture
or a coarse torque misleads by more than it is strange. Single samples are compared with the median
of their neighbours (Hampel 1974, The influence curve and its role in robust estimation).
"""

from dataclasses import replace

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import median_filter, percentile_filter

from analysis.closeloop.session.device import MAX_HINGE
from analysis.closeloop.session.runs import saturated_line
from analysis.interpretation.bank.population import Population
from sim.assessment.summary import AFTER, BEFORE, Motion, half_way
from sim.parameters.target import ELBOW_TARGET
from sim.robot.device import Device

#: No robot's angle, velocity or torque is larger, in rad, rad/s and Nm.
LARGEST = 1e6
#: No torque is as many times what a joint's motor can give: a stop or a push may be recorded, too,
#: which is a few times that; Ncm and mNm taken for Nm are 100 and 1000 times too large.
BEYOND_MOTOR = 10.0
#: A joint that moves by more than this has a velocity, rad: no encoder's last digit is as large.
MOVES = 0.005
#: Decimals of a torque in Nm that count as a step of it: the rest is how numbers are written.
DECIMALS = 5
#: Samples around one among which it may be a spike, and of which it is known how far MOST_OF them
#: (in %) are off at most; how many times that a spike is off: ours, set while looking at the
#: recordings of `STRAYS`.
SPAN, NEARBY, FAR, MOST_OF = 5, 51, 8.0, 80
#: Fields of a motion, words for them, and what one sample may always be off, rad, rad/s and Nm.
SPIKES = (
    ("theta", "angle", 0.02),
    ("velocity", "velocity", 0.2),
    ("torque", "torque", 1.0),
)
#: Factors that multiply the gains of a device's motors.
GAINS = ("proportional_gain", "derivative_gain", "integral_gain")
#: How far held joints are from where an assessment of the elbow in the NESM holds them, rad,
#: without contact and with it, where J1 leans on the end of its range: in 96 (seed 7701) and in 84
#: wearers (seeds 7702 and 7703) of the population their weight moves them one way. The axes of J1
#: and J3 lie along each other there, so that without that stop both move alike.
STRAYS = {
    False: {"J1": (-0.032, 0.0), "J2": (-0.001, 0.046), "J3": (-0.032, 0.0), "apart": (0.0, 0.001)},
    True: {"J1": (-0.01, 0.0), "J2": (-0.001, 0.042), "J3": (-0.033, 0.0), "apart": (0.001, 0.023)},
}
#: What else they may stray, rad; ours, set while looking at these recordings. So much, too, an
#: angle may be off where its motor's torque says that it is held.
MARGIN = 0.01


def impossible(motion: Motion) -> str | None:
    """Return why no sensor can have read this, or None."""
    for name in ("theta", "velocity", "torque"):
        if np.abs(getattr(motion, name)).max() > LARGEST:
            return f"{name} has values above {LARGEST:g}: angles are in rad, torques in Nm"
    farthest = float(np.abs(motion.theta).max())
    if farthest > MAX_HINGE:
        return (
            f"an angle reaches {farthest:g} rad, which no limb does: angles are in radians, and "
            "these look like degrees"
        )
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
    line = saturated_line(torque, motion.theta[:, joint])
    if line is not None:
        return (
            f"the torque of the moved joint is saturated: it stays at {torque[line - 2]:g} Nm "
            "while the joint moves; repeat the movement below the motor's limit"
        )
    return None


def beyond_motor(motion: Motion, device: Device) -> str | None:
    """Return which torque no motor of the device can have given, or None.

    Of a motion without single samples that are far off (`despiked`).
    """
    limits = {motor.target: float(motor.forcerange[1]) for motor in device.spec().actuators}
    largest = dict(zip(device.joints, np.abs(motion.torque).max(axis=0).tolist(), strict=False))
    worst = max(largest, key=lambda name: largest[name] / limits[name])
    if largest[worst] <= BEYOND_MOTOR * limits[worst]:
        return None
    return (
        f"the torque of {worst} reaches {largest[worst]:.0f} Nm, and its motor in the "
        f"{device.name} gives {limits[worst]:g} Nm at most: torques are in Nm"
    )


def posture(motion: Motion, device: Device, *, contact: bool) -> str | None:
    """Return which joint is held elsewhere than in an assessment of the elbow, or None.

    Args:
        motion: what was recorded.
        device: whose.
        contact: whether the bank's recordings have contact.
    """
    middle = half_way(motion.time, motion.theta[:, motion.joint])
    during = (motion.time > middle - BEFORE) & (motion.time < middle + AFTER)
    away = motion.theta[during].mean(axis=0) - device.start(ELBOW_TARGET.name).angles
    strays = dict(zip(device.joints, away.tolist(), strict=True))
    usual = STRAYS[contact]
    for name, by in strays.items():
        low, high = usual.get(name, (-np.inf, np.inf))
        if not low - MARGIN <= by <= high + MARGIN:
            return (
                f"{name} is {by:+.3f} rad from where an assessment holds it, and the bank's "
                f"recordings {low - MARGIN:+.3f} to {high + MARGIN:+.3f}"
            )
    low, high = usual["apart"]
    apart = strays["J1"] - strays["J3"]
    if not low - MARGIN <= apart <= high + MARGIN:
        return (
            f"J1 is {apart:+.3f} rad farther than J3 from where an assessment holds them, and the "
            f"bank's recordings {low - MARGIN:+.3f} to {high + MARGIN:+.3f}: check both encoders"
        )
    return None


def misread(motion: Motion, device: Device, population: Population) -> str | None:
    """Return which held joint is not where its own motor holds it, or None.

    A motor under integral control (Astrom and Hagglund 1995, PID controllers, section 3.2) keeps a
    sum: its torque with its other terms, and its gain times all that the joint was ever off by. An
    angle that is recorded with an offset makes this sum rise, whatever the weight on the joint.

    Args:
        motion: what was recorded.
        device: whose.
        population: which may fix the gains of its motors at others; it says nothing if it draws
            them.
    """
    if set(GAINS) & set(population.names):
        return None
    times = [population.fixed.get(name, 1.0) for name in GAINS]
    kp, kv, ki = np.array(times) * (device.gains.kp, device.gains.kv, device.gains.ki)
    if ki == 0.0:
        return None
    time = motion.time
    middle = half_way(time, motion.theta[:, motion.joint])
    during = (time > middle - BEFORE) & (time < middle + AFTER)
    off = motion.theta - device.start(ELBOW_TARGET.name).angles
    terms = motion.torque + kp * off + kv * motion.velocity
    kept = terms / ki + cumulative_trapezoid(off, time, axis=0, initial=0.0)
    rising = np.polyfit(time[during], kept[during], 1)[0]
    for number, name in enumerate(device.joints):
        if number != motion.joint and abs(rising[number]) > MARGIN:
            return (
                f"{name} is recorded {rising[number]:+.3f} rad from where its motor's torque says "
                f"that it is held ({MARGIN:g} rad at most): check its encoder"
            )
    return None


def steps(motion: Motion) -> np.ndarray:
    """Return in which steps each joint's torque is recorded, Nm, shape (joints,).

    How far half of the samples are from the nearest other value. A torque without another has the
    largest steps of the others: a held joint's may vary by less than a step.
    """
    found = []
    for torque in motion.torque.T:
        values, counts = np.unique(torque.round(DECIMALS), return_counts=True)
        apart = np.concatenate([[np.inf], np.diff(values), [np.inf]])
        nearest = np.minimum(apart[1:], apart[:-1])
        order = np.argsort(nearest)
        half = int(np.searchsorted(np.cumsum(counts[order]), counts.sum() / 2.0))
        found.append(nearest[order][half])
    seen = np.array(found)
    return np.where(np.isinf(seen), np.max(seen, initial=0.0, where=np.isfinite(seen)), seen)


def despiked(motion: Motion) -> tuple[Motion, dict[str, int]]:
    """Replace single samples far from their neighbours by the median of these.

    A sample is far if it is off the median of SPAN around it by more than FAR times as much as
    most others nearby are off theirs (Hampel takes half of them), and by more than
    matters in the mean of a window.

    Returns:
        The motion, and how many samples were replaced, by "velocity of J4" and the like.
    """
    clean, counted = {}, {}
    for name, word, least in SPIKES:
        columns = getattr(motion, name).copy()
        for joint, column in enumerate(columns.T):
            middle = median_filter(column, SPAN, mode="mirror")
            off = np.abs(column - middle)
            usual = percentile_filter(off, MOST_OF, NEARBY, mode="mirror")
            away = off > np.maximum(FAR * usual, least)
            if away.any():
                column[away] = middle[away]
                counted[f"{word} of J{joint + 1}"] = int(away.sum())
        clean[name] = columns
    return replace(motion, **clean), counted
