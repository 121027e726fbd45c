"""Torques that MuJoCo has no element for, computed at every step from the model's own text.

model = mujoco.MjModel.from_xml_path("model_after.xml")
data = mujoco.MjData(model)
effects = AppliedEffects(model)
while ...:
    effects.apply(data)
    mujoco.mj_step(model, data)
"""

import json
from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np

from sim.effects.catalogue import BY_NAME
from sim.effects.effect import AppliedEffect
from sim.effects.elements import PREFIX
from sim.effects.motion import SimulatedMotion

Torque = Callable[[mujoco.MjData], float]


class AppliedEffects:
    """The applied torques of one model; holds their memory, so use one object a simulation.

    Args:
        model: with the effects' texts and actuators.
        begun: the session's clock where the simulation's stands at 0, s: a drift goes by it.

    Raises:
        ValueError: an effect of the model is not as this version writes it.
    """

    def __init__(self, model: mujoco.MjModel, begun: float = 0.0) -> None:
        self._model = model
        #: Actuator of every effect, and the torque that the joint feels.
        self.torques: list[tuple[int, Torque]] = []
        names = [
            mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TEXT, number)
            for number in range(model.ntext)
        ]
        own = [(number, name) for number, name in enumerate(names) if name.startswith(PREFIX)]
        if own:
            # Never stepped: the engine's callback would show a film what never happens.
            rest, motors = mujoco.MjData(model), _motors(model)
            for number, name in own:
                still = SimulatedMotion(rest, 0, 0, begun, motors)
                torque = _torque(model, _text(model, number), still)
                self.torques.append((model.actuator(name).id, torque))

    def apply(self, data: mujoco.MjData) -> None:
        """Set the controls of the effects' actuators for the step that comes."""
        for actuator, torque in self.torques:
            data.ctrl[self._model.actuator_ctrladr[actuator]] = torque(data)


def _text(model: mujoco.MjModel, number: int) -> str:
    start, size = int(model.text_adr[number]), int(model.text_size[number])
    # The text's last byte is its end mark.
    return bytes(model.text_data[start : start + size - 1]).decode()


def _motors(model: mujoco.MjModel) -> dict[int, np.ndarray]:
    """Return the actuators of each degree of freedom that are no effects."""
    found: dict[int, list[int]] = {}
    for number in range(len(model.actuator_trnid)):
        name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, number) or ""
        at_joint = model.actuator_trntype[number] == mujoco.mjtTrn.mjTRN_JOINT
        if at_joint and not name.startswith(PREFIX):
            dof = int(model.jnt_dofadr[model.actuator_trnid[number, 0]])
            found.setdefault(dof, []).append(number)
    return {dof: np.array(numbers) for dof, numbers in found.items()}


def _torque(model: mujoco.MjModel, text: str, still: SimulatedMotion) -> Torque:
    """Return what an effect does to its joint; `still` is of any joint of a model at rest."""
    content = json.loads(text.replace("'", '"'))
    step, joint = float(model.opt.timestep), model.joint(content["joint"])
    still = replace(still, qpos=int(joint.qposadr[0]), dof=int(joint.dofadr[0]))
    try:
        effect = BY_NAME[content["effect"]]
        assert isinstance(effect, AppliedEffect)
        # One try at rest: which parameters an effect asks for is seen when it is computed.
        effect.simulated(content["parameters"], step)(still)
    except KeyError as missing:
        raise ValueError(
            f"{content['effect']} of {content['joint']} was written by another version of rehyb, "
            f"with other names (no {missing}): close the loop again"
        ) from None
    needed = effect.simulated(content["parameters"], step)
    return lambda data: -needed(replace(still, data=data))
