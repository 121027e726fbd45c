"""How the arm comes to rest in contact: the straps are pulled, the buckles close, the arm settles.

Meanwhile the joint's muscles begin to co-contract, and locks hold the robot.
"""

from collections import deque

import mujoco
import numpy as np

from sim.assessment.steps import divergence
from sim.assessment.validity import FailedError, Failure, check_start
from sim.system.effects import EffectForces
from sim.system.system import System

#: Straps are pulled and the muscles' activation ramps up for so long, s.
DONNING = 0.3
#: If the straps were closed elsewhere, the robot has moved to the start after so long, s.
SEATED = 1.0
#: The movement begins after so long, s; after 1.2 s one corner of Table 1 still moved. Where the
#: arm moves even then (a heavy one, stiff to the touch, that creeps over the edge of its cuff until
#: a ring of tissue lets go), it is waited for until it rests: LONGEST, s, at most.
HOLD, LONGEST = 1.5, 3.0
#: Steps over which the locks' torque is averaged to start the controllers' integrals.
LOCK_AVERAGE = 5


def don_and_hold(system: System, data: mujoco.MjData, forces: EffectForces) -> np.ndarray:
    """Close the straps and wait until the arm rests.

    Returns:
        The torque with which the locks hold each joint of the robot, Nm, shape (number of joints,).

    Raises:
        FailedError: the arm does not rest, or the robot is not at its start.
    """
    model = system.model
    stiffness = model.tendon_stiffness[system.straps].copy()
    step_seconds = system.fidelity.step
    donning, hold, longest = (round(s / step_seconds) for s in (DONNING, HOLD, LONGEST))
    slacken_straps(system, data)
    lock_torque: deque[np.ndarray] = deque(maxlen=LOCK_AVERAGE)
    elbow_lock, displacement = system.locks[system.elbow], system.conditions.seat_angle
    locked_at = float(model.eq_data[elbow_lock, 0])
    for step in range(longest):
        if step >= hold and _not_at_rest(system, data) is None:
            break
        if step == donning:
            close_straps(system, data, stiffness)
        if displacement:
            moved = (step * step_seconds - DONNING) / (SEATED - DONNING)
            left = 1.0 - min(1.0, max(0.0, moved))
            model.eq_data[elbow_lock, 0] = locked_at + left * displacement
        data.ctrl[system.contraction_inputs] = system.activation * min(1.0, step / donning)
        _step(system, data, forces)
        if step >= hold - LOCK_AVERAGE:
            lock_torque.append(_lock_torque(system, data))
    failure = _not_at_rest(system, data)
    if failure:
        raise FailedError(failure, "hold")
    held: np.ndarray = np.mean(lock_torque, axis=0)
    return held


def _not_at_rest(system: System, data: mujoco.MjData) -> Failure | None:
    return check_start(
        human_speed=data.qvel[system.human_dof], exo_error=data.qpos[system.exo_qpos] - system.start
    )


def slacken_straps(system: System, data: mujoco.MjData) -> None:
    """Pull every strap with a nearly constant tension, as a hand does that closes it."""
    model, straps = system.model, system.straps
    mujoco.mj_fwdPosition(model, data)
    give = 0.1
    model.tendon_stiffness[straps] = _row_tension(system) / give
    model.tendon_lengthspring[straps] = _pulls_beyond(data.ten_length[straps] - give)


def close_straps(system: System, data: mujoco.MjData, stiffness: np.ndarray) -> None:
    """Close the buckles: the strap keeps its present tension and regains its stiffness (N/m)."""
    model, straps = system.model, system.straps
    mujoco.mj_fwdPosition(model, data)
    rest = data.ten_length[straps] - _row_tension(system) / stiffness
    model.tendon_stiffness[straps] = stiffness
    model.tendon_lengthspring[straps] = _pulls_beyond(rest)


def _pulls_beyond(length: np.ndarray) -> np.ndarray:
    """Return the dead bands of springs that pull beyond a length, m, and never push."""
    return np.column_stack([np.zeros_like(length), length])


def _row_tension(system: System) -> float:
    """Return the tension of each strap segment when closed, N: rows share a strap's tension."""
    return system.conditions.strap_tension / system.fidelity.strap_rows


def _step(system: System, data: mujoco.MjData, forces: EffectForces) -> None:
    """Advance one step; a warning of the engine or a value that is not finite is a failure."""
    if forces:
        forces.before_step(data)
    mujoco.mj_step(system.model, data)
    if data.warning.number.any() or not np.isfinite(data.qvel).all():
        raise FailedError(divergence(data, "velocities are", data.time), "hold")


def _lock_torque(system: System, data: mujoco.MjData) -> np.ndarray:
    """Return the torque of each lock on its joint, Nm, shape (number of joints,)."""
    torque = np.zeros(len(system.locks))
    equality = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    for i, lock in enumerate(system.locks):
        torque[i] = data.efc_force[equality & (data.efc_id == lock)].sum()
    return torque
