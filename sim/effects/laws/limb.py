"""What a living limb adds after a rest: stiffness and friction that moving takes away.

Thixotropy after Proske, Morgan and Gregory 1993, with a structure that moving breaks and rest
builds after Moore 1959 and Lakie and Robson 1988.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sim.effects.effect import AppliedEffect, Columns, Limits, Theta
from sim.effects.laws.transmission import EXPONENT, Hysteresis
from sim.effects.motion import PRESLIDING_SHARE, Motion, RecordedJoint
from sim.effects.parameter import RELATIVE, SECONDS, Nonlinear, Parameter, Values, named


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
    needs_first = True
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
