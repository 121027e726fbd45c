"""Local stiffness and damping of the human joint: what small perturbations of it alone would find.

An experimenter who defines joint stiffness holds everything else still, moves the joint a little,
and looks at the torque that answers. Here activation and every other joint stay as they were at a
step of the movement; muscles, passive stop and spring, and the joint's own damping answer.
"""

import mujoco
import numpy as np

from sim.assessment.record import Record, passive_torque
from sim.body.activation import voluntary
from sim.system.system import System

#: Half of a perturbation, rad and rad/s.
TURN, SPEED = 1e-4, 1e-3


def local_impedance(
    system: System, data: mujoco.MjData, record: Record, steps: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return stiffness (Nm/rad) and damping (Nm s/rad) at some steps, sign of equation 3.

    Args:
        system: that moved.
        data: of its model, in the reference pose at rest; changed.
        record: of its movement.
        steps: numbers of steps, shape (n,).

    Returns:
        Two arrays of shape (n,).
    """
    model, joint = system.model, system.target.joint
    level = voluntary(system.conditions, record.reference, system.activation)
    angle, dof = system.human_qpos[joint], system.human_dof[joint]
    inputs = model.actuator_actadr[system.contracted]
    stiffness, damping = np.empty(len(steps)), np.empty(len(steps))
    joint_damping = float(model.dof_damping[dof])
    for i, step in enumerate(steps):
        data.qpos[system.human_qpos] = record.q[step]
        data.qvel[system.human_dof] = record.q_velocity[step]
        data.act[inputs] = level[step]
        q, velocity = float(data.qpos[angle]), float(data.qvel[dof])
        answers = []
        for turn in (-TURN, TURN):
            data.qpos[angle] = q + turn
            passive = passive_torque(system, np.array([q + turn]))
            answers.append(_muscle_torque(model, data, dof) + float(passive[0]))
        data.qpos[angle] = q
        stiffness[i] = (answers[1] - answers[0]) / (2.0 * TURN)
        answers = []
        for speed in (-SPEED, SPEED):
            data.qvel[dof] = velocity + speed
            answers.append(_muscle_torque(model, data, dof))
        damping[i] = (answers[1] - answers[0]) / (2.0 * SPEED) - joint_damping
    return stiffness, damping


def bone_length(data: mujoco.MjData, begin: str, end: str) -> float:
    """Return the distance between the joints of two bodies of the arm where `data` has them, m."""
    return float(np.linalg.norm(data.body(end).xpos - data.body(begin).xpos))


def _muscle_torque(model: mujoco.MjModel, data: mujoco.MjData, dof: int) -> float:
    """Return the torque of the muscles about a joint, Nm, without looking for contacts."""
    for stage in (
        mujoco.mj_kinematics,
        mujoco.mj_comPos,
        mujoco.mj_tendon,
        mujoco.mj_transmission,
        mujoco.mj_fwdVelocity,
        mujoco.mj_fwdActuation,
    ):
        stage(model, data)
    return float(data.qfrc_actuator[dof])
