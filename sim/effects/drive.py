"""Drive and sensors: what the effort or position channel does to a true torque or angle.

Gain, offset, delay and lag of a drive, as MuJoCo's actuator gain, bias, delay and first-order
`dyntype="filter"`; the encoder's zero; what warms up.
"""

from typing import TYPE_CHECKING

import numpy as np

from sim.effects.effect import Columns, Effect, Law, Theta
from sim.effects.elements import add_constant, add_delay, add_filter, joint_of, motors_of
from sim.effects.functions import Signal, expm1
from sim.effects.motion import Motion, RecordedJoint, Recording
from sim.effects.parameter import (
    RELATIVE,
    SECONDS,
    Nonlinear,
    Parameter,
    Reading,
    Values,
    both_signs,
    named,
    size,
)

if TYPE_CHECKING:
    import mujoco

#: How a gain is read from its coefficient; beyond these limits it is another effect in disguise.
GAIN, GAINS = Reading(column=0, gain=True), (0.33, 3.0)
#: Slowest drive, s: a loop closed around a slower one cannot follow a limb. Soft tissue relaxes in
#: 0.1 to 1 s (viscosity over stiffness, Table 1), and looks like one.
MAX_LAG = 0.16
#: Delays and lags to begin with, s; negative ones are those of a sensor.
DELAYS = both_signs(0.002, 0.004, 0.007, 0.011, 0.016, 0.023, 0.032, 0.045, 0.065)
LAGS = both_signs(0.003, 0.006, 0.011, 0.02, 0.035, 0.06, 0.1, 0.16)


class TorqueOffset(Law):
    """A constant torque."""

    name = "torque_offset"
    complexity = 1
    signature = "the residual has the same mean everywhere"
    element = "actuator/general/@biasprm"
    separating_trial = "hold still in five postures"
    owner = "robot"
    parameters = named(torque=size("Nm", 2.0, "what the motor must add", low=-2.0))
    coefficients = ("torque",)

    def torque(self, parameters: Values, motion: Motion) -> Signal:
        return parameters["torque"]

    def add(self, spec: "mujoco.MjSpec", joint: str, parameters: Values) -> str:
        add_constant(spec, self.name, joint, -parameters["torque"])
        return self.element


class TorqueGain(Effect):
    """The joint feels gain times the effort; the whole balance is divided by the gain."""

    name = "torque_gain"
    complexity = 1
    signature = "the residual is a copy of the declared torque"
    element = "actuator/general/@gainprm"
    separating_trial = "hold a known mass still in two postures"
    owner = "robot"
    parameters = named(
        gain=Parameter(
            "1",
            "torque at the joint over the torque reported",
            0.8,
            1.2,
            neutral=1.0,
            switches=True,
            floor=0.2,
            ceiling=5.0,
        )
    )
    coefficients = ("gain",)
    scales_effort = True

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        return {joint.number: joint.recording.inverse[:, [joint.number]]}

    def readings(self, joint: RecordedJoint, theta: Theta) -> dict[str, Reading]:
        return {"gain": GAIN}

    def plausible(
        self, joint: RecordedJoint, coefficients: np.ndarray, samples: np.ndarray
    ) -> bool:
        return 1.0 / GAINS[1] < 1.0 + float(coefficients[-1]) < 1.0 / GAINS[0]

    def gain(self, coefficients: np.ndarray) -> float:
        return float(GAIN.of({0: float(coefficients[0])}))

    def motor_gain(self, parameters: Values) -> float:
        return parameters["gain"]

    def add(self, spec: "mujoco.MjSpec", joint: str, parameters: Values) -> str:
        for motor in motors_of(spec, joint):
            motor.gainprm[0] *= parameters["gain"]
            motor.biasprm[:3] = np.array(motor.biasprm[:3]) * parameters["gain"]
        return self.element


class PositionOffset(Effect):
    """A wrong zero of the encoder: gravity is computed in the wrong place."""

    name = "position_offset"
    complexity = 1
    signature = "the residual follows the slope of gravity over posture"
    element = "joint/@ref"
    separating_trial = "hold still in five postures all over the range"
    parameters = named(offset=Parameter("rad", "recorded position less the true"))
    coefficients = ("offset",)
    nonlinear = (Nonlinear("offset", (-0.3, -0.1, -0.03, 0.03, 0.1, 0.3), scaling=0.4),)
    uses_estimate = True

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        # Recorded position = true position + offset, so the torque is that of q - offset. The
        # secant over the offset itself is exact once both agree.
        secant = joint.recording.secant(joint.number, -theta["offset"])
        return {number: -secant[:, [number]] for number in joint.recording.joints}

    def add(self, spec: "mujoco.MjSpec", joint: str, parameters: Values) -> str:
        joint_of(spec, joint).ref += parameters["offset"]
        return self.element


class TimeDelay(Effect):
    """The joint feels the effort a fixed time later; negative if the encoder is the late one."""

    name = "time_delay"
    complexity = 1
    signature = (
        "the residual is the derivative of the torque: it grows with frequency, not amplitude"
    )
    element = "applied torque (delay)"
    separating_trial = "shake the joint fast, with a small amplitude"
    parameters = named(delay=Parameter("s", "from the effort to the joint"))
    nonlinear = (Nonlinear("delay", DELAYS, scaling=0.25, step=SECONDS),)
    channel = True

    def through(self, recording: Recording, column: np.ndarray, theta: Theta) -> np.ndarray:
        # The joint feels effort(t - d), so the effort is what the joint needs d later.
        return recording.shifted(column, theta["delay"])

    def add(self, spec: "mujoco.MjSpec", joint: str, parameters: Values) -> str | None:
        delay = parameters["delay"]
        return add_delay(spec, joint, delay) if delay > 0 else None


class ActuatorLag(Effect):
    """A first-order lag: of the torque behind the command, or (negative) of the effort's sensor."""

    name = "actuator_lag"
    complexity = 1
    signature = "fast parts of the torque are missing and late, slow ones are not"
    element = "actuator/general/@dynprm (filter)"
    separating_trial = "sweep the joint from slow to fast with a small amplitude"
    parameters = named(time_constant=Parameter("s", "of the first-order lag"))
    nonlinear = (Nonlinear("time_constant", LAGS, scaling=0.25, step=SECONDS),)
    channel = True

    def plausible_theta(self, theta: Theta) -> bool:
        return abs(theta["time_constant"]) <= MAX_LAG

    def through(self, recording: Recording, column: np.ndarray, theta: Theta) -> np.ndarray:
        constant = theta["time_constant"]
        if constant > 0:
            # Above the fit's band a slope of the torque, a third derivative, is noise alone.
            return column + constant * recording.derivative(recording.filtered(column))
        return recording.lagged(column, -constant)

    def add(self, spec: "mujoco.MjSpec", joint: str, parameters: Values) -> str | None:
        if parameters["time_constant"] <= 0:
            return None
        add_filter(spec, joint, parameters["time_constant"])
        return self.element


class Drift(Law):
    """A torque that creeps over the session: linear in the session's clock, or levelling off."""

    name = "drift"
    complexity = 2
    signature = "the residual changes from trial to trial in the order they were run"
    separating_trial = "repeat the first trial at the end of the session"
    parameters = named(
        rate=Parameter("Nm/s", "at the session's beginning"),
        time_constant=Parameter("s", "over which it levels off"),
    )
    coefficients = ("rate",)
    nonlinear = (Nonlinear("level_off", (10.0, 0.6, 0.2), step=RELATIVE),)

    def torque(self, parameters: Values, motion: Motion) -> Signal:
        constant = parameters["time_constant"]
        return parameters["rate"] * constant * -expm1(-motion.time / constant)

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        time = joint.recording.time - joint.recording.time.min()
        constant = theta["level_off"] * max(float(time.max()), 1e-9)
        return {joint.number: (constant * (1.0 - np.exp(-time / constant)))[:, None]}

    def fixed(self, joint: RecordedJoint, theta: Theta) -> Values:
        length = float(np.ptp(joint.recording.time))
        return {"time_constant": theta["level_off"] * length}
