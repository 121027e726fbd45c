"""Undeclared effects in the full simulation, on the robot's joint or the limb's.

Native elements need nothing at run time. Friction whose level changes is MuJoCo's `frictionloss`
set anew before each step: the solver holds a joint still in friction at any step, which a torque
computed outside it would not. Torques of the limb are applied forces, so that the torque of
the muscles stays what it is: K_h never contains what an effect adds.
"""

from collections.abc import Callable, Mapping
from math import exp

import mujoco
import numpy as np

from sim.effects.applied import AppliedEffects
from sim.effects.catalogue import BY_NAME
from sim.parameters.conditions import Conditions
from sim.parameters.effects import NO_ANGLE, UNDECLARED
from sim.robot.control import Gains

Parameters = Mapping[str, float]


def _stribeck(p: Parameters, q: float, v: float, load: float) -> float:
    return p["torque"] + p["breakaway_excess"] * exp(-((v / p["stribeck_velocity"]) ** 2))


def _asymmetric(p: Parameters, q: float, v: float, load: float) -> float:
    return (p["torque_positive"] if v > 0 else p["torque_negative"]) + 0.5 * p[
        "viscous_difference"
    ] * v


def _load_dependent(p: Parameters, q: float, v: float, load: float) -> float:
    return p["torque"] + p["load_share"] * load


def _position_dependent(p: Parameters, q: float, v: float, load: float) -> float:
    x = q - p["middle"]
    return p["torque_middle"] + p["torque_slope"] * x + p["torque_curvature"] * x * x


#: Level of friction, Nm, from parameters, angle and velocity of the robot's joint, and the size of
#: its motor's torque.
LEVELS: Mapping[str, Callable[[Parameters, float, float, float], float]] = {
    "load_dependent_friction": _load_dependent,
    "stribeck_friction": _stribeck,
    "asymmetric_friction": _asymmetric,
    "position_dependent_friction": _position_dependent,
}


def add_undeclared(
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
    for name, parameters in conditions.effects.items():
        if name in LEVELS:
            continue
        if name == "torque_gain":
            # The motor answers its gains by a torque that the joint feels so many times over.
            gain = parameters["gain"]
            motor = spec.actuator(f"{robot}_motor")
            motor.set_to_pid(kp=gain * gains.kp, kv=gain * gains.kv, ki=gain * gains.ki)
            motor.forcerange = gain * np.array(motor.forcerange)
            continue
        owner = robot if UNDECLARED[name].owner == "robot" else human
        BY_NAME[name].add(spec, owner, _for_element(parameters))


def _for_element(parameters: Parameters) -> dict[str, float]:
    """Return parameters as the elements take them: a side is a sign, no angle is left out."""
    chosen = dict(parameters)
    if "side" in chosen:
        chosen["side"] = 1.0 if chosen["side"] >= 0.0 else -1.0
    if chosen.get("threshold_angle") == NO_ANGLE:
        del chosen["threshold_angle"]
    return chosen


class CarriedEffects:
    """What the effects of one simulation do at each step; holds their memory."""

    def __init__(self, model: mujoco.MjModel, conditions: Conditions, robot: str) -> None:
        self._model = model
        self._torques = [
            (int(model.jnt_dofadr[model.actuator_trnid[actuator, 0]]), torque)
            for actuator, torque in AppliedEffects(model).torques
        ]
        self._levels = [
            (LEVELS[name], parameters)
            for name, parameters in conditions.effects.items()
            if name in LEVELS
        ]
        self._qpos = int(model.joint(robot).qposadr[0])
        self._dof = int(model.joint(robot).dofadr[0])
        self._friction = float(model.dof_frictionloss[self._dof])

    def __bool__(self) -> bool:
        """Whether anything has to be done at each step."""
        return bool(self._torques or self._levels)

    def before_step(self, data: mujoco.MjData) -> None:
        """Set forces and friction for the step that comes."""
        data.qfrc_applied[:] = 0.0
        for dof, torque in self._torques:
            data.qfrc_applied[dof] += torque(data)
        if self._levels:
            q, v = float(data.qpos[self._qpos]), float(data.qvel[self._dof])
            load = abs(float(data.qfrc_actuator[self._dof]))
            level = sum(max(0.0, law(parameters, q, v, load)) for law, parameters in self._levels)
            self._model.dof_frictionloss[self._dof] = self._friction + level
