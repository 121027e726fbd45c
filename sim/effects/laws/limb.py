"""What a living limb adds: reflexes, stiffness after rest, and stress that relaxes.

Stretch reflex after Lance 1980 and the threshold models of Koo and Mak 2006, its latency after
Pruszynski and Scott 2012 (Optimal feedback control and the long-latency stretch response);
thixotropy after Proske, Morgan and Gregory 1993, with a structure that moving breaks and rest
builds after Moore 1959 and Lakie and Robson 1988.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sim.effects.effect import AppliedEffect, Columns, Limits, Theta
from sim.effects.functions import Signal, at_least, choose
from sim.effects.laws.elastic import SIDE, sign_of
from sim.effects.laws.transmission import EXPONENT, Hysteresis
from sim.effects.motion import PRESLIDING_SHARE, Motion, RecordedJoint
from sim.effects.parameter import RELATIVE, SECONDS, Nonlinear, Parameter, Values, named, size

#: No reflex is faster, s: the short-latency response of an arm's muscles begins 20 to 50 ms after a
#: stretch (Pruszynski and Scott 2012), in the biceps 20 to 25 ms, and torque later still.
LATENCY = 0.02
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
    owner = "human"
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
            "s", "of the muscle's low-pass", 0.0, 0.1, floor=0.0, ceiling=0.5
        ),
        side=SIDE,
    )
    coefficients = ("gain",)
    lower = (0.0,)
    nonlinear = (
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


class BothReflexes(AppliedEffect):
    """`StretchReflex` of both sides' muscles, alike but for their gains, at every angle."""

    limb = remembers = directed = True
    name = "stretch_reflex_both"
    complexity = 6
    signature = "both directions resist, beyond a speed, a little late"
    separating_trial = StretchReflex.separating_trial
    includes = grows_from = (StretchReflex.name,)
    parameters = named(
        gain_positive=Parameter("Nm s/rad", "in flexion", floor=0.0),
        gain_negative=Parameter("Nm s/rad", "in extension", floor=0.0),
        threshold_velocity=Parameter("rad/s", "of both", neutral=0.5, floor=0.0),
        delay=Parameter("s", "of both", floor=0.0, ceiling=0.5),
        activation_time=Parameter("s", "of both", floor=0.0, ceiling=0.5),
    )
    coefficients = ("gain_positive", "gain_negative")
    lower = (0.0,)
    nonlinear = (
        Nonlinear("delay", shift=0.015, step=SECONDS),
        Nonlinear("speed", shift=0.1, step=RELATIVE),
        Nonlinear("activation_time", scaling=0.4, step=SECONDS, usual=0.0),
    )

    def thetas(self, joint: RecordedJoint) -> list[Theta]:
        every = StretchReflex().thetas(joint)
        return [_of_both(one) for one in every if one["side"] > 0.0 and one["angle"] < -1.0]

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        every = super().neighbours(theta, scale)
        near: list[Theta] = [{**one, "delay": max(LATENCY, one["delay"])} for one in every]
        return [one for one in near if one != theta]

    def searches(self, theta: Theta) -> list[tuple[Theta, Limits]]:
        every = StretchReflex().searches(_of_one(theta, 1.0))
        return [
            (_of_both(begin), {name: ends for name, ends in free.items() if name != "angle"})
            for begin, free in every
            if begin["angle"] < -1.0
        ]

    def limits(self, joint: RecordedJoint) -> Limits:
        limits = super().limits(joint)
        return {**limits, "delay": (LATENCY, limits["delay"][1])}

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


class Thixotropy(AppliedEffect):
    """Resistance that is high after a rest and is lost by moving.

    A muscle resists as a spring over its short elastic range and yields beyond it (Hill 1968; Rack
    and Westbury 1974), here as `Hysteresis` does. How much it resists goes with its `Structure`,
    but for a part that moving does not take away.
    """

    limb = True
    name = "thixotropy"
    complexity = 5
    signature = "after a rest the first movement meets more resistance"
    separating_trial = "rest ten seconds, then move to and fro five times without a pause"
    parameters = named(
        torque=Parameter("Nm", "that a long rest adds to that of moving", floor=0.0),
        torque_moving=Parameter("Nm", "that moving does not take away", floor=0.0),
        elastic_range=Parameter("rad", "over which it resists as a spring", floor=0.0),
        exponent=replace(EXPONENT, description="as of hysteresis"),
        recovery=Parameter("s", "in which rest builds it", floor=0.0),
        distance=Parameter("rad", "of motion that ends it", floor=0.0),
    )
    coefficients = ("torque", "torque_moving")
    lower = (0.0,)
    nonlinear = (
        Nonlinear("elastic_range", (0.03, 0.08), scaling=0.4, step=RELATIVE, over_travel=True),
        Nonlinear("exponent", (1.0, 0.0)),
        Nonlinear("recovery", (0.4, 1.5, 4.0), scaling=0.4, step=SECONDS),
        Nonlinear("distance", (0.15, 0.4, 1.0), scaling=0.4, step=RELATIVE, over_travel=True),
    )
    includes = ("hysteresis",)
    rubs = directed = at_reversals = winds = remembers = True

    def limits(self, joint: RecordedJoint) -> Limits:
        least = PRESLIDING_SHARE * joint.travel[1]
        return {**super().limits(joint), "elastic_range": (least, np.inf)}

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        fixed = self.fixed(joint, theta)
        wound = joint.wound(fixed["elastic_range"], fixed["exponent"])
        left = Structure(fixed["recovery"], fixed["distance"]).along(joint)
        return {joint.number: np.column_stack([left * wound, wound])}

    def simulated(self, parameters: Values, step: float) -> Callable[[Motion], float]:
        structure = Structure(parameters["recovery"], parameters["distance"])
        state, wound, before = 1.0, 0.0, np.nan

        def torque(motion: Motion) -> float:
            nonlocal state, wound, before
            place = float(motion.position)
            left, way = state, float(motion.velocity) * step if np.isnan(before) else place - before
            before = place
            state = structure.stepped(state, step, abs(way))
            over, exponent = parameters["elastic_range"], parameters["exponent"]
            wound = Hysteresis.wound(wound, way, over, exponent)
            return wound * (left * parameters["torque"] + parameters["torque_moving"])

        return torque


class ThixotropicStiffness(AppliedEffect):
    """A further spring with a `Structure` s that moving breaks and rest builds: s K (q - c)."""

    limb = True
    name = "thixotropic_stiffness"
    remembers = True
    complexity = 4
    signature = "the slope against position is steep after a rest and falls in motion"
    separating_trial = "move to and fro without a pause, then after rests of one, three and ten s"
    parameters = named(
        stiffness=Parameter("Nm/rad", "after a long rest", floor=0.0),
        torque_at_zero=Parameter("Nm", "what the motor adds at position 0 then"),
        recovery=Parameter("s", "in which rest builds it", floor=0.0),
        distance=Parameter("rad", "of motion that ends it", floor=0.0),
    )
    coefficients = ("stiffness", "torque_at_zero")
    lower = (0.0, -np.inf)
    nonlinear = (
        Nonlinear("recovery", (0.7, 1.5, 3.0), scaling=0.4, step=SECONDS),
        Nonlinear("distance", (0.2, 0.5, 1.0), scaling=0.4, step=RELATIVE, over_travel=True),
    )

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        """Return the spring's columns along the recorded motion."""
        fixed = self.fixed(joint, theta)
        left = Structure(fixed["recovery"], fixed["distance"]).along(joint)
        return {joint.number: np.column_stack([left * joint.position, left])}

    def simulated(self, parameters: Values, step: float) -> Callable[[Motion], float]:
        structure, state = Structure(parameters["recovery"], parameters["distance"]), 1.0

        def torque(motion: Motion) -> float:
            nonlocal state
            left = state
            state = structure.stepped(state, step, abs(float(motion.velocity)) * step)
            spring = parameters["stiffness"] * float(motion.position)
            return left * (spring + parameters["torque_at_zero"])

        return torque


#: Logarithm of the largest product that steps of a structure are divided by at once.
_LARGEST = 300.0


@dataclass(frozen=True)
class Structure:
    """What moving breaks over a way L and time builds: ds/dt = (1 - s) / T - s |v| / L, 0 to 1."""

    #: T, s, and L, rad or m.
    recovery: float
    distance: float

    def stepped(self, state: float, seconds: float, way: float) -> float:
        """Return the structure one step on; implicit, so that it stays between 0 and 1."""
        built = seconds / self.recovery
        return (state + built) / (1.0 + built + way / self.distance)

    def along(self, joint: RecordedJoint) -> np.ndarray:
        """Return it along the recorded motion, (n,).

        A trial begins rested; where samples are missing the joint is taken to go straight on.
        """
        recording, seconds = joint.recording, 1.0 / joint.recording.rate
        ways, place = np.abs(joint.velocity) * seconds, joint.position
        left = np.ones(len(ways))
        state, last = 1.0, None
        for piece in recording.slices:
            first = piece.start
            if last is None or recording.trial[last] != recording.trial[first]:
                state = 1.0
            else:
                gap = float(recording.time[first] - recording.time[last])
                state = self.stepped(state, gap, abs(float(place[first] - place[last])))
            left[piece] = states = self._over(state, seconds, ways[piece])
            last = piece.stop - 1
            state = self.stepped(float(states[-1]), seconds, float(ways[last]))
        return left

    def _over(self, state: float, seconds: float, ways: np.ndarray) -> np.ndarray:
        """Return the structure at the beginning of each of equal steps, (n,), as `stepped`.

        With A the product of what each step divides by, s A is the first s and what is built times
        the sum of A: products and sums instead of a loop, begun again before A is too large.
        """
        built = seconds / self.recovery
        divisors = 1.0 + built + ways / self.distance
        parts = np.log(divisors).cumsum() // _LARGEST
        states = np.empty(len(ways))
        for part in np.split(np.arange(len(ways)), np.flatnonzero(np.diff(parts)) + 1):
            product = np.cumprod(divisors[part])
            before = np.concatenate([[1.0], product[:-1]])
            sums = state + built * np.concatenate([[0.0], np.cumsum(before)])
            states[part] = sums[:-1] / before
            state = float(sums[-1] / product[-1])
        return states
