"""The state in which an assessment begins: the straps are about to be closed."""

import mujoco

from sim.robot.device import MOTOR_GROUP
from sim.system.system import System


def reset_to_start(system: System) -> mujoco.MjData:
    """Return data with the exoskeleton where the straps are closed, locked, the arm in it.

    That is the start of the movement, but for the condition `seat_angle`; motors are off.

    The human shoulder takes the exoskeleton's angles, and the elbow the angle at which the
    forearm's axis passes through the centre of its cuff: one start for every wearer, without a
    history.
    """
    data = mujoco.MjData(system.model)
    data.qpos[system.exo_qpos] = system.start
    data.qpos[system.exo_qpos[system.elbow]] = system.interface.closed_at
    data.qpos[system.human_qpos[:3]] = system.device.start(system.target.name).human_shoulder
    data.qpos[system.human_qpos[3]] = system.interface.seated_elbow
    data.eq_active[system.locks] = 1
    system.model.opt.disableactuator |= 1 << MOTOR_GROUP
    return data
