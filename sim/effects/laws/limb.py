"""What a living limb adds: reflexes, stiffness after rest, and torque passed between joints.

Stretch reflex after Lance 1980 and the threshold models of Koo and Mak 2006; thixotropy after
Proske, Morgan and Gregory 1993, and as a structure that moving breaks and rest builds after Moore
1959 and Lakie and Robson 1988; coupling by two-joint muscles after Hogan 1985.
"""

from collections import deque
from collections.abc import Callable

import numpy as np

from sim.effects.effect import AppliedEffect, Columns, Law, Theta
from sim.effects.functions import Signal, at_least, choose, exp
from sim.effects.laws.elastic import SIDE, sign_of
from sim.effects.motion import Motion, RecordedJoint, Recording
from sim.effects.parameter import RELATIVE, SECONDS, Nonlinear, Parameter, Values, named, size

#: Rest that makes a muscle stiff again, s, and in a simulation the speed of a joint at rest.
REST_SECONDS, REST_SPEED = 0.3, 0.01
#: Beyond any angle: the reflex has no threshold angle.
NO_ANGLE = -100.0


class StretchReflex(AppliedEffect):
    """Torque against a stretch beyond a speed or an angle, some time after it."""

    limb = True
    name = "stretch_reflex"
    complexity = 4
    signature = "the residual resists one direction only, beyond a speed or an angle, a little late"
    separating_trial = "stretch the joint through the same range at four speeds, and record the EMG"
    owner = "human"
    parameters = named(
        gain=size("Nm s/rad", 5.0, "torque against a stretch beyond the threshold"),
        threshold_velocity=Parameter(
            "rad/s", "speed of stretch beyond which it acts", 0.0, 2.0, neutral=0.5, floor=0.0
        ),
        threshold_angle=Parameter(
            "rad",
            f"angle beyond which it acts; {NO_ANGLE:g} for every angle",
            0.2,
            1.8,
            neutral=NO_ANGLE,
            in_joint_frame=True,
        ),
        delay=Parameter("s", "time from stretch to torque", 0.0, 0.1, floor=0.0, ceiling=0.5),
        side=SIDE,
    )
    coefficients = ("gain",)
    lower = (0.0,)
    nonlinear = (
        Nonlinear("delay", shift=0.015, step=SECONDS),
        Nonlinear("speed", shift=0.1, step=RELATIVE),
        Nonlinear("angle", shift=0.15, step=RELATIVE),
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
        grid: list[Theta] = []
        for side in (-1.0, 1.0):
            for delay in (0.0, 0.03, 0.06, 0.1):
                for speed in (0.0, 0.15, 0.35, 0.6):
                    grid.append({"side": side, "delay": delay, "speed": speed, "angle": -2.0})
                for angle in (-0.5, -0.2, 0.1, 0.4, 0.7):
                    grid.append({"side": side, "delay": delay, "speed": 0.0, "angle": angle})
        return grid

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        every = super().neighbours(theta, scale)
        delays = [{**near, "delay": max(0.0, near["delay"])} for near in every[:2]]
        return delays + (every[4:] if theta["angle"] > -1.0 else every[2:4])

    def fixed(self, joint: RecordedJoint, theta: Theta) -> Values:
        middle, half = joint.travel
        found = {
            "delay": theta["delay"],
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
        return {joint.number: (theta["side"] * drive)[:, None]}

    def simulated(self, parameters: Values, step: float) -> Callable[[Motion], float]:
        steps = max(1, round(parameters["delay"] / step))
        past = deque([0.0] * steps, maxlen=steps)
        strength = sign_of(parameters["side"]) * parameters["gain"]

        def torque(motion: Motion) -> float:
            drive = float(self.drive(parameters, motion))
            late = past[0] if parameters["delay"] else drive
            past.append(drive)
            return strength * late

        return torque


class Thixotropy(AppliedEffect):
    """Resistance that is high after a rest and is lost by moving."""

    limb = True
    name = "thixotropy"
    complexity = 2
    signature = "the first movement after a rest meets more resistance than the next ones"
    separating_trial = "rest ten seconds, then move to and fro five times without a pause"
    parameters = named(
        torque=Parameter("Nm", "after a rest", floor=0.0),
        distance=Parameter("rad", "of motion over which it is lost", floor=0.0),
    )
    coefficients = ("torque",)
    lower = (0.0,)
    nonlinear = (Nonlinear("distance", (0.2, 0.5, 1.0, 2.0), scaling=0.4, step=RELATIVE),)
    rubs = directed = at_reversals = True

    def fixed(self, joint: RecordedJoint, theta: Theta) -> Values:
        return {"distance": theta["distance"] * joint.travel[1]}

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        distance = self.fixed(joint, theta)["distance"]
        sign = np.tanh(joint.velocity / joint.rest_speed)
        left = exp(-distance_since_rest(joint) / distance)
        return {joint.number: (sign * left)[:, None]}

    def simulated(self, parameters: Values, step: float) -> Callable[[Motion], float]:
        rested, way = REST_SECONDS, 0.0

        def torque(motion: Motion) -> float:
            nonlocal rested, way
            speed = abs(float(motion.velocity))
            rested = rested + step if speed < REST_SPEED else 0.0
            way = 0.0 if rested >= REST_SECONDS else way + speed * step
            left = exp(-way / parameters["distance"])
            return float(parameters["torque"] * motion.direction * left)

        return torque


class ThixotropicStiffness(AppliedEffect):
    """A further spring that moving breaks and rest builds again: s K (q - c).

    Its structure s, 0 to 1, is broken over a distance and built over a time:
    ds/dt = (1 - s) / recovery - s |v| / distance.
    """

    limb = True
    name = "thixotropic_stiffness"
    complexity = 4
    signature = "the slope against position is steep after a rest and falls as the joint moves"
    separating_trial = "move to and fro without a pause, then after rests of one, three and ten s"
    parameters = named(
        stiffness=Parameter("Nm/rad", "of the spring after a long rest", floor=0.0),
        torque_at_zero=Parameter("Nm", "what the motor adds at position 0 after a long rest"),
        recovery=Parameter("s", "time in which rest builds it", floor=0.0),
        distance=Parameter("rad", "of motion over which it is lost", floor=0.0),
    )
    coefficients = ("stiffness", "torque_at_zero")
    lower = (0.0, -np.inf)
    nonlinear = (
        Nonlinear("recovery", (0.7, 1.5, 3.0), scaling=0.4, step=SECONDS),
        Nonlinear("distance", (0.2, 0.5, 1.0), scaling=0.4, step=RELATIVE),
    )

    def fixed(self, joint: RecordedJoint, theta: Theta) -> Values:
        distance = theta["distance"] * joint.travel[1]
        return {"recovery": theta["recovery"], "distance": distance}

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        """Return the spring's columns along the recorded motion; each piece begins rested."""
        fixed, rate = self.fixed(joint, theta), joint.recording.rate
        built = 1.0 / (fixed["recovery"] * rate)
        broken = np.abs(joint.velocity) / (fixed["distance"] * rate)
        left = np.ones(len(broken))
        for piece in joint.recording.slices:
            state = 1.0
            for i, loss in enumerate(broken[piece].tolist(), piece.start):
                left[i] = state
                state = self.stepped(state, built, loss)
        return {joint.number: np.column_stack([left * joint.position, left])}

    def simulated(self, parameters: Values, step: float) -> Callable[[Motion], float]:
        state = 1.0

        def torque(motion: Motion) -> float:
            nonlocal state
            left, way = state, abs(float(motion.velocity)) * step
            state = self.stepped(state, step / parameters["recovery"], way / parameters["distance"])
            spring = parameters["stiffness"] * float(motion.position)
            return left * (spring + parameters["torque_at_zero"])

        return torque

    @staticmethod
    def stepped(state: float, built: float, broken: float) -> float:
        """Return the structure one step on; implicit, so that it stays between 0 and 1."""
        return (state + built) / (1.0 + built + broken)


def distance_since_rest(joint: RecordedJoint) -> np.ndarray:
    """Return the way moved since the last rest; a piece begins rested, (n,)."""
    way, rate = np.zeros(len(joint.velocity)), joint.recording.rate
    for piece in joint.recording.slices:
        speed = np.abs(joint.velocity[piece])
        path = np.cumsum(speed) / rate
        still = speed < joint.rest_speed
        edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(int), [0]])))
        base = np.zeros(len(speed))
        for start, stop in zip(edges[::2], edges[1::2], strict=True):
            if (stop - start) / rate >= REST_SECONDS:
                base[start:] = path[stop - 1]
        way[piece] = np.maximum(path - base, 0.0)
    return way


class CrossJointCoupling(Law):
    """Torque at one joint from the position and velocity of its neighbour."""

    name = "cross_joint_coupling"
    complexity = 2
    signature = "the residual of one joint follows the position of another"
    separating_trial = "move the neighbouring joint alone while this one is held"
    parameters = named(
        stiffness=Parameter("Nm/rad", "over the neighbour's position"),
        damping=Parameter("Nm s/rad", "over the neighbour's velocity"),
        neutral=Parameter("rad", "neighbour's position without torque"),
        other_dof=Parameter("1", "number of the neighbour"),
    )
    coefficients = ("stiffness", "damping")

    def torque(self, parameters: Values, motion: Motion) -> Signal:
        position, velocity = motion.other(int(parameters["other_dof"]))
        elastic = parameters["stiffness"] * (position - parameters["neutral"])
        return elastic + parameters["damping"] * velocity

    def applies(self, recording: Recording, joint: int) -> bool:
        return neighbour(recording, joint) is not None

    def fixed(self, joint: RecordedJoint, theta: Theta) -> Values:
        other = neighbour(joint.recording, joint.number)
        assert other is not None
        return {
            "neutral": float(joint.recording.position[:, other].mean()),
            "other_dof": float(other),
        }


def neighbour(recording: Recording, joint: int) -> int | None:
    """Return the joint before or after in the chain that is recorded moving, or None."""
    moving = np.ptp(recording.position, axis=0) > 5e-3
    others = [j for j in range(len(moving)) if j != joint and moving[j]]
    return min(others, key=lambda j: abs(j - joint)) if others else None
