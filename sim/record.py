"""What is recorded during the movement, step by step."""

from dataclasses import dataclass, fields
from pathlib import Path

import mujoco
import numpy as np

from sim.model import System


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
    #: Torque of the muscles about the human joint, shape (n,).
    muscle_torque: np.ndarray
    #: Resultant force of cuff and strap on upper arm and forearm, shape (n, 2).
    contact_force: np.ndarray
    #: Sum of all normal forces between exoskeleton and arm, shape (n,).
    normal_force: np.ndarray

    def save(self, path: Path) -> None:
        """Write every array under its own name to a compressed `.npz` file."""
        with path.open("wb") as file:
            np.savez_compressed(file, **{f.name: getattr(self, f.name) for f in fields(self)})


class Recorder:
    """Collects one movement; every sample holds quantities of one and the same instant."""

    def __init__(self, system: System, steps: int) -> None:
        self._system = system
        self._step = system.fidelity.step
        joints = len(system.device.joints)
        self._count = 0
        self._arrays = {
            name: np.empty((steps, *shape))
            for name, shape in (
                ("time", ()),
                ("reference", ()),
                ("theta", (joints,)),
                ("theta_velocity", (joints,)),
                ("motor_torque", (joints,)),
                ("q", (4,)),
                ("q_velocity", (4,)),
                ("muscle_torque", ()),
                ("contact_force", (2,)),
                ("normal_force", ()),
            )
        }
        self._final_velocity = np.zeros(joints)

    def before_step(self, data: mujoco.MjData, reference: float) -> None:
        """Note the state and the desired elbow angle (rad) that the coming step starts from."""
        arrays, system, i = self._arrays, self._system, self._count
        arrays["time"][i] = i * self._step
        arrays["reference"][i] = reference
        arrays["theta"][i] = data.qpos[system.exo_qpos]
        arrays["theta_velocity"][i] = data.qvel[system.exo_dof]
        arrays["q"][i] = data.qpos[system.human_qpos]
        arrays["q_velocity"][i] = data.qvel[system.human_dof]

    def after_step(
        self, data: mujoco.MjData, contact_force: np.ndarray, normal_force: float
    ) -> None:
        """Note the forces that acted in the state `before_step` saw."""
        arrays, system, i = self._arrays, self._system, self._count
        arrays["motor_torque"][i] = data.actuator_force[system.motors] / system.motor_gain
        arrays["muscle_torque"][i] = data.qfrc_actuator[system.human_dof[system.target.joint]]
        arrays["contact_force"][i] = contact_force
        arrays["normal_force"][i] = normal_force
        self._final_velocity = data.qvel[system.exo_dof].copy()
        self._count += 1

    def record(self) -> Record:
        """Return the finished record; accelerations are those the steps really made."""
        velocity = np.vstack([self._arrays["theta_velocity"], self._final_velocity])
        acceleration = np.diff(velocity, axis=0) / self._step
        self._arrays["motor_torque"] = acting_torque(
            self._system, self._arrays["motor_torque"], acceleration
        )
        return Record(
            device=self._system.device.name,
            joint=self._system.target.joint,
            exo_joint=self._system.moved,
            theta_acceleration=acceleration,
            **self._arrays,
        )


def acting_torque(system: System, torque: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    """Return what the motors really did over each step, as a torque sensor would show it, Nm.

    The engine applies the controller's damping at the step's end; the force it reports is that of
    the step's beginning.

    Args:
        system: whose motors.
        torque: as reported, Nm, shape (n, number of joints).
        acceleration: over each step, rad/s2, of that shape.
    """
    return torque - system.gains.kv * system.fidelity.step * acceleration
