"""Elastic torques of a joint beyond the declared linear spring, and that spring.

Passive joint torque is flat in the middle of the range and steep towards its ends (Riener and
Edrich 1999); MuJoCo has polynomial `stiffness` and soft joint ranges for both.
"""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal

import numpy as np

from sim.effects.effect import Columns, Effect, Law, Limits, Theta
from sim.effects.elements import add_damping, add_spring, joint_of
from sim.effects.functions import Signal, magnitude, tanh
from sim.effects.motion import Motion, RecordedJoint, Recording
from sim.effects.parameter import RELATIVE, Nonlinear, Parameter, Values, named, size

if TYPE_CHECKING:
    import mujoco

#: How wide the part of an elastic torque may be that bends, and how far its middle may be from
#: where it seemed, rad.
WIDTHS, ONSET = (0.02, 0.5), 0.2
#: Power that stands for tanh, and those of a spring that yields.
TANH = 0.0
YIELDING = (TANH, 2.0, 1.0)
#: Over half the travel: widths with which the search for a spring that yields begins; the widest
#: one, of which a cubic says the same; and how far it may be from the middle, beyond which only one
#: side of it is seen. (Set while looking at a stranger's three, and at sets of names of our own.)
YIELDS, WIDEST_YIELD, ASIDE_YIELD = (0.2, 0.45), 0.7, 0.5
#: Which way a one-sided effect acts.
SIDE = Parameter(
    "1",
    "+1 in flexion, -1 in extension",
    -1.0,
    1.0,
    neutral=1.0,
    choice=True,
    in_joint_frame=True,
)


def sign_of(side: float) -> float:
    """Return the sign of a side, which a study may sample between -1 and 1."""
    return 1.0 if side >= 0.0 else -1.0


class Viscoelastic(Effect):
    """The declared impedance of the paper's equation (3): K (q - q0) + D q'.

    Not a candidate: a session declares it, and the fit tells K, D and the torque -K q0.
    """

    name = "viscoelastic_joint"
    complexity = 3
    signature = "the torque is a plane over position and velocity"
    element = "joint/@stiffness, joint/@damping"
    separating_trial = "move through the whole range, both ways, at three speeds"
    includes = ("torque_offset", "viscous_friction", "joint_stiffness")
    parameters = named(
        stiffness=Parameter("Nm/rad", "K"),
        damping=Parameter("Nm s/rad", "D"),
        neutral_angle=Parameter("rad", "q0", in_joint_frame=True),
    )

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        q, v = joint.position, joint.velocity
        return {joint.number: np.column_stack([q, v, np.ones_like(q)])}

    def impedance(self, coefficients: Mapping[int, float], gain: float) -> dict[str, float]:
        """Return stiffness, damping and neutral angle (NaN without stiffness).

        Args:
            coefficients: by column; one that was dropped is zero.
            gain: torque at the joint over the effort: it divides the whole balance, so what the
                fit calls K is K over the gain.
        """
        k, d, c = (coefficients.get(i, 0.0) * gain for i in range(3))
        neutral = -c / k if abs(k) > 1e-9 else float("nan")
        return {"stiffness": k, "damping": d, "neutral_angle": neutral}

    def add(self, spec: "mujoco.MjSpec", joint: str, parameters: Values) -> str:
        target = joint_of(spec, joint)
        add_spring(target, parameters["stiffness"], parameters["neutral_angle"])
        add_damping(target, parameters["damping"])
        return self.element


class JointStiffness(Law):
    """A linear spring: K (q - q_ref)."""

    bounded = True
    name = "joint_stiffness"
    complexity = 2
    signature = "the residual is a straight line against position, the same both ways"
    element = "joint/@stiffness"
    separating_trial = "move slowly through the whole range, both ways"
    includes = ("torque_offset",)
    parameters = named(
        stiffness=Parameter("Nm/rad", "of the spring", floor=0.0),
        torque_at_zero=Parameter("Nm", "what the motor adds at position 0"),
    )
    coefficients = ("stiffness", "torque_at_zero")
    lower = (0.0, -np.inf)

    def torque(self, parameters: Values, motion: Motion) -> Signal:
        return parameters["stiffness"] * motion.position + parameters["torque_at_zero"]

    def add(self, spec: "mujoco.MjSpec", joint: str, parameters: Values) -> str:
        k = parameters["stiffness"]
        neutral = -parameters["torque_at_zero"] / k if k else 0.0
        add_spring(joint_of(spec, joint), k, neutral)
        return self.element


class NonlinearStiffness(Law):
    """A spring that hardens, or softens if K3 is below 0: K3 (q - c)^3."""

    limb = elastic = bounded = True
    name = "nonlinear_stiffness"
    complexity = 2
    signature = "against position the residual bends at both ends, the same both ways"
    separating_trial = "move slowly through a wider range, both ways"
    owner: Literal["robot", "human"] | None = "human"
    parameters = named(
        cubic_stiffness=size(
            "Nm/rad3", 5.0, "hardening of the limb's joint; below 0 it softens", low=-5.0
        ),
        centre=Parameter("rad", "angle without torque", 0.5, 1.5, neutral=1.0, in_joint_frame=True),
    )
    # One that yields nearly undoes one that hardens: it is the one or the other.
    not_beside: tuple[str, ...] = ("softening_stiffness",)
    coefficients: tuple[str, ...] = ("cubic_stiffness",)
    nonlinear = (Nonlinear("centre", shift=0.1, step=RELATIVE),)

    def torque(self, parameters: Values, motion: Motion) -> Signal:
        way = motion.position - parameters["centre"]
        # A hundred times as fast as a power of an array.
        cubic = parameters["cubic_stiffness"] * way * way * way
        # Of a robot's (`HardeningSpring`), whose law this is, too.
        linear = parameters.get("stiffness", 0.0) * motion.position
        return cubic + linear + parameters.get("torque_at_zero", 0.0)

    def thetas(self, joint: RecordedJoint) -> list[Theta]:
        middle, half = joint.travel
        return [{"centre": middle + half * share} for share in np.linspace(-1.4, 1.4, 15)]


class SofteningStiffness(Law):
    """A spring that yields: T f((q - c) / w), stiff within w of c and hardly so far from it.

    f(x) is tanh x, or x / (1 + |x|^n)^(1 / n). The declared K is then that far from c; at c it is
    K + T / w.
    """

    limb = elastic = True
    name = "softening_stiffness"
    complexity = 3
    signature = "against position the residual is an S, the same both ways"
    separating_trial = "move slowly through a wider range, both ways"
    parameters = named(
        torque=Parameter("Nm", "at which it yields; over the width, stiffness beyond K", floor=0.0),
        centre=Parameter("rad", "angle without torque", in_joint_frame=True),
        width=Parameter("rad", "from there until it yields", neutral=0.3, floor=0.02),
        power=Parameter("1", "1 or 2; 0: tanh", floor=0.0, ceiling=4.0, choice=True),
    )
    coefficients = ("torque",)
    lower = (0.0,)
    not_beside = ("nonlinear_stiffness",)
    nonlinear = (
        Nonlinear("centre", shift=0.05, step=RELATIVE),
        Nonlinear("width", scaling=0.2, step=RELATIVE),
        Nonlinear("power"),
    )

    def torque(self, parameters: Values, motion: Motion) -> Signal:
        away = (motion.position - parameters["centre"]) / parameters["width"]
        if parameters["power"] == TANH:
            return parameters["torque"] * tanh(away)
        power = parameters["power"]
        return parameters["torque"] * away / (1.0 + magnitude(away) ** power) ** (1.0 / power)

    def thetas(self, joint: RecordedJoint) -> list[Theta]:
        middle, half = joint.travel
        return [
            {"centre": middle + half * share, "width": half * width, "power": TANH}
            for share in np.linspace(-ASIDE_YIELD, ASIDE_YIELD, 5)
            for width in YIELDS
        ]

    def searches(self, theta: Theta) -> list[tuple[Theta, Limits]]:
        centre = theta["centre"]
        free = {"centre": (centre - ONSET, centre + ONSET), "width": WIDTHS}
        return [({**theta, "power": power}, free) for power in YIELDING]

    def limits(self, joint: RecordedJoint) -> Limits:
        middle, half = joint.travel
        aside = ASIDE_YIELD * half
        return {
            **super().limits(joint),
            "centre": (middle - aside, middle + aside),
            "width": (self.parameters["width"].floor, WIDEST_YIELD * half),
        }


class HardeningSpring(NonlinearStiffness):
    """A joint's spring and what hardens of it, one cause: K (q - q_ref) + K3 (q - c)^3.

    Of a robot's joint, which has no declared stiffness that would take in K: bundles of cables,
    balancers, springs of rubber.
    """

    limb = elastic = False
    complexity = 4
    owner = None
    includes = ("torque_offset", "joint_stiffness")
    parameters = named(
        cubic_stiffness=Parameter("Nm/rad3", "by which the spring hardens; below 0 it softens"),
        centre=Parameter("rad", "angle where it is least stiff", in_joint_frame=True),
        stiffness=Parameter("Nm/rad", "of the spring there"),
        torque_at_zero=Parameter("Nm", "what the motor adds at position 0"),
    )
    coefficients = ("cubic_stiffness", "stiffness", "torque_at_zero")

    def applies(self, recording: Recording, joint: int) -> bool:
        return super().applies(recording, joint) and joint not in recording.limbs
