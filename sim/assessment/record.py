"""What is recorded during the movement, step by step."""

from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from sim.assessment.steps import Motion
from sim.body.skeleton import extension_stop_torque
from sim.interface.interface import Loads
from sim.parameters.target import ELBOW_TARGET
from sim.system.system import System


@dataclass(frozen=True, kw_only=True)
class Record:
    """The movement at every step: n steps, angles in rad, torques in Nm, forces in N."""

    #: Seconds since the movement began, shape (n,).
    time: np.ndarray
    #: Name of the device.
    device: str
    #: Number of the human joint that was moved, 0 to 3, and the column of the device's own.
    joint: int
    exo_joint: int
    #: Its desired angle, shape (n,).
    reference: np.ndarray
    #: Angles, velocities and accelerations of the device's joints, shape (n, their number).
    theta: np.ndarray
    theta_velocity: np.ndarray
    theta_acceleration: np.ndarray
    #: Motor torque of each, shape (n, their number).
    motor_torque: np.ndarray
    #: Human abduction, flexion, rotation and elbow angles and velocities, shape (n, 4).
    q: np.ndarray
    q_velocity: np.ndarray
    #: What muscles do about the human joint, and what its stop and spring do, shape (n,).
    muscle_torque: np.ndarray
    passive_torque: np.ndarray
    #: What cuffs and straps did to the arm.
    loads: Loads

    def steps_at(self, shares: Iterable[float]) -> np.ndarray:
        """Return the step at which the human joint has first made each share of its travel."""
        q = self.q[:, self.joint]
        travelled: np.ndarray = (q - q[0]) / (q[-1] - q[0])
        return np.array([int(np.argmax(travelled >= share)) for share in shares])

    def over_phase(self, values: np.ndarray, points: int) -> np.ndarray:
        """Return values (n,) at evenly spaced times from the first step to the last."""
        at = np.linspace(self.time[0], self.time[-1], points)
        curve: np.ndarray = np.interp(at, self.time, values)
        return curve

    @property
    def human_torque(self) -> np.ndarray:
        """What muscles, stop and spring do about the human joint together, shape (n,)."""
        torque: np.ndarray = self.muscle_torque + self.passive_torque
        return torque

    def save(self, path: Path) -> None:
        """Write every array under its own name to a compressed `.npz` file."""
        own = {f.name: getattr(self, f.name) for f in fields(self) if f.name != "loads"}
        with path.open("wb") as file:
            np.savez_compressed(file, **own, **vars(self.loads))


def record_of(
    system: System, motion: Motion, states: np.ndarray, sensed: np.ndarray, loads: Loads
) -> Record:
    """Return the record of a movement of n steps.

    Args:
        system: that moved.
        motion: that the robot followed.
        states: before each step and after the last, shape (n + 1, nstate).
        sensed: sensors of each step, shape (n, nsensordata), the torques first.
        loads: in each step.
    """
    position, velocity = np.split(states[:, 1:], [system.model.nq], axis=1)
    q = position[:-1, system.human_qpos]
    exo_velocity = velocity[:, system.exo_dof]
    # Those the steps really made.
    acceleration = np.diff(exo_velocity, axis=0) / system.fidelity.step
    motors = len(system.motors)
    reported = sensed[:, :motors] / system.motor_gain
    # The engine applies the controller's damping at a step's end; the force that it reports is
    # that of the step's beginning, and no torque sensor would show it.
    late = system.gains.kv * system.fidelity.step * acceleration
    return Record(
        device=system.device.name,
        joint=system.target.joint,
        exo_joint=system.moved,
        time=motion[0],
        reference=motion[1],
        theta=position[:-1, system.exo_qpos],
        theta_velocity=exo_velocity[:-1],
        theta_acceleration=acceleration,
        motor_torque=reported - late,
        q=q,
        q_velocity=velocity[:-1, system.human_dof],
        muscle_torque=sensed[:, motors],
        passive_torque=passive_torque(system, q[:, system.target.joint]),
        loads=loads,
    )


def passive_torque(system: System, angle: np.ndarray) -> np.ndarray:
    """Return what stop and spring do about the moved joint at its `angle` (rad), Nm, shape (n,)."""
    if system.target.joint != ELBOW_TARGET.joint:
        return np.zeros(len(angle))
    own = system.conditions
    spring = own.passive_stiffness * (angle - own.neutral_angle)
    return extension_stop_torque(angle, own.extension_stop) - spring
