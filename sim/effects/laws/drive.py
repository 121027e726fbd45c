"""Drive and sensors: what the effort or position channel does to a true torque or angle.

Gain, offset, delay and lag of a drive, as MuJoCo's actuator gain, bias, delay and first-order
`dyntype="filter"`; the encoder's zero; what warms up.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from sim.effects.effect import Columns, Effect, Law, Limits, Theta
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

#: How a gain is read from its coefficient.
GAIN = Reading(column=0, gain=True)
#: A larger or smaller gain is another effect in disguise.
GAINS = (0.33, 3.0)
#: No joint carries this many times what its links weigh; efforts that are so many times too large
#: are in another unit. Less can be a load nobody declared.
HEAVIEST = 30.0
#: An encoder's zero is set within a quarter of a turn, rad.
MAX_OFFSET = 0.5 * np.pi
#: The effort reaches the joint later by no more, s; it is recorded later by no more, s.
MAX_DELAY, MAX_LATE_EFFORT = 0.3, 0.1
#: Share of the sampling period within which nothing is late: to hold a sample for a period is a
#: delay of half of it, in the controller as in the log (Astrom and Wittenmark 1997).
CLOCK = 0.5
#: Slowest drive, s: a loop closed around a slower one cannot follow a limb. Soft tissue relaxes in
#: 0.1 to 1 s (viscosity over stiffness, Table 1), and looks like one.
MAX_LAG = 0.16
#: Delays and lags to begin with, s. A negative delay is that of the effort; a negative lag is
#: nobody's: it would smooth the noise of the prediction.
DELAYS = both_signs(0.002, 0.004, 0.007, 0.011, 0.016, 0.023, 0.032, 0.045, 0.065)
LAGS = (0.003, 0.006, 0.011, 0.02, 0.035, 0.06, 0.1, 0.16)


class Late(Effect):
    """A channel that is late by one non-linear parameter, in seconds."""

    channel = filters = True

    def beyond(
        self,
        joint: RecordedJoint,
        theta: Theta,
        coefficients: Mapping[int, float],
        *,
        difference: bool = False,
    ) -> str:
        (parameter,) = self.nonlinear
        if abs(theta[parameter.name]) < CLOCK * joint.recording.period:
            return parameter.name
        return super().beyond(joint, theta, coefficients, difference=difference)


#: Every residual has this sign; who thinks of a torque on the joint has to be told.
WHAT = "what the motor must add; a torque on the joint has the opposite sign"


class TorqueOffset(Law):
    """A constant torque."""

    name = "torque_offset"
    complexity = 1
    signature = "the residual has the same mean everywhere"
    element = "actuator/general/@biasprm"
    separating_trial = "hold still in five postures"
    owner = "robot"
    parameters = named(torque=size("Nm", 2.0, WHAT, low=-2.0))
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
    scales_effort = filters = uses_estimate = True

    def applies(self, recording: Recording, joint: int) -> bool:
        return super().applies(recording, joint) and joint not in recording.calibrated

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        # All that is declared, and what the joint carries beside it as other joints tell. What it
        # takes alone is fitted in units of the reported torque.
        torque = joint.recording.inverse + joint.estimate.shared
        return {joint.number: torque[:, [joint.number]]}

    def readings(self, joint: RecordedJoint, theta: Theta) -> dict[str, Reading]:
        return {"gain": GAIN}

    def limits(self, joint: RecordedJoint) -> Limits:
        return {"gain": GAINS}

    def gain(self, coefficients: np.ndarray) -> float:
        return float(GAIN.of({0: float(coefficients[0])}))

    def motor_gain(self, parameters: Values) -> float:
        return parameters["gain"]

    def add(self, spec: "mujoco.MjSpec", joint: str, parameters: Values) -> str:
        for motor in motors_of(spec, joint):
            motor.gainprm[0] *= parameters["gain"]
            motor.biasprm[:3] = np.array(motor.biasprm[:3]) * parameters["gain"]
        return self.element


class AnyGain(TorqueGain):
    """The same where a load, or links of other masses, would have to be as far beyond declared."""

    def limits(self, joint: RecordedJoint) -> Limits:
        return {"gain": (1.0 / HEAVIEST, GAINS[1])}


class PositionOffset(Effect):
    """A wrong zero of the encoder: gravity and inertia are computed in the wrong place."""

    name = "position_offset"
    complexity = 1
    signature = "the residual follows the slope of gravity over posture"
    element = "joint/@ref"
    separating_trial = "hold still in five postures all over the range"
    parameters = named(
        offset=Parameter(
            "rad", "recorded position less the true", floor=-MAX_OFFSET, ceiling=MAX_OFFSET
        )
    )
    coefficients = ("offset",)
    nonlinear = (Nonlinear("offset", (-0.3, -0.1, -0.03, 0.03, 0.1, 0.3), scaling=0.4),)
    uses_estimate = True

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        # Recorded position = true position + offset, so the torque is that of q - offset. The
        # secant over the offset itself is exact once both agree.
        secant = joint.recording.secant(joint.number, -theta["offset"])
        return {number: -secant[:, [number]] for number in joint.recording.joints}

    def limits(self, joint: RecordedJoint) -> Limits:
        if joint.recording.is_hinge(joint.number):
            return super().limits(joint)
        # A slide's zero lies within its own travel.
        travel = 2.0 * joint.travel[1]
        return {"offset": (-travel, travel)}

    def add(self, spec: "mujoco.MjSpec", joint: str, parameters: Values) -> str:
        joint_of(spec, joint).ref += parameters["offset"]
        return self.element


class TimeDelay(Late):
    """The joint feels the effort a fixed time later, or its encoder is late; else it is negative.

    An effort that is recorded late, as behind a low-pass, is what the joint felt before.
    """

    name = "time_delay"
    complexity = 1
    signature = "the residual is the torque's derivative: it grows with frequency"
    element = "applied torque (delay)"
    separating_trial = "shake the joint fast, with a small amplitude"
    parameters = named(
        delay=Parameter(
            "s", "from the effort to the joint", floor=-MAX_LATE_EFFORT, ceiling=MAX_DELAY
        )
    )
    nonlinear = (Nonlinear("delay", DELAYS, scaling=0.25, step=SECONDS),)

    def through(self, recording: Recording, column: np.ndarray, theta: Theta) -> np.ndarray:
        # The joint feels effort(t - d), so the effort is what the joint needs d later.
        return recording.shifted(column, theta["delay"])

    def add(self, spec: "mujoco.MjSpec", joint: str, parameters: Values) -> str | None:
        delay = parameters["delay"]
        return add_delay(spec, joint, delay) if delay > 0 else None


class ActuatorLag(Late):
    """A first-order lag of the torque behind the command."""

    name = "actuator_lag"
    complexity = 1
    signature = "fast parts of the torque are missing and late"
    element = "actuator/general/@dynprm (filter)"
    separating_trial = "sweep the joint from slow to fast with a small amplitude"
    parameters = named(
        time_constant=Parameter("s", "of the first-order lag", floor=0.0, ceiling=MAX_LAG)
    )
    nonlinear = (Nonlinear("time_constant", LAGS, scaling=0.25, step=SECONDS),)

    def through(self, recording: Recording, column: np.ndarray, theta: Theta) -> np.ndarray:
        # Low-passed with the column by the fit, and not before: twice, a longer lag made up for it.
        return column + theta["time_constant"] * recording.derivative(column)

    def add(self, spec: "mujoco.MjSpec", joint: str, parameters: Values) -> str:
        add_filter(spec, joint, parameters["time_constant"])
        return self.element


class Drift(Law):
    """A torque that creeps over the session: linear in the session's clock, or levelling off."""

    name = "drift"
    complexity = 3
    signature = "the residual changes from trial to trial in their order"
    separating_trial = "repeat the first trial at the end of the session"
    # What creeps did so before the first sample, too.
    includes = ("torque_offset",)
    parameters = named(
        rate=Parameter("Nm/s", "at the session's beginning"),
        time_constant=Parameter("s", "over which it levels off", floor=0.0),
        torque_at_start=Parameter("Nm", "what the motor adds then"),
    )
    coefficients = ("rate", "torque_at_start")
    nonlinear = (Nonlinear("level_off", (10.0, 0.6, 0.2), scaling=0.4, step=RELATIVE),)

    def torque(self, parameters: Values, motion: Motion) -> Signal:
        constant = parameters["time_constant"]
        crept = parameters["rate"] * constant * -expm1(-motion.time / constant)
        return parameters["torque_at_start"] + crept

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        time = joint.recording.time - joint.recording.time.min()
        constant = theta["level_off"] * max(float(time.max()), 1e-9)
        crept = constant * (1.0 - np.exp(-time / constant))
        return {joint.number: np.column_stack([crept, np.ones_like(time)])}

    def fixed(self, joint: RecordedJoint, theta: Theta) -> Values:
        length = float(np.ptp(joint.recording.time))
        return {"time_constant": theta["level_off"] * length}
