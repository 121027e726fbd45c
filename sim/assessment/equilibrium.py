"""How the arm comes to rest in bushings: Newton's method finds where it hangs."""

import mujoco
import numpy as np

from sim.assessment.donning import HOLD
from sim.assessment.validity import FailedError, Failure
from sim.system.effects import EffectForces
from sim.system.system import System

#: The start: net torque of an arm at rest, Nm; most iterations and longest step of Newton's method,
#: rad, and its step for derivatives, rad.
AT_REST, ITERATIONS, REACH, PROBE = 1e-9, 50, 0.2, 1e-6
FORWARD = (
    mujoco.mj_fwdPosition,
    mujoco.mj_fwdVelocity,
    mujoco.mj_fwdActuation,
    mujoco.mj_fwdAcceleration,
    mujoco.mj_fwdConstraint,
)


def settle(system: System, data: mujoco.MjData, forces: EffectForces) -> np.ndarray:
    """Let the arm hang at rest in the robot, whose motors stand at the start.

    There is no history in springs, so that Newton's method on the human angles, and those of the
    robot's passive joints, replaces the hold.

    Returns:
        The torque that holds each joint of the robot, Nm, shape (number of joints,).

    Raises:
        FailedError: there is no rest within reach of the seat.
    """
    model = system.model
    data.act[model.actuator_actadr[system.contracted]] = system.activation
    data.time = HOLD
    angles = np.concatenate([system.human_qpos, system.passive_qpos])
    dofs = np.concatenate([system.human_dof, system.passive_dof])
    # Friction lets them rest anywhere near: where they would without it.
    friction = model.dof_frictionloss[system.passive_dof].copy()
    model.dof_frictionloss[system.passive_dof] = 0.0
    data.qpos[system.exo_qpos] = system.start

    def net_torque() -> np.ndarray:
        if forces:
            forces.before_step(data)
        # Piece by piece, because `mj_forward` would show a film what never happens.
        for stage in FORWARD:
            stage(model, data)
        torque: np.ndarray = data.qfrc_smooth[dofs] + data.qfrc_constraint[dofs]
        return torque

    torque = net_torque()
    for _ in range(ITERATIONS):
        if not np.isfinite(torque).all() or np.abs(torque).max() < AT_REST:
            break
        slope, here = np.empty((len(dofs), len(dofs))), data.qpos[angles]
        for i, angle in enumerate(angles):
            data.qpos[angles] = here
            data.qpos[angle] += PROBE
            slope[:, i] = (net_torque() - torque) / PROBE
        change = -np.linalg.solve(slope, torque)
        data.qpos[angles] = here + change * min(1.0, REACH / np.abs(change).max())
        torque = net_torque()
    model.dof_frictionloss[system.passive_dof] = friction
    if not np.abs(torque).max() < AT_REST:
        left = np.abs(torque).max()
        reason = f"the arm does not come to rest in the springs: {left:.2g} Nm are left"
        raise FailedError(Failure(name="start_not_reached", reason=reason), "hold")
    held: np.ndarray = -data.qfrc_smooth[system.exo_dof]
    return held
