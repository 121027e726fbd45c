"""Local stiffness and damping of the human joint: what small perturbations of it alone would find.

An experimenter who defines joint stiffness holds everything else still, moves the joint a little,
and looks at the torque that answers. Here activation and every other joint stay as they were at a
step of the movement; muscles, passive stop and spring, and the joint's own damping answer.
"""

import mujoco
import numpy as np

from sim.assessment.record import Record, passive_torque
from sim.assessment.steps import activation_pattern
from sim.system.system import System

#: Half of a perturbation, rad and rad/s.
TURN, SPEED = 1e-4, 1e-3


def local_impedance(
    system: System, record: Record, steps: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return stiffness (Nm/rad) and damping (Nm s/rad) at some steps, sign of equation 3.

    Args:
        system: that moved.
        record: of its movement.
        steps: numbers of steps, shape (n,).

    Returns:
        Two arrays of shape (n,).
    """
    model, data = system.model, mujoco.MjData(system.model)
    joint, pattern = system.target.joint, activation_pattern(system, data, record.reference)
    angle, dof = system.human_qpos[joint], system.human_dof[joint]
    inputs = model.actuator_actadr[system.contracted]
    stiffness, damping = np.empty(len(steps)), np.empty(len(steps))
    joint_damping = float(model.dof_damping[dof])
    for i, step in enumerate(steps):
        data.qpos[system.human_qpos] = record.q[step]
        data.qvel[system.human_dof] = record.q_velocity[step]
        data.act[inputs] = pattern.level[step]
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


def bone_length(model: mujoco.MjModel, begin: str, end: str) -> float:
    """Return the distance between the joints of two bodies of the arm in the compiled model, m."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
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
