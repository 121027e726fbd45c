"""Friction that grows with the load of a joint.

Dependence on load after Swevers, Verdonck and De Schutter 2007; the ladder of laws M3 to M6 after
Duclusaud et al. 2025 (github Rhoban/bam).
"""

from dataclasses import replace
from typing import Literal

import numpy as np

from sim.effects.effect import Columns, Theta
from sim.effects.functions import Signal, choose, magnitude
from sim.effects.laws.friction import COARSE, EXPONENT, POWER, SPEED, Friction, lost, slowness
from sim.effects.motion import Motion, RecordedJoint
from sim.effects.parameter import Nonlinear, Parameter, Values, named, size

#: Friction that takes more than this share of the load locks a transmission: nobody could move the
#: robot by hand. What looks like it is Coulomb friction beside something else.
MAX_LOAD_SHARE = 0.5


def share(description: str) -> Parameter:
    """Return a share of the load that friction takes."""
    return Parameter("1", description, floor=0.0, ceiling=MAX_LOAD_SHARE)


class Loaded(Friction):
    """Friction that knows the load of its joint; the laws beyond M3 grow from that one."""

    owner: Literal["robot", "human"] | None = None
    includes: tuple[str, ...] = ("coulomb_friction", "load_dependent_friction")
    grows_from: tuple[str, ...] = ("load_dependent_friction",)
    nonlinear: tuple[Nonlinear, ...] = (COARSE, Nonlinear("load", (0, 1)))
    uses_estimate = True

    def motion(self, joint: RecordedJoint, theta: Theta) -> RecordedJoint:
        # Which load a law is told is a choice.
        loads = (
            joint.recording.static[:, joint.number],
            joint.estimate.prediction[:, joint.number],
            np.nan_to_num(joint.recording.effort[:, joint.number]),
        )
        return replace(joint, smooth=theta["smooth"], load=loads[int(theta["load"])])


class LoadDependent(Loaded):
    """Friction that grows with the joint's load: (F + mu |load|) sign(v)."""

    owner = "robot"
    name = "load_dependent_friction"
    complexity = 2
    signature = "the step with the velocity's sign grows with the load"
    separating_trial = "repeat one movement with a known mass attached"
    includes = ("coulomb_friction",)
    grows_from = ()
    parameters = named(
        torque=size("Nm", 3.0, "friction without load"),
        load_share=replace(
            size("1", 0.3, "further friction over the motor's torque"), ceiling=MAX_LOAD_SHARE
        ),
    )
    coefficients = ("torque", "load_share")
    nonlinear = (COARSE, Nonlinear("load", (0, 1, 2)))
    leaves_out = (
        "friction that goes with the motor's torque instead of the joint's, or the other way"
    )

    def unsaid(self, joint: RecordedJoint, theta: Theta, coefficients: np.ndarray) -> Columns:
        """Return by how much friction differs if it goes with the other torque of the two.

        A motor that carries u has |u| - |u - F| more of a load than its joint, the friction F where
        it drives and less of it where it is driven. While both move that is a stiffness, too: the
        square of the share, 4 % of K for a fifth (an opponent's limbs).
        """
        if len(coefficients) < len(self.coefficients):
            return {}
        effort = np.nan_to_num(joint.recording.effort[:, joint.number])
        torque, own = (float(size) for size in coefficients)
        further = own * (torque * np.sign(effort) + own * effort)
        return {joint.number: further[:, None]}

    def level(self, parameters: Values, motion: Motion) -> Signal:
        return parameters["torque"] + parameters["load_share"] * magnitude(motion.load)


class StribeckLoad(Loaded):
    """Load and Stribeck together (M4): both levels grow with the load.

    (F + mu |load| + (dF + dmu |load|) exp(-|v / vs|^p)) sign(v).
    """

    name = "stribeck_load_friction"
    complexity = 5
    signature = "the step with the velocity's sign grows with the load, and more so when slow"
    separating_trial = "creep through the range with and without a known mass, both ways"
    includes = ("coulomb_friction", "load_dependent_friction", "stribeck_friction")
    grows_from = ("load_dependent_friction", "stribeck_friction")
    parameters = named(
        torque=Parameter("Nm", "friction without load when fast", floor=0.0),
        load_share=share("further friction over the motor's torque"),
        breakaway_excess=Parameter("Nm", "how much more when slow", floor=0.0),
        slow_load_share=share("the same over the torque"),
        stribeck_velocity=Parameter(
            "rad/s", "at which the excess is lost", neutral=0.1, floor=1e-3
        ),
        stribeck_exponent=EXPONENT,
    )
    coefficients = ("torque", "load_share", "breakaway_excess", "slow_load_share")
    nonlinear = (
        COARSE,
        SPEED,
        POWER,
        Nonlinear("load", (0, 1)),
    )

    def level(self, parameters: Values, motion: Motion) -> Signal:
        load = magnitude(motion.load)
        fast = parameters["torque"] + parameters["load_share"] * load
        excess = parameters["breakaway_excess"] + parameters["slow_load_share"] * load
        return fast + excess * slowness(parameters, motion)

    def fixed(self, joint: RecordedJoint, theta: Theta) -> Values:
        return lost(joint, theta)


class DirectionalLoad(Loaded):
    """Load-dependent friction that knows who drives (M5): the motor or the load.

    (F + mu |load|) sign(v), with one mu where the motor moves the load and another where the load
    moves the motor. Duclusaud et al. write |mu_e tau_e - mu_m tau_m| with motor torque tau_m and
    external torque tau_e; where acceleration is small, the motor's torque is the load plus or minus
    friction, and that is the same law: mu = (mu_e + mu_m) / (1 -+ mu_m).
    """

    name = "directional_load_friction"
    complexity = 3
    signature = "lifting a load takes more friction than lowering it gives back"
    separating_trial = "lift and lower a known mass through the same range"
    parameters = named(
        torque=Parameter("Nm", "friction without load", floor=0.0),
        driving_share=share("friction over the load where the motor drives"),
        driven_share=share("friction over the load where the load drives"),
    )
    coefficients = ("torque", "driving_share", "driven_share")

    def level(self, parameters: Values, motion: Motion) -> Signal:
        driving = motion.load * motion.velocity > 0
        shares = choose(driving, parameters["driving_share"], parameters["driven_share"])
        return parameters["torque"] + shares * magnitude(motion.load)


class QuadraticLoad(Loaded):
    """Friction that grows faster than the load (M6): (F + mu |load| + kappa load^2) sign(v)."""

    name = "quadratic_load_friction"
    complexity = 3
    signature = "the step with the velocity's sign grows with the load, faster at large loads"
    separating_trial = "repeat one movement with three known masses"
    parameters = named(
        torque=Parameter("Nm", "friction without load", floor=0.0),
        load_share=share("further friction over the motor's torque"),
        load_curvature=Parameter("1/Nm", "further friction over its square", floor=0.0),
    )
    coefficients = ("torque", "load_share", "load_curvature")

    def level(self, parameters: Values, motion: Motion) -> Signal:
        load = magnitude(motion.load)
        linear = parameters["torque"] + parameters["load_share"] * load
        return linear + parameters["load_curvature"] * load * load
