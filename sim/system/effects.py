"""Effects in the full simulation, on the robot's joint or the limb's.

Native elements need nothing at run time. Friction whose level varies is MuJoCo's `frictionloss`
set anew before each step: the solver holds a joint still in friction at any step, which a torque
computed outside it would not. Torques of the limb are applied forces, so that the torque of
the muscles stays what it is: K_h never contains what an effect adds.
"""

from collections.abc import Mapping
from math import prod

import mujoco
import numpy as np

from sim.effects.applied import AppliedEffects
from sim.effects.catalogue import ASSESSED
from sim.effects.laws.friction import Friction
from sim.effects.motion import SimulatedMotion
from sim.effects.parameter import Values
from sim.parameters.conditions import Conditions
from sim.robot.control import Gains


def motor_gain(conditions: Conditions) -> float:
    """Return the torque at the moved joint over what its motor reports."""
    return prod(
        ASSESSED[name].motor_gain(parameters) for name, parameters in conditions.effects.items()
    )


def varying_frictions(conditions: Conditions) -> Mapping[Friction, Values]:
    """Return the frictions whose level is set anew at each step, with their parameters."""
    effects = {ASSESSED[name]: parameters for name, parameters in conditions.effects.items()}
    return {
        effect: parameters
        for effect, parameters in effects.items()
        if isinstance(effect, Friction) and effect.varies
    }


def add_effects(
    spec: mujoco.MjSpec, conditions: Conditions, gains: Gains, robot: str, human: str
) -> None:
    """Add every effect of `conditions` that has an element to the joint of its owner.

    Args:
        spec: robot and arm, before cuffs and tissue; changed in place.
        conditions: with the effects that are on.
        gains: of every motor.
        robot: name of the robot's joint.
        human: name of the limb's joint.

    Raises:
        ValueError: a parameter makes the model unphysical.
    """
    gain = motor_gain(conditions)
    if gain != 1.0:
        # The motor answers its gains by a torque that the joint feels so many times over.
        motor = spec.actuator(f"{robot}_motor")
        motor.set_to_pid(kp=gain * gains.kp, kv=gain * gains.kv, ki=gain * gains.ki)
        motor.forcerange = gain * np.array(motor.forcerange)
    frictions = varying_frictions(conditions)
    for name, parameters in conditions.effects.items():
        effect = ASSESSED[name]
        if not effect.scales_effort and effect not in frictions:
            effect.add(spec, robot if effect.owner == "robot" else human, parameters)


class EffectForces:
    """Forces and friction of the effects of one simulation at each step; holds their memory."""

    def __init__(self, model: mujoco.MjModel, conditions: Conditions, robot: str) -> None:
        self._model = model
        self._torques = [
            (int(model.jnt_dofadr[model.actuator_trnid[actuator, 0]]), torque)
            for actuator, torque in AppliedEffects(model).torques
        ]
        self._frictions = varying_frictions(conditions)
        self._qpos = int(model.joint(robot).qposadr[0])
        self._dof = int(model.joint(robot).dofadr[0])
        self._declared = float(model.dof_frictionloss[self._dof])

    def __bool__(self) -> bool:
        """Whether anything has to be done at each step."""
        return bool(self._torques or self._frictions)

    def before_step(self, data: mujoco.MjData) -> None:
        """Set forces and friction for the step that comes."""
        data.qfrc_applied[:] = 0.0
        for dof, torque in self._torques:
            data.qfrc_applied[dof] += torque(data)
        if self._frictions:
            motion = _MotorMotion(data, self._qpos, self._dof)
            levels = (friction.level(own, motion) for friction, own in self._frictions.items())
            level = sum(max(0.0, float(level)) for level in levels)
            self._model.dof_frictionloss[self._dof] = self._declared + level


class _MotorMotion(SimulatedMotion):
    """Motion of the robot's joint, loaded by its motor's torque."""

    @property
    def load(self) -> float:
        return abs(float(self.data.qfrc_actuator[self.dof]))
