"""A recording in a few numbers, and the truth beside them: what a bank of recordings is made of.

Only what a robot records enters the curves: its joints' angles, velocities and motor torques. They
are means over windows around the moment at which the moved joint is half-way, so that a measured
session needs no common clock with the simulation.
"""

from dataclasses import dataclass

import numpy as np

from sim.assessment.estimation import fit
from sim.assessment.nominal import nominal_model
from sim.assessment.record import Record
from sim.body.skeleton import JOINT_DAMPING
from sim.models import CURVES, ESTIMATES, WINDOWS
from sim.parameters.conditions import Conditions
from sim.robot.device import Device, load_device

#: Seconds before and after the moment half-way, which the windows share alike.
BEFORE, AFTER = 2.2, 3.2


class RecordingError(ValueError):
    """A recording that cannot be summarised: one sentence says why."""


@dataclass(frozen=True, kw_only=True)
class Motion:
    """What a robot records in n samples, SI units."""

    #: Rising, shape (n,).
    time: np.ndarray
    #: Angles, velocities and motor torques of the device's joints, shape (n, its joints).
    theta: np.ndarray
    velocity: np.ndarray
    torque: np.ndarray
    #: Which of them is assessed.
    joint: int


def motion_of(record: Record) -> Motion:
    """Return what the robot records of a simulated movement."""
    return Motion(
        time=record.time,
        theta=record.theta,
        velocity=record.theta_velocity,
        torque=record.motor_torque,
        joint=record.exo_joint,
    )


def summarise(motion: Motion, device: Device) -> dict[str, float]:
    """Return curves and regressions of what a robot recorded (`sim.models.CURVES`, `ESTIMATES`).

    The curves are the moved joint's angle and, for each joint, the torque that the declared model
    does not explain (equation 20).

    Args:
        motion: of the NESM's joints, or of a device with as many.
        device: what is declared of it.

    Raises:
        RecordingError: the joint hardly moves, or too little is recorded around the movement.
    """
    time, theta = motion.time, motion.theta
    acceleration = np.gradient(motion.velocity, time, axis=0)
    needed = nominal_model(device).torques(theta, motion.velocity, acceleration)
    inferred = needed - motion.torque
    moved = theta[:, motion.joint]
    window = _windows(time, half_way(time, moved))
    columns = np.column_stack([moved, inferred])
    counts = np.bincount(window[window >= 0], minlength=WINDOWS)
    if counts.min() == 0:
        raise RecordingError(
            f"{WINDOWS} windows from {BEFORE} s before to {AFTER} s after the middle of the "
            "movement must each hold a sample: record longer, or without the gap"
        )
    inside = window >= 0
    curves = np.empty((columns.shape[1], WINDOWS))
    for i, column in enumerate(columns.T):
        curves[i] = np.bincount(window[inside], column[inside], WINDOWS) / counts
    torque, velocity = inferred[inside, motion.joint], motion.velocity[inside, motion.joint]
    affine = fit(torque, moved[inside], velocity, damping=True, constant=True)
    paper = fit(torque, moved[inside], velocity, damping=True, constant=False)
    values = (affine.stiffness, affine.damping, paper.stiffness, paper.damping, affine.residual_rms)
    return dict(zip(CURVES, curves.ravel().tolist(), strict=True)) | {
        name: float(value or 0.0) for name, value in zip(ESTIMATES, values, strict=True)
    }


def truth(record: Record, conditions: Conditions) -> dict[str, float]:
    """Return what nobody can record: K_h and D_h of the whole elbow, restoring sense.

    Muscles, stop, spring and dampers together; the regressors are the human joint's angle and
    velocity, with a constant, and without for comparison with equation 21 (`.._paper`).
    """
    q, velocity = record.q[:, record.joint], record.q_velocity[:, record.joint]
    affine = fit(record.human_torque, q, velocity, damping=True, constant=True)
    paper = fit(record.human_torque, q, velocity, damping=True, constant=False)
    assert affine.damping is not None
    return {
        "stiffness": -affine.stiffness,
        "damping": JOINT_DAMPING + conditions.passive_damping - affine.damping,
        "stiffness_paper": -paper.stiffness,
    }


def half_way(time: np.ndarray, angle: np.ndarray) -> float:
    """Return when a joint is half-way between where it began and where it ended, s.

    Raises:
        RecordingError: it moves by less than a quarter of a radian.
    """
    settled = max(1, len(angle) // 50)
    begin, end = angle[:settled].mean(), angle[-settled:].mean()
    if abs(end - begin) < 0.25:
        raise RecordingError(
            f"the joint moves by {abs(end - begin):.2f} rad from begin to end: an assessment is "
            "one movement from one end of the range to the other (at least 0.25 rad)"
        )
    share = (angle - begin) / (end - begin)
    after = int(np.argmax(share >= 0.5))
    low, high = share[after - 1], share[after]
    return float(time[after - 1] + (0.5 - low) / (high - low) * (time[after] - time[after - 1]))


def _windows(time: np.ndarray, middle: float) -> np.ndarray:
    """Return the number of the window of each sample, -1 outside, shape (n,)."""
    number = np.floor((time - middle + BEFORE) / (BEFORE + AFTER) * WINDOWS).astype(int)
    return np.where((number >= 0) & (number < WINDOWS), number, -1)


def summary_of(record: Record, conditions: Conditions) -> dict[str, float]:
    """Return curves, regressions and truth of a simulated movement.

    Raises:
        RecordingError: as `summarise`.
    """
    found = summarise(motion_of(record), load_device(record.device))
    return found | {f"true_{name}": value for name, value in truth(record, conditions).items()}
