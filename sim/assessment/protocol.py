"""The protocol of an assessment (paper, section 2.3): hold the arm at the start, then move it.

The arm comes to rest in the locked robot (`donning` with contact, `equilibrium` without); then the
controllers take over and move the joint along the sigmoid.
"""

import mujoco
import numpy as np

from sim.assessment.donning import don_and_hold
from sim.assessment.equilibrium import settle
from sim.assessment.record import Record, record_of
from sim.assessment.steps import Motion, follow, movement
from sim.system.system import System


def run_protocol(system: System, data: mujoco.MjData, motion: Motion | None = None) -> Record:
    """Run an assessment from donning to the end of the movement and return what was recorded.

    Args:
        system: fresh; its straps and switches are changed.
        data: from `reset_to_start`; afterwards the last state, also of a failure.
        motion: what the robot follows; the assessment's sigmoid by default.

    Raises:
        FailedError: a detector fired.
    """
    forces = system.effect_forces()
    hold = don_and_hold if system.fidelity.contact else settle
    _hand_over(system, data, hold(system, data, forces))
    motion = movement(system) if motion is None else motion
    states, sensed, loads = follow(system, data, forces, motion)
    return record_of(system, motion, states, sensed, loads)


def _hand_over(system: System, data: mujoco.MjData, held: np.ndarray) -> None:
    """Let controllers hold each joint with the torque (Nm) that held it until now."""
    model = system.model
    data.eq_active[system.locks] = 0
    model.opt.disableactuator = 0
    for motor, torque in zip(system.motors, held / system.motor_gain, strict=True):
        integral = model.actuator_actadr[motor]
        if integral >= 0:
            data.act[integral] = torque / system.gains.ki
