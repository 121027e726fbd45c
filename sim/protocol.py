"""The protocol of an assessment with explicit contact (paper, section 2.3): don, hold, move.

The straps are pulled while the joint's muscles begin to co-contract; the buckles close; the arm
comes to rest in the locked robot; then the controllers take over and move the joint along the
sigmoid.
"""

import mujoco
import numpy as np

from sim.activation import ActivationPattern
from sim.carried import CarriedEffects
from sim.contact import InterfaceGauge
from sim.control import DURATION, extension_reference
from sim.model import System, close_straps, slacken_straps
from sim.record import Record, Recorder
from sim.validity import FailedError, Failure, Posture, check_posture, check_start

#: Time (s) and the moved joint's desired angle (rad) and velocity (rad/s), shape (n,) each.
Motion = tuple[np.ndarray, np.ndarray, np.ndarray]

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
    return _follow(system, data, carried, movement(system) if motion is None else motion)


def movement(system: System) -> Motion:
    """Return the sigmoid of an assessment."""
    target, conditions = system.target, system.conditions
    time = np.arange(round(DURATION / system.fidelity.step)) * system.fidelity.step
    reference, velocity = extension_reference(
        time,
        start=float(system.start[system.moved]),
        amplitude=target.reach * conditions.movement_amplitude,
        rate=conditions.movement_rate,
        direction=target.direction,
    )
    return time, reference, velocity


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


def _follow(system: System, data: mujoco.MjData, carried: CarriedEffects, motion: Motion) -> Record:
    """Let the controllers follow the reference and record every step."""
    model, moved = system.model, system.moved
    time, reference, velocity = motion
    steps = len(time)
    position_input = model.actuator_ctrladr[system.motors]
    gauge, recorder = InterfaceGauge(system), Recorder(system, steps)
    pattern = ActivationPattern(system, data, reference)
    data.ctrl[position_input] = system.start
    data.ctrl[position_input + 1] = 0.0
    for step in range(steps):
        data.ctrl[position_input[moved]] = reference[step]
        data.ctrl[position_input[moved] + 1] = velocity[step]
        recorder.before_step(data, reference[step])
        exo_angle = float(data.qpos[system.exo_qpos[moved]])
        human_angle = float(data.qpos[system.human_qpos[system.target.joint]])
        if pattern.varies:
            pattern.velocity[step] = data.qvel[system.human_dof[system.target.joint]]
            data.ctrl[system.contraction_inputs] = pattern.activations(step, 1)[0]
        _step(system, data, carried, "movement")
        resultant, normal_force = gauge.forces(data)
        penetration, overhang = gauge.seats(data)
        recorder.after_step(data, resultant, normal_force)
        failure = check_posture(
            Posture(
                exo_angle=exo_angle,
                human_angle=human_angle,
                exo_range=system.exo_range,
                human_range=system.human_range,
                penetration=penetration,
                overhang=overhang,
                normal_force=normal_force,
            )
        )
        if failure:
            raise FailedError(failure, "movement")
    return recorder.record()


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
