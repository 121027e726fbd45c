"""The protocol of an assessment with explicit contact (paper, section 2.3): don, hold, move.

The straps are pulled while the joint's muscles begin to co-contract; the buckles close; the arm
comes to rest in the locked robot; then the controllers take over and move the joint along the
sigmoid.
"""

from functools import partial

import mujoco
import numpy as np

from sim.assessment.record import Record, record_of
from sim.assessment.sensors import contact_forces, seats
from sim.assessment.steps import Motion, follow, movement
from sim.assessment.system import System
from sim.assessment.validity import FailedError, Failure, Postures, check_start
from sim.effects.carried import CarriedEffects
from sim.robot.seat import close_straps, slacken_straps

#: Straps are pulled and the muscles' activation ramps up for so long, s.
DONNING = 0.3
#: If the straps were closed elsewhere, the robot has moved to the start after so long, s.
SEATED = 1.0
#: The movement begins after so long, s; after 1.2 s one corner of Table 1 still moved.
HOLD = 1.5
#: Steps over which the locks' torque is averaged to start the controllers' integrals.
LOCK_AVERAGE = 5


def run_protocol(system: System, data: mujoco.MjData, motion: Motion | None = None) -> Record:
    """Run an assessment from donning to the end of the movement and return what was recorded.

    Args:
        system: fresh; its straps and switches are changed.
        data: from `reset_to_start`; afterwards the last state, also of a failure.
        motion: what the robot is to follow; the assessment's sigmoid by default.

    Raises:
        FailedError: a detector fired.
    """
    carried = system.carried()
    _don_and_hold(system, data, carried)
    motion = movement(system) if motion is None else motion
    states, sensed = follow(system, data, carried, motion, partial(_postures, system))
    forces = contact_forces(system.model, sensed, system.sleeves)
    return record_of(system, *motion[:2], states, sensed, *forces)


def _don_and_hold(system: System, data: mujoco.MjData, carried: CarriedEffects) -> None:
    """Close the straps, wait until the arm rests, hand over from the locks to the controllers."""
    model = system.model
    stiffness = model.tendon_stiffness[system.straps].copy()
    step_seconds = system.fidelity.step
    donning, hold = round(DONNING / step_seconds), round(HOLD / step_seconds)
    slacken_straps(system, data)
    lock_torque = []
    elbow_lock, displacement = system.locks[system.elbow], system.conditions.seat_angle
    locked_at = float(model.eq_data[elbow_lock, 0])
    for step in range(hold):
        if step == donning:
            close_straps(system, data, stiffness)
        if displacement:
            moved = (step * step_seconds - DONNING) / (SEATED - DONNING)
            left = 1.0 - min(1.0, max(0.0, moved))
            model.eq_data[elbow_lock, 0] = locked_at + left * displacement
        data.ctrl[system.contraction_inputs] = system.activation * min(1.0, step / donning)
        _step(system, data, carried, "hold")
        if step >= hold - LOCK_AVERAGE:
            lock_torque.append(_lock_torque(system, data))
    failure = check_start(
        human_speed=data.qvel[system.human_dof],
        exo_error=data.qpos[system.exo_qpos] - system.start,
    )
    if failure:
        raise FailedError(failure, "hold")
    data.eq_active[system.locks] = 0
    model.opt.disableactuator = 0
    wanted = np.mean(lock_torque, axis=0) / system.motor_gain
    for motor, torque in zip(system.motors, wanted, strict=True):
        integral = model.actuator_actadr[motor]
        if integral >= 0:
            data.act[integral] = torque / system.gains.ki


def _postures(system: System, states: np.ndarray, sensed: np.ndarray) -> Postures:
    """Return what the detectors look at, from states before each step and sensors."""
    penetration, overhang = seats(system.model, sensed, system.cuffs, system.sleeves)
    return Postures(
        exo_angle=states[:, 1 + system.exo_qpos[system.moved]],
        human_angle=states[:, 1 + system.human_qpos[system.target.joint]],
        exo_range=system.exo_range,
        human_range=system.human_range,
        penetration=penetration,
        overhang=overhang,
        normal_force=contact_forces(system.model, sensed, system.sleeves)[1],
    )


def _step(system: System, data: mujoco.MjData, carried: CarriedEffects, phase: str) -> None:
    """Advance one step; a warning of the engine or a value that is not finite is a failure."""
    if carried:
        carried.before_step(data)
    mujoco.mj_step(system.model, data)
    warnings = data.warning.number
    if warnings.any():
        name = mujoco.mjtWarning(int(warnings.argmax())).name.removeprefix("mjWARN_")
        raise FailedError(
            Failure(name="diverged", reason=f"the engine warned {name} at {data.time:.2f} s"), phase
        )
    if not np.isfinite(data.qvel).all():
        raise FailedError(
            Failure(name="diverged", reason=f"velocities are not finite at {data.time:.2f} s"),
            phase,
        )


def _lock_torque(system: System, data: mujoco.MjData) -> np.ndarray:
    """Return the torque of each lock on its joint, Nm, shape (number of joints,)."""
    torque = np.zeros(len(system.locks))
    equality = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    for i, lock in enumerate(system.locks):
        torque[i] = data.efc_force[equality & (data.efc_id == lock)].sum()
    return torque
