"""Stretch reflexes of a limb's muscles.

After Lance 1980 and the threshold models of Koo and Mak 2006, their latency after Pruszynski and
Scott 2012 (Optimal feedback control and the long-latency stretch response).
"""

from collections import deque
from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np

from sim.effects.effect import AppliedEffect, Columns, Limits, Theta
from sim.effects.functions import Signal, at_least, choose
from sim.effects.laws.elastic import SIDE, sign_of
from sim.effects.motion import Motion, RecordedJoint
from sim.effects.parameter import RELATIVE, SECONDS, Nonlinear, Parameter, Values, named, size

#: No reflex is faster, s: the short-latency response of an arm's muscles begins 20 to 50 ms after a
#: stretch (Pruszynski and Scott 2012), in the biceps 20 to 25 ms, and torque later still.
LATENCY = 0.02
#: A delay that is no longer than that by this, s, shows nothing that is late.
AT_ONCE = 0.001
#: Where parameters are searched for: s and, of thresholds, over top speed and half the travel.
BETWEEN = {
    "delay": (LATENCY - 1e-9, 0.3),
    "speed": (0.0, 0.95),
    "angle": (-0.95, 0.95),
    "activation_time": (0.001, 0.3),
}
#: Time constant with which the search for a muscle begins, s (set on a stranger's nine reflexes).
MUSCLE = 0.01
#: Stages of a muscle's low-pass, one after the other.
ORDER = 2
#: Beyond any angle: the reflex has no threshold angle.
NO_ANGLE = -100.0


class StretchReflex(AppliedEffect):
    """Torque against a stretch beyond a speed or an angle, some time after it.

    The muscle passes its excitation on as a low-pass of second order does, here one that is
    critically damped (Kearney, Stein and Parameswaran 1997, Identification of intrinsic and reflex
    contributions to human ankle stiffness dynamics). Its time constant is 0 where the torque
    follows the stretch as it is.
    """

    limb = True
    name = "stretch_reflex"
    remembers = True
    complexity = 5
    signature = "one direction resists, beyond a speed or an angle, a little late"
    separating_trial = "stretch the joint through the same range at four speeds, and record the EMG"
    owner: Literal["robot", "human"] | None = "human"
    parameters = named(
        gain=size("Nm s/rad", 5.0, "against stretch beyond the threshold"),
        threshold_velocity=Parameter(
            "rad/s", "of stretch beyond which it acts", 0.0, 2.0, neutral=0.5, floor=0.0
        ),
        threshold_angle=Parameter(
            "rad",
            f"beyond which it acts; {NO_ANGLE:g}: every angle",
            0.2,
            1.8,
            neutral=NO_ANGLE,
            in_joint_frame=True,
        ),
        delay=Parameter("s", "from stretch to torque", 0.0, 0.1, floor=0.0, ceiling=0.5),
        activation_time=Parameter(
            "s", "of the muscle's second-order low-pass", 0.0, 0.1, floor=0.0, ceiling=0.5
        ),
        side=SIDE,
    )
    coefficients: tuple[str, ...] = ("gain",)
    lower = (0.0,)
    nonlinear: tuple[Nonlinear, ...] = (
        Nonlinear("delay", shift=0.015, step=SECONDS),
        Nonlinear("speed", shift=0.1, step=RELATIVE),
        Nonlinear("angle", shift=0.15, step=RELATIVE),
        Nonlinear("activation_time", scaling=0.4, step=SECONDS, usual=0.0),
    )
    directed = True

    def drive(self, parameters: Values, motion: Motion) -> Signal:
        """Return the stretch beyond the threshold, rad/s, at once and of either side."""
        side = sign_of(parameters["side"])
        drive = at_least(0.0, side * motion.velocity - parameters["threshold_velocity"])
        onset = parameters.get("threshold_angle", NO_ANGLE)
        if onset == NO_ANGLE:
            return drive
        return choose(side * (motion.position - onset) > 0, drive, 0.0)

    def thetas(self, joint: RecordedJoint) -> list[Theta]:
        thresholds = [{"speed": speed, "angle": -2.0} for speed in (0.0, 0.15, 0.35, 0.6)]
        thresholds += [{"speed": 0.0, "angle": angle} for angle in (-0.5, -0.2, 0.1, 0.4, 0.7)]
        courses = [{"delay": d, "activation_time": 0.0} for d in (LATENCY, 0.035, 0.06, 0.1)]
        # Set while looking at real ankles, and at ours: with one delay the search ended elsewhere.
        courses += [
            {"delay": delay, "activation_time": time}
            for delay in (0.035, 0.05, 0.065)
            for time in (0.03, 0.05, 0.08)
        ]
        return [
            {"side": side, **course, **threshold}
            for side in (-1.0, 1.0)
            for course in courses
            for threshold in thresholds
        ]

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        every = super().neighbours(theta, scale)
        near: list[Theta] = [{**one, "delay": max(LATENCY, one["delay"])} for one in every[:2]]
        near += every[4:6] if theta["angle"] > -1.0 else every[2:4]
        return near + (every[6:] if theta["activation_time"] else [])

    def searches(self, theta: Theta) -> list[tuple[Theta, Limits]]:
        begins = [theta]
        if not theta["activation_time"]:
            # The muscle as late as the latency that imitated it.
            delay = max(LATENCY, theta["delay"] - ORDER * MUSCLE)
            begins.append({**theta, "delay": delay, "activation_time": MUSCLE})
        both = {"angle": -0.5} if theta["angle"] <= -1.0 else {"speed": 0.15}
        begins.append({**begins[-1], **both})
        return [
            (one, {name: limits for name, limits in BETWEEN.items() if one[name] > limits[0]})
            for one in begins
        ]

    def limits(self, joint: RecordedJoint) -> Limits:
        limits = super().limits(joint)
        return {**limits, "delay": (LATENCY, limits["delay"][1])}

    def fixed(self, joint: RecordedJoint, theta: Theta) -> Values:
        middle, half = joint.travel
        found = {
            "delay": theta["delay"],
            "activation_time": theta["activation_time"],
            "side": theta["side"],
            "threshold_velocity": theta["speed"] * joint.top_speed,
        }
        if theta["angle"] > -1.0:
            found["threshold_angle"] = middle + theta["side"] * theta["angle"] * half
        return found

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        drive = np.asarray(self.drive(self.fixed(joint, theta), joint))
        if theta["delay"]:
            drive = joint.recording.shifted(drive, -theta["delay"])
        for _ in range(ORDER if theta["activation_time"] else 0):
            drive = joint.recording.lagged(drive, theta["activation_time"])
        return {joint.number: (theta["side"] * drive)[:, None]}

    def simulated(self, parameters: Values, step: float) -> Callable[[Motion], float]:
        steps = max(1, round(parameters["delay"] / step))
        past = deque([0.0] * steps, maxlen=steps)
        strength = sign_of(parameters["side"]) * parameters["gain"]
        time = parameters.get("activation_time", 0.0)
        kept = np.exp(-step / time) if time else 0.0
        stages = [0.0] * ORDER

        def torque(motion: Motion) -> float:
            drive = float(self.drive(parameters, motion))
            passed = past[0] if parameters["delay"] else drive
            past.append(drive)
            for number, before in enumerate(stages):
                passed = stages[number] = kept * before + (1.0 - kept) * passed
            return strength * passed

        return torque


class BothReflexes(StretchReflex):
    """`StretchReflex` of both sides' muscles, alike but for their gains, at every angle."""

    name = "stretch_reflex_both"
    owner = None
    complexity = 6
    signature = "both directions resist, beyond a speed, a little late"
    includes = grows_from = (StretchReflex.name,)
    parameters = named(
        gain_positive=Parameter("Nm s/rad", "in flexion", floor=0.0),
        gain_negative=Parameter("Nm s/rad", "in extension", floor=0.0),
        threshold_velocity=Parameter("rad/s", "of both", neutral=0.5, floor=0.0),
        delay=Parameter("s", "of both", floor=0.0, ceiling=0.5),
        activation_time=Parameter("s", "of both", floor=0.0, ceiling=0.5),
    )
    coefficients = ("gain_positive", "gain_negative")
    nonlinear = (
        Nonlinear("delay", shift=0.015, step=SECONDS),
        Nonlinear("speed", shift=0.1, step=RELATIVE),
        Nonlinear("activation_time", scaling=0.4, step=SECONDS, usual=0.0),
    )

    def thetas(self, joint: RecordedJoint) -> list[Theta]:
        every = StretchReflex().thetas(joint)
        return [_of_both(one) for one in every if one["side"] > 0.0 and one["angle"] < -1.0]

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        every = AppliedEffect.neighbours(self, theta, scale)
        near: list[Theta] = [{**one, "delay": max(LATENCY, one["delay"])} for one in every]
        return [one for one in near if one != theta]

    def searches(self, theta: Theta) -> list[tuple[Theta, Limits]]:
        every = StretchReflex().searches(_of_one(theta, 1.0))
        return [
            (_of_both(begin), {name: ends for name, ends in free.items() if name != "angle"})
            for begin, free in every
            if begin["angle"] < -1.0
        ]

    def beyond(
        self,
        joint: RecordedJoint,
        theta: Theta,
        coefficients: Mapping[int, float],
        *,
        difference: bool = False,
    ) -> str:
        # Drag that grows with speed resists both ways, too, and at once.
        if theta["delay"] <= LATENCY + AT_ONCE:
            return "delay"
        return super().beyond(joint, theta, coefficients, difference=difference)

    def fixed(self, joint: RecordedJoint, theta: Theta) -> Values:
        found = StretchReflex().fixed(joint, _of_one(theta, 1.0))
        return {name: value for name, value in found.items() if name in self.parameters}

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        sides = [StretchReflex().columns(joint, _of_one(theta, side)) for side in (1.0, -1.0)]
        return {joint.number: np.column_stack([own[joint.number] for own in sides])}

    def simulated(self, parameters: Values, step: float) -> Callable[[Motion], float]:
        shared = {name: parameters[name] for name in ("threshold_velocity", "delay")}
        shared["activation_time"] = parameters.get("activation_time", 0.0)
        one, other = (
            StretchReflex().simulated({**shared, "side": side, "gain": parameters[gain]}, step)
            for side, gain in ((1.0, "gain_positive"), (-1.0, "gain_negative"))
        )
        return lambda motion: one(motion) + other(motion)


def _of_one(theta: Theta, side: float) -> Theta:
    """Return what makes the form of a reflex of one side, at every angle."""
    return {**theta, "side": side, "angle": -2.0}


def _of_both(theta: Theta) -> Theta:
    """Return what makes the form of those of both sides, from one's."""
    return {name: value for name, value in theta.items() if name not in ("side", "angle")}
