"""Torques that MuJoCo has no element for, computed at every step from the model's own text.

model = mujoco.MjModel.from_xml_path("model_after.xml")
data = mujoco.MjData(model)
effects = AppliedEffects(model)
while ...:
    effects.apply(data)
    mujoco.mj_step(model, data)
"""

import json
from collections import deque
from collections.abc import Callable, Mapping
from math import cos, exp, expm1, sin, tanh

import mujoco

from sim.effects.elements import PREFIX

#: Width of the passage through zero velocity, rad/s or m/s.
SMOOTH = 0.01
#: Speed below which a joint rests, and the rest that makes it stiff again, s.
REST_SPEED, REST_SECONDS = 0.01, 0.3

Torque = Callable[[mujoco.MjData], float]


class AppliedEffects:
    """The applied torques of one model; holds their memory, so use one object a simulation."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        #: Actuator and torque of every effect.
        self.torques: list[tuple[int, Torque]] = []
        for number in range(model.ntext):
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TEXT, number)
            if not name.startswith(PREFIX):
                continue
            start, size = int(model.text_adr[number]), int(model.text_size[number])
            # The text's last byte is its end mark.
            text = bytes(model.text_data[start : start + size - 1]).decode()
            content = json.loads(text.replace("'", '"'))
            torque = _Effect(model, content["joint"], content["effect"], content["parameters"])
            self.torques.append((model.actuator(name).id, torque))

    def apply(self, data: mujoco.MjData) -> None:
        """Set the controls of the effects' actuators for the step that comes."""
        for actuator, torque in self.torques:
            data.ctrl[self._model.actuator_ctrladr[actuator]] = torque(data)


class _Effect:
    """Torque that the joint feels from one effect: the opposite of what the motor must add."""

    def __init__(
        self, model: mujoco.MjModel, joint: str, name: str, parameters: Mapping[str, float]
    ) -> None:
        self.qpos = int(model.joint(joint).qposadr[0])
        self.dof = int(model.joint(joint).dofadr[0])
        self.step = float(model.opt.timestep)
        self.p = parameters
        self.compute: Callable[[float, float, mujoco.MjData], float] = getattr(self, f"_{name}")
        steps = max(1, round(parameters.get("delay", 0.0) / self.step))
        self.late: deque[float] = deque([0.0] * steps, maxlen=steps)
        self.state = 0.0
        self.rested = REST_SECONDS
        self.other = int(parameters.get("other_dof", 0))

    def __call__(self, data: mujoco.MjData) -> float:
        return -self.compute(float(data.qpos[self.qpos]), float(data.qvel[self.dof]), data)

    def _stribeck_friction(self, q: float, v: float, data: mujoco.MjData) -> float:
        p = self.p
        slow = exp(-((v / p["stribeck_velocity"]) ** 2))
        return (p["torque"] + p["breakaway_excess"] * slow) * tanh(v / SMOOTH)

    def _asymmetric_friction(self, q: float, v: float, data: mujoco.MjData) -> float:
        # Where the levels are declared already, only the slopes differ.
        level = self.p.get("torque_positive" if v > 0 else "torque_negative", 0.0)
        viscous = 0.5 * self.p.get("viscous_difference", 0.0) * abs(v)
        return level * tanh(v / SMOOTH) + viscous

    def _load_dependent_friction(self, q: float, v: float, data: mujoco.MjData) -> float:
        load = abs(float(data.qfrc_bias[self.dof] - data.qfrc_passive[self.dof]))
        return (self.p["torque"] + self.p["load_share"] * load) * tanh(v / SMOOTH)

    def _position_dependent_friction(self, q: float, v: float, data: mujoco.MjData) -> float:
        p, x = self.p, q - self.p["middle"]
        level = p["torque_middle"] + p["torque_slope"] * x + p["torque_curvature"] * x * x
        return level * tanh(v / SMOOTH)

    def _nonlinear_stiffness(self, q: float, v: float, data: mujoco.MjData) -> float:
        return self.p["cubic_stiffness"] * (q - self.p["centre"]) ** 3

    def _end_range_torque(self, q: float, v: float, data: mujoco.MjData) -> float:
        p = self.p
        beyond = max(0.0, p["side"] * (q - p["onset"]))
        power = p["power"]
        rise = beyond**power if power else expm1(min(beyond / p["width"], 20.0))
        return p["side"] * p["stiffness"] * rise

    def _torque_ripple(self, q: float, v: float, data: mujoco.MjData) -> float:
        angle = self.p["order"] * q
        return self.p["cosine"] * cos(angle) + self.p["sine"] * sin(angle)

    def _hysteresis(self, q: float, v: float, data: mujoco.MjData) -> float:
        sign = (v > 0) - (v < 0)
        decay = exp(-abs(v) * self.step / self.p["distance"])
        self.state = sign + (self.state - sign) * decay if sign else self.state
        return self.p["torque"] * self.state

    def _stretch_reflex(self, q: float, v: float, data: mujoco.MjData) -> float:
        p, side = self.p, self.p["side"]
        drive = max(0.0, side * v - p["threshold_velocity"])
        if "threshold_angle" in p and side * (q - p["threshold_angle"]) <= 0:
            drive = 0.0
        late = self.late[0] if p["delay"] else drive
        self.late.append(drive)
        return side * p["gain"] * late

    def _thixotropy(self, q: float, v: float, data: mujoco.MjData) -> float:
        self.rested = self.rested + self.step if abs(v) < REST_SPEED else 0.0
        self.state = 0.0 if self.rested >= REST_SECONDS else self.state + abs(v) * self.step
        return self.p["torque"] * tanh(v / SMOOTH) * exp(-self.state / self.p["distance"])

    def _drift(self, q: float, v: float, data: mujoco.MjData) -> float:
        constant = self.p["time_constant"]
        return self.p["rate"] * constant * -expm1(-float(data.time) / constant)

    def _cross_joint_coupling(self, q: float, v: float, data: mujoco.MjData) -> float:
        p = self.p
        return p["stiffness"] * (float(data.qpos[self.other]) - p["neutral"]) + p[
            "damping"
        ] * float(data.qvel[self.other])
