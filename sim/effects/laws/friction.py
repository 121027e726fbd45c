"""Friction: torque against the direction of motion, and what makes it vary.

Armstrong-Helouvry, Dupont and Canudas de Wit 1994 (survey of friction models); direction-dependent
friction as found in ball screws (Janot, Gautier and Brunot 2019); dependence on position after
Popovic and Goldenberg 1998, Modeling of friction using spectral analysis. MuJoCo has `frictionloss`
and `damping`; what else varies enters as an applied torque, or as a level that is set anew at each
step.
"""

from abc import abstractmethod
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from sim.effects.effect import Columns, Law, Theta
from sim.effects.elements import add_damping, joint_of
from sim.effects.functions import Signal, choose, exp, magnitude, sin
from sim.effects.motion import Motion, RecordedJoint
from sim.effects.parameter import (
    PERIODS,
    RELATIVE,
    Nonlinear,
    Parameter,
    Reading,
    Values,
    named,
    size,
)

if TYPE_CHECKING:
    import mujoco

#: Width over which the direction changes, over the top speed.
SMOOTH = Nonlinear("smooth", (0.004, 0.02, 0.06), scaling=0.4)
COARSE = Nonlinear("smooth", (0.004, 0.02))
#: Speed at which friction loses what it has more when slow, over the top speed. The least was added
#: for an arm of the unkind bench (seed 902).
SPEED = Nonlinear("speed", (0.015, 0.03, 0.06, 0.12, 0.24, 0.4), scaling=0.4, step=RELATIVE)
#: Power of the speed that it falls by. Gaussian and exponential peaks, and powers of 0.5 to 1, are
#: all in use (Armstrong-Helouvry, Dupont and Canudas de Wit 1994, section 2.1).
GAUSSIAN = 2.0
POWER = Nonlinear("power", (GAUSSIAN,), step=RELATIVE, usual=GAUSSIAN)
EXPONENT = Parameter(
    "1", "its power; 2 unless told", 0.5, 2.0, neutral=GAUSSIAN, floor=0.3, ceiling=4.0
)

#: Waves of friction over the range of motion; of none a parabola is left.
WAVES = Nonlinear("waves", (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0), scaling=0.2, step=RELATIVE)


def slowness(parameters: Values, motion: Motion) -> Signal:
    """Return 1 at rest and 0 when fast, as Stribeck friction falls."""
    speed = magnitude(motion.velocity) / parameters["stribeck_velocity"]
    return exp(-(speed ** parameters["stribeck_exponent"]))


def lost(joint: RecordedJoint, theta: Theta) -> Values:
    """Return the speed at which an excess is lost and its power, from a fit's."""
    return {
        "stribeck_velocity": theta["speed"] * joint.top_speed,
        "stribeck_exponent": theta["power"],
    }


class Friction(Law):
    """Friction of some level with the direction of the motion."""

    owner: Literal["robot", "human"] | None = "robot"
    lower: tuple[float, ...] = (0.0,)
    nonlinear: tuple[Nonlinear, ...] = (SMOOTH,)
    rubs = directed = at_reversals = True
    #: Whether the level is another from step to step, for which MuJoCo has no element.
    varies: bool = True

    @abstractmethod
    def level(self, parameters: Values, motion: Motion) -> Signal:
        """Return the size of the friction; negative where it would drive."""

    def torque(self, parameters: Values, motion: Motion) -> Signal:
        return self.level(parameters, motion) * motion.direction


class Coulomb(Friction):
    """Constant torque against the motion: F tanh(v / v0)."""

    name = "coulomb_friction"
    complexity = 1
    signature = "the residual steps with the sign of the velocity, at every speed alike"
    element = "joint/@frictionloss"
    separating_trial = "move to and fro through the same range at two constant speeds"
    parameters = named(torque=size("Nm", 3.0, "friction"))
    coefficients = ("torque",)
    varies = False

    def level(self, parameters: Values, motion: Motion) -> Signal:
        return parameters["torque"]

    def add(self, spec: "mujoco.MjSpec", joint: str, parameters: Values) -> str:
        joint_of(spec, joint).frictionloss += parameters["torque"]
        return self.element


class Viscous(Law):
    """Torque proportional to velocity."""

    name = "viscous_friction"
    complexity = 1
    signature = "the residual is a straight line through zero against velocity"
    element = "joint/@damping"
    separating_trial = "move to and fro through the same range at three speeds"
    owner = "robot"
    parameters = named(damping=size("Nm s/rad", 2.0, "further damping"))
    coefficients = ("damping",)
    lower = (0.0,)
    directed = filters = True

    def torque(self, parameters: Values, motion: Motion) -> Signal:
        return parameters["damping"] * motion.velocity

    def add(self, spec: "mujoco.MjSpec", joint: str, parameters: Values) -> str:
        add_damping(joint_of(spec, joint), parameters["damping"])
        return self.element


class Stribeck(Friction):
    """Coulomb friction that is higher when slow: (F + dF exp(-|v / vs|^p)) sign(v).

    Where a fit has found over which way it winds up before it slides (`way`, rad or m, in its
    parameters, with the `exponent` of `motion.wound` and what there is more when slow over the
    level, `ratio`), its bristles' state stands for the sign (`motion.bristles`).
    """

    name = "stribeck_friction"
    complexity = 3
    signature = "against velocity, the residual steps at zero and falls as the speed grows"
    separating_trial = "creep through the range, much slower than the slowest trial, both ways"
    includes = ("coulomb_friction",)
    parameters = named(
        torque=size("Nm", 3.0, "friction when fast"),
        breakaway_excess=size("Nm", 2.0, "how much more when slow"),
        stribeck_velocity=Parameter(
            "rad/s", "at which the excess is lost", 0.02, 0.5, neutral=0.1, floor=1e-3
        ),
        stribeck_exponent=EXPONENT,
    )
    coefficients = ("torque", "breakaway_excess")
    # Dry friction does not vanish when fast: that answers something else. (A stranger's drag.)
    needs_first = True
    nonlinear = (replace(SMOOTH, grid=COARSE.grid), SPEED, POWER)

    def level(self, parameters: Values, motion: Motion) -> Signal:
        excess = parameters["breakaway_excess"] * slowness(parameters, motion)
        return parameters["torque"] + excess

    def motion(self, joint: RecordedJoint, theta: Theta) -> RecordedJoint:
        motion = super().motion(joint, theta)
        if "way" not in theta:
            return motion
        if not theta["exponent"]:
            return replace(motion, winding=joint.wound(theta["way"], 0.0))
        levels = 1.0 + theta["ratio"] * np.asarray(slowness(self.fixed(joint, theta), joint))
        return replace(motion, winding=joint.bent(theta["way"], levels))

    def thetas(self, joint: RecordedJoint) -> list[Theta]:
        return [t for t in super().thetas(joint) if t["speed"] > 2 * t["smooth"]]

    def neighbours(self, theta: Theta, scale: float) -> list[Theta]:
        # The speed first: it matters more.
        found = super().neighbours(theta, scale)
        return sorted(found, key=lambda near: near["speed"] == theta["speed"])

    def fixed(self, joint: RecordedJoint, theta: Theta) -> Values:
        return lost(joint, theta)


class Asymmetric(Friction):
    """Another Coulomb and another viscous friction in each direction.

    Mean and half difference of the two levels are the coefficients: the half difference goes with
    |sign(v)|, a constant wherever the joint moves, which a neutral angle or an offset takes in
    whole. Then only the mean is known, and the slopes must tell the directions apart. Theirs are
    half difference and mean, which a declared damping takes in.
    """

    name = "asymmetric_friction"
    #: Mean damping is declared, or there already.
    complexity = 3
    signature = "steps and slopes against velocity differ between directions"
    separating_trial = "move to and fro at three speeds, with rests at both ends"
    includes = ("coulomb_friction", "viscous_friction")
    parameters = named(
        torque_positive=size("Nm", 3.0, "friction in flexion"),
        torque_negative=size("Nm", 3.0, "friction in extension"),
        viscous_difference=size(
            "Nm s/rad", 1.0, "damping in flexion less that in extension", low=-1.0
        ),
        viscous_mean=size("Nm s/rad", 1.0, "mean of both, beside what is declared"),
    )
    lower = (0.0, -np.inf, -np.inf, 0.0)
    undetermined = (1,)
    sided = True
    nonlinear = (SMOOTH, Nonlinear("viscous", (0.0, 1.0)))

    def level(self, parameters: Values, motion: Motion) -> Signal:
        speed, half = magnitude(motion.velocity), self._half_difference(parameters)
        viscous = half * motion.velocity + parameters.get("viscous_mean", 0.0) * speed
        return self._constant(parameters, motion) + viscous

    def torque(self, parameters: Values, motion: Motion) -> Signal:
        speed, half = magnitude(motion.velocity), self._half_difference(parameters)
        viscous = half * speed + parameters.get("viscous_mean", 0.0) * motion.velocity
        return self._constant(parameters, motion) * motion.direction + viscous

    def _constant(self, parameters: Values, motion: Motion) -> Signal:
        # Where the levels are declared already, only the slopes differ.
        positive = parameters.get("torque_positive", 0.0)
        return choose(motion.velocity > 0, positive, parameters.get("torque_negative", 0.0))

    def _half_difference(self, parameters: Values) -> float:
        return 0.5 * parameters.get("viscous_difference", 0.0)

    def readings(self, joint: RecordedJoint, theta: Theta) -> dict[str, Reading]:
        found = {
            "torque_positive": Reading(column=0, also=(1, 1.0)),
            "torque_negative": Reading(column=0, also=(1, -1.0)),
        }
        if theta["viscous"]:
            found["viscous_difference"] = Reading(column=2, scale=2.0)
            found["viscous_mean"] = Reading(column=3)
        return found


class PositionDependent(Friction):
    """Friction that varies along the range, as waves over position: teeth, bearings, eccentricity.

    (F + a sin(n x) / n + b (sin(n x / 2) / (n / 2))^2) sign(v), x from the middle of the range: a
    mean level and one wave of n periods a turn, in any phase, as a spectrum over position shows it
    (Popovic and Goldenberg 1998, IEEE Transactions on Robotics and Automation 14(1), 114-122). Of
    waves much longer than the range, n = 0, the parabola F + a x + b x^2 is left.
    """

    bounded = True
    name = "position_dependent_friction"
    complexity = 4
    signature = "the step with the velocity's sign changes along the range"
    separating_trial = "repeat one movement in another posture, so that load and position part"
    includes = ("coulomb_friction",)
    parameters = named(
        torque_middle=size("Nm", 3.0, "friction in the middle of the range"),
        torque_slope=size("Nm/rad", 1.0, "its slope there", low=-1.0),
        torque_curvature=size("Nm/rad2", 1.0, "half its second derivative there", low=-1.0),
        middle=Parameter("rad", "that middle", 0.5, 1.5, neutral=1.0, in_joint_frame=True),
        order=Parameter(PERIODS, "of a wave; 0 is a parabola", 0.0, 6.0, floor=0.0, choice=True),
    )
    lower = (0.0, -np.inf, -np.inf)
    nonlinear = (COARSE, WAVES)

    def level(self, parameters: Values, motion: Motion) -> Signal:
        order = parameters.get("order", 0.0)
        straight, bent = _waved(motion.position - parameters["middle"], order)
        varying = parameters["torque_slope"] * straight + parameters["torque_curvature"] * bent
        # Where Coulomb friction is declared already, only how it varies is the effect's own.
        return parameters.get("torque_middle", 0.0) + varying

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        # Over half the range, so that the columns are alike in size.
        sign = self.motion(joint, theta).direction
        middle, half = joint.travel
        straight, bent = _waved((joint.position - middle) / half, np.pi * theta["waves"])
        return {joint.number: np.column_stack([sign, sign * straight, sign * bent])}

    def fixed(self, joint: RecordedJoint, theta: Theta) -> Values:
        middle, half = joint.travel
        order = {"order": np.pi * theta["waves"] / half} if theta["waves"] else {}
        return {"middle": middle, **order}

    def readings(self, joint: RecordedJoint, theta: Theta) -> dict[str, Reading]:
        _, half = joint.travel
        fixed = self.fixed(joint, theta)
        return {
            "torque_middle": Reading(column=0),
            "torque_slope": Reading(column=1, scale=1 / half),
            "torque_curvature": Reading(column=2, scale=1 / half**2),
            **{name: Reading(value=value) for name, value in fixed.items()},
        }


def _waved(x: Signal, order: float) -> tuple[Signal, Signal]:
    """Return what begins at 0 as x and as its square, and is a wave; both themselves of order 0."""
    if not order:
        return x, x * x
    return sin(order * x) / order, (sin(0.5 * order * x) / (0.5 * order)) ** 2
