"""Many steps inside the engine: a movement is driven, measured by sensors and judged afterwards.

A loop in Python that reads forces and poses at every step costs a quarter of an assessment. Here
`mujoco.rollout` runs a whole movement; what it needs to know of a step is in the state and in
sensors, which hold quantities of one instant: that in which the step begins.
"""

from collections.abc import Callable

import mujoco
import numpy as np
from mujoco import rollout

from sim.assessment.system import System
from sim.assessment.validity import FailedError, Failure, Postures, first_failure
from sim.body.activation import ActivationPattern
from sim.effects.carried import CarriedEffects
from sim.robot.control import DURATION, extension_reference

#: Time (s) and the moved joint's desired angle (rad) and velocity (rad/s), shape (n,) each.
Motion = tuple[np.ndarray, np.ndarray, np.ndarray]
#: What the detectors look at, from states before each step, shape (n, nstate), and sensors.
Look = Callable[[np.ndarray, np.ndarray], Postures]

_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS


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


def follow(
    system: System, data: mujoco.MjData, carried: CarriedEffects, motion: Motion, look: Look
) -> tuple[np.ndarray, np.ndarray]:
    """Let the controllers follow `motion` from the state of `data`; leave the last state there.

    Returns:
        States before each step and after the last, shape (n + 1, nstate), and the sensors of each
        step, shape (n, nsensordata).

    Raises:
        FailedError: a detector fired; `data` holds the state after the step that it fired at.
    """
    model, moved = system.model, system.moved
    time, reference, velocity = motion
    inputs = model.actuator_ctrladr[system.motors]
    control = np.zeros((len(time), model.nu))
    control[:, inputs] = system.start
    control[:, inputs[moved]] = reference
    control[:, inputs[moved] + 1] = velocity
    pattern = ActivationPattern(system, data, reference)
    dof = 1 + model.nq + system.human_dof[system.target.joint]
    states = np.empty((len(time) + 1, mujoco.mj_stateSize(model, _STATE)))
    sensed = np.empty((len(time), model.nsensordata))
    # Who watches must see nothing beyond a failure.
    size = 1 if mujoco.get_mjcb_control() else pattern.horizon
    for first in range(0, len(time), size):
        piece = slice(first, min(first + size, len(time)))
        control[piece, system.contraction_inputs] = pattern.activations(first, piece.stop - first)
        ahead, sensed[piece], diverged = roll_out(system, data, carried, control[piece])
        states[first : piece.stop + 1] = ahead
        pattern.velocity[piece] = ahead[:-1, dof]
        begun = len(sensed[piece]) if diverged is None else diverged[0]
        judged = slice(first, first + begun)
        found = first_failure(look(states[judged], sensed[judged])) if begun else None
        if found:
            mujoco.mj_setState(model, data, states[first + found[0] + 1], _STATE)
            raise FailedError(found[1], "movement")
        if diverged:
            raise FailedError(diverged[1], "movement")
    return states, sensed


def roll_out(
    system: System, data: mujoco.MjData, carried: CarriedEffects, control: np.ndarray
) -> tuple[np.ndarray, np.ndarray, tuple[int, Failure] | None]:
    """Run `control`, shape (n, nu), from the state of `data`; leave the last state there.

    Returns:
        States before each step and after the last, shape (n + 1, nstate), the sensors of each step,
        shape (n, nsensordata), and, if the engine gave up, how many steps it did and why. Rows
        beyond these repeat the last.
    """
    first = np.empty(mujoco.mj_stateSize(system.model, _STATE))
    mujoco.mj_getState(system.model, data, first, _STATE)
    if carried:
        ahead, sensed = _stepped(system, data, carried, control)
    else:
        ahead, sensed = (
            rows[0]
            for rows in rollout.rollout(
                system.model,
                data,
                first[None],
                control[None],
                initial_warmstart=data.qacc_warmstart[None].copy(),
            )
        )
    states = np.vstack([first, ahead])
    mujoco.mj_setState(system.model, data, states[-1], _STATE)
    return states, sensed, _divergence(data, states)


def _divergence(data: mujoco.MjData, states: np.ndarray) -> tuple[int, Failure] | None:
    """Return the number of good steps and the failure, if states diverged."""
    warnings, finite = data.warning.number, np.isfinite(states).all(axis=1)
    if not warnings.any() and finite.all():
        return None
    # A rollout that diverged repeats its last state, and with it the time.
    good = finite[1:] & (np.diff(states[:, 0]) > 0.0)
    steps = len(good) if good.all() else int(np.argmin(good))
    at = f"{states[steps, 0]:.2f} s"
    reason = f"the state is not finite at {at}"
    if warnings.any():
        name = mujoco.mjtWarning(int(warnings.argmax())).name.removeprefix("mjWARN_")
        reason = f"the engine warned {name} at {at}"
    return steps, Failure(name="diverged", reason=reason)


def _stepped(
    system: System, data: mujoco.MjData, carried: CarriedEffects, control: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Run `control` as the engine's rollout does, with what effects add at each step."""
    model = system.model
    states = np.empty((len(control), mujoco.mj_stateSize(model, _STATE)))
    sensed = np.empty((len(control), model.nsensordata))
    # The engine's rollout takes which locks hold from the model.
    data.eq_active[:] = model.eq_active0
    for step, inputs in enumerate(control):
        data.ctrl[:] = inputs
        carried.before_step(data)
        mujoco.mj_step(model, data)
        mujoco.mj_getState(model, data, states[step], _STATE)
        sensed[step] = data.sensordata
        if data.warning.number.any():
            states[step:], sensed[step:] = states[step], sensed[step]
            break
    return states, sensed
