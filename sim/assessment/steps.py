"""Many steps inside the engine: a movement is driven, measured by sensors and judged afterwards.

A loop in Python that reads forces and poses at every step costs a quarter of an assessment. Here
`mujoco.rollout` runs a whole movement; what it needs to know of a step is in the state and in
sensors, which hold quantities of one instant: that in which the step begins.
"""

from dataclasses import fields

import mujoco
import numpy as np
from mujoco import rollout

from sim.assessment.validity import FailedError, Failure, Postures, first_failure
from sim.body.activation import ActivationPattern, muscle_lengthening
from sim.interface.interface import Loads
from sim.robot.control import DURATION, extension_reference
from sim.system.effects import EffectForces
from sim.system.system import System

#: Time (s) and the moved joint's desired angle (rad) and velocity (rad/s), shape (n,) each.
Motion = tuple[np.ndarray, np.ndarray, np.ndarray]

_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS
#: Without threads of its own it holds nothing of a simulation, and to make one takes time.
_ROLLOUT = rollout.Rollout(nthread=0)


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


def activation_pattern(
    system: System, data: mujoco.MjData, reference: np.ndarray
) -> ActivationPattern:
    """Return the activation of a movement along `reference` (rad, shape (n,)) from `data`."""
    lengthening = np.zeros(len(system.contracted))
    if system.conditions.reflex_gain > 0.0:
        dof = system.human_dof[system.target.joint]
        lengthening = muscle_lengthening(system.model, data, dof, system.contracted)
    return ActivationPattern(
        system.conditions,
        reference,
        level=system.activation,
        step=system.fidelity.step,
        lengthening=lengthening,
    )


def follow(
    system: System, data: mujoco.MjData, forces: EffectForces, motion: Motion
) -> tuple[np.ndarray, np.ndarray, Loads]:
    """Let the controllers follow `motion` from the state of `data`; leave the last state there.

    Returns:
        States before each step and after the last, shape (n + 1, nstate), the sensors of each step,
        shape (n, nsensordata), and its loads.

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
    pattern = activation_pattern(system, data, reference)
    dof = 1 + model.nq + system.human_dof[system.target.joint]
    states = np.empty((len(time) + 1, mujoco.mj_stateSize(model, _STATE)))
    sensed, pieces = np.empty((len(time), model.nsensordata)), []
    # Who watches must see nothing beyond a failure; else all parts are judged together.
    watched = bool(mujoco.get_mjcb_control())
    size = 1 if watched else pattern.horizon
    judged = 0
    for first in range(0, len(time), size):
        piece = slice(first, min(first + size, len(time)))
        control[piece, system.contraction_inputs] = pattern.activations(first, piece.stop - first)
        ahead, sensed[piece], diverged = roll_out(system, data, forces, control[piece])
        states[first : piece.stop + 1] = ahead
        pattern.velocity[piece] = ahead[:-1, dof]
        end = piece.stop if diverged is None else first + diverged[0]
        if not (watched or diverged or piece.stop == len(time)):
            continue
        found = None
        if end > judged:
            part = slice(judged, end)
            pieces.append(system.interface.loads(model, states[part], sensed[part]))
            found = first_failure(_postures(system, states[part], sensed[part], pieces[-1]))
        if found:
            mujoco.mj_setState(model, data, states[judged + found[0] + 1], _STATE)
            raise FailedError(found[1], "movement")
        if diverged:
            raise FailedError(diverged[1], "movement")
        judged = end
    return states, sensed, _joined(pieces)


def _postures(system: System, states: np.ndarray, sensed: np.ndarray, loads: Loads) -> Postures:
    """Return what the detectors look at, from states before each step, its sensors and loads."""
    torque, most = sensed[:, : len(system.motors)], system.motor_limits
    return Postures(
        exo_angle=states[:, 1 + system.exo_qpos[system.moved]],
        human_angle=states[:, 1 + system.human_qpos[system.target.joint]],
        exo_range=system.exo_range,
        human_range=system.human_range,
        motor_share=(np.abs(torque) / most).max(axis=1),
        loads=loads,
    )


def _joined(pieces: list[Loads]) -> Loads:
    """Return the loads of one movement from those of its parts."""
    if len(pieces) == 1:
        return pieces[0]
    names = [entry.name for entry in fields(Loads)]
    return Loads(**{n: np.concatenate([getattr(piece, n) for piece in pieces]) for n in names})


def roll_out(
    system: System, data: mujoco.MjData, forces: EffectForces, control: np.ndarray
) -> tuple[np.ndarray, np.ndarray, tuple[int, Failure] | None]:
    """Run `control`, shape (n, nu), from the state of `data`; leave the last state there.

    Returns:
        States before each step and after the last, shape (n + 1, nstate), the sensors of each step,
        shape (n, nsensordata), and, if the engine gave up, how many steps it did and why. Rows
        beyond these repeat the last.
    """
    first = np.empty(mujoco.mj_stateSize(system.model, _STATE))
    mujoco.mj_getState(system.model, data, first, _STATE)
    states = np.empty((len(control) + 1, len(first)))
    states[0] = first
    if forces:
        states[1:], sensed = _stepped(system, data, forces, control)
    else:
        sensed = np.empty((len(control), system.model.nsensordata))
        # With a reflex a movement is dozens of calls, and checking shapes took a third of each.
        _ROLLOUT.rollout(
            [system.model],
            [data],
            first[None],
            np.ascontiguousarray(control)[None],
            skip_checks=True,
            nstep=len(control),
            initial_warmstart=data.qacc_warmstart[None].copy(),
            state=states[None, 1:],
            sensordata=sensed[None],
        )
    mujoco.mj_setState(system.model, data, states[-1], _STATE)
    return states, sensed, _divergence(data, states)


def _divergence(data: mujoco.MjData, states: np.ndarray) -> tuple[int, Failure] | None:
    """Return the number of good steps and the failure, if states diverged."""
    if not data.warning.number.any() and np.isfinite(states).all():
        return None
    finite = np.isfinite(states).all(axis=1)
    # A rollout that diverged repeats its last state, and with it the time.
    good = finite[1:] & (np.diff(states[:, 0]) > 0.0)
    steps = len(good) if good.all() else int(np.argmin(good))
    return steps, divergence(data, "the state is", states[steps, 0])


def divergence(data: mujoco.MjData, what: str, time: float) -> Failure:
    """Return the failure of an engine that warned, or of a value ("... is") that is not finite."""
    reason = f"{what} not finite at {time:.2f} s"
    if data.warning.number.any():
        name = mujoco.mjtWarning(int(data.warning.number.argmax())).name.removeprefix("mjWARN_")
        reason = f"the engine warned {name} at {time:.2f} s"
    return Failure(name="diverged", reason=reason)


def _stepped(
    system: System, data: mujoco.MjData, forces: EffectForces, control: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Run `control` as the engine's rollout does, with what effects add at each step."""
    model = system.model
    states = np.empty((len(control), mujoco.mj_stateSize(model, _STATE)))
    sensed = np.empty((len(control), model.nsensordata))
    # The engine's rollout takes which locks hold from the model.
    data.eq_active[:] = model.eq_active0
    for step, inputs in enumerate(control):
        data.ctrl[:] = inputs
        forces.before_step(data)
        mujoco.mj_step(model, data)
        mujoco.mj_getState(model, data, states[step], _STATE)
        sensed[step] = data.sensordata
        if data.warning.number.any():
            states[step:], sensed[step:] = states[step], sensed[step]
            break
    return states, sensed
