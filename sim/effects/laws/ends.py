"""Elastic torques that begin at an angle near an end of a limb's range (Riener and Edrich 1999)."""

from collections.abc import Sequence
from itertools import product

from sim.effects.effect import Law, Limits, Theta
from sim.effects.functions import Signal, at_least, at_most, exp, expm1, log1p, magnitude
from sim.effects.laws.elastic import ONSET, SIDE, WIDTHS, sign_of
from sim.effects.motion import Motion, RecordedJoint
from sim.effects.parameter import RELATIVE, Nonlinear, Parameter, Values, named, size

#: Forms of such a torque by a power, and two codes for what is none: an exponential, and a straight
#: line that begins with a round corner. These have a width.
EXPONENTIAL, ROUND = 0.0, -1.0
WIDE = (EXPONENTIAL, ROUND)
POWERS = (1.0, 2.0, *WIDE)
#: Width with which a search begins, over half the range of motion; and where it comes from a power,
#: rad.
END_WIDTH, WIDTH = 0.35, 0.2
#: Unit of a steepness by the power.
STEEPNESS = {EXPONENTIAL: "Nm", ROUND: "Nm/rad", 1.0: "Nm/rad", 2.0: "Nm/rad2"}
#: Shares of half the travel beyond which the search for such a torque begins, and both its ends;
#: of both, the room between them may lie aside.
BEGINS, ENDS = (0.3, 0.45, 0.6, 0.75, 0.87), ((1.0, "positive"), (-1.0, "negative"))
ASIDE_BEGINS = (-0.5, -0.2, 0.1)


class EndRange(Law):
    """A spring that only begins at an angle near one end: K max(0, q - a)^p, or exponential."""

    limb = elastic = True
    name = "end_range_torque"
    complexity = 3
    signature = "the residual is flat but rises at one end, the same both ways"
    separating_trial = "move slowly beyond the angle where the torque begins, both ways"
    owner = "human"
    parameters = named(
        stiffness=size("Nm/rad", 20.0, "steepness (Nm/rad2 or Nm by the power)"),
        onset=Parameter("rad", "angle where it begins", 0.2, 1.8, neutral=1.5, in_joint_frame=True),
        side=SIDE,
        power=Parameter(
            "1",
            "1, 2; 0: exponential; -1: round corner",
            0.0,
            2.0,
            neutral=1.0,
            floor=ROUND,
            ceiling=4.0,
            choice=True,
        ),
        width=Parameter("rad", "of the last two", 0.1, 0.5, neutral=0.3, floor=0.01),
    )
    coefficients = ("stiffness",)
    lower = (0.0,)
    nonlinear = (
        Nonlinear("onset", shift=0.08, step=RELATIVE),
        Nonlinear("side"),
        Nonlinear("power"),
        # Of an exponential or a corner alone.
        Nonlinear("width", scaling=0.2, step=RELATIVE),
    )

    def torque(self, parameters: Values, motion: Motion) -> Signal:
        side, power = sign_of(parameters["side"]), parameters["power"]
        beyond = side * (motion.position - parameters["onset"])
        return side * parameters["stiffness"] * _rise(beyond, power, parameters.get("width", WIDTH))

    def thetas(self, joint: RecordedJoint) -> list[Theta]:
        middle, half = joint.travel
        width = {"width": END_WIDTH * half}
        return [
            {"side": side, "onset": middle + side * half * share, "power": power}
            | (width if power in WIDE else {})
            for side in (-1.0, 1.0)
            for share in BEGINS
            for power in POWERS
        ]

    def searches(self, theta: Theta) -> list[tuple[Theta, Limits]]:
        return _of_each_power(theta, ("onset",), ("width",))

    def unit(self, parameter: str, theta: Theta) -> str:
        if parameter != "stiffness":
            return super().unit(parameter, theta)
        return STEEPNESS[theta["power"]]


class BothEnds(Law):
    """`EndRange` at both ends of the range, of one form; K is that between them."""

    limb = elastic = True
    name = "end_range_both"
    complexity = 6
    signature = "the residual is flat but rises at both ends, the same both ways"
    separating_trial = "move slowly beyond the angles where the torque begins, both ways"
    includes = ("end_range_torque",)
    # Ends that are alike seem a cubic, or a wave over the range, as long as nothing else has both.
    grows_from = ("end_range_torque", "nonlinear_stiffness", "torque_ripple")
    not_beside = ("nonlinear_stiffness",)
    parameters = named(
        stiffness_positive=Parameter("Nm", "steepness in flexion", floor=0.0),
        stiffness_negative=Parameter("Nm", "in extension", floor=0.0),
        onset_positive=Parameter("rad", "where it begins", in_joint_frame=True),
        onset_negative=Parameter("rad", "in extension", in_joint_frame=True),
        power=Parameter("1", "as of one end", neutral=1.0, floor=ROUND, ceiling=4.0, choice=True),
        width_positive=Parameter("rad", "in flexion", neutral=0.3, floor=0.01),
        width_negative=Parameter("rad", "in extension", neutral=0.3, floor=0.01),
    )
    coefficients = ("stiffness_positive", "stiffness_negative")
    lower = (0.0,)
    nonlinear = (
        Nonlinear("onset_positive", shift=0.08, step=RELATIVE),
        Nonlinear("onset_negative", shift=0.08, step=RELATIVE),
        Nonlinear("power"),
        Nonlinear("width_positive", scaling=0.2, step=RELATIVE),
        Nonlinear("width_negative", scaling=0.2, step=RELATIVE),
    )

    def torque(self, parameters: Values, motion: Motion) -> Signal:
        rises = [
            side
            * parameters[f"stiffness_{end}"]
            * _rise(
                side * (motion.position - parameters[f"onset_{end}"]),
                parameters["power"],
                parameters.get(f"width_{end}", WIDTH),
            )
            for side, end in ENDS
        ]
        return rises[0] + rises[1]

    def thetas(self, joint: RecordedJoint) -> list[Theta]:
        middle, half = joint.travel
        widths = {f"width_{end}": END_WIDTH * half for _, end in ENDS}
        return [
            {
                "onset_positive": middle + half * above,
                "onset_negative": middle - half * below,
                "power": power,
            }
            | (widths if power in WIDE else {})
            for above, below in product((*ASIDE_BEGINS, *BEGINS), repeat=2)
            if above + below > 0.0
            for power in POWERS
        ]

    def searches(self, theta: Theta) -> list[tuple[Theta, Limits]]:
        onsets, widths = ([f"{what}_{end}" for _, end in ENDS] for what in ("onset", "width"))
        return _of_each_power(theta, onsets, widths)

    def limits(self, joint: RecordedJoint) -> Limits:
        middle, half = joint.travel
        within = (middle - half, middle + half)
        return {**super().limits(joint), "onset_positive": within, "onset_negative": within}

    def unit(self, parameter: str, theta: Theta) -> str:
        if not parameter.startswith("stiffness"):
            return super().unit(parameter, theta)
        return STEEPNESS[theta["power"]]


def _of_each_power(
    theta: Theta, onsets: Sequence[str], widths: Sequence[str]
) -> list[tuple[Theta, Limits]]:
    """Return the searches that begin with each power: between steps of an onset another may do."""
    bare = {name: value for name, value in theta.items() if name not in widths}
    free = {name: (theta[name] - ONSET, theta[name] + ONSET) for name in onsets}
    wide = {name: theta.get(name, WIDTH) for name in widths}
    found: list[tuple[Theta, Limits]] = []
    for power in sorted(POWERS, key=lambda power: power != theta["power"]):
        begin = {**bare, "power": power}
        if power in WIDE:
            found.append((begin | wide, free | dict.fromkeys(widths, WIDTHS)))
        else:
            found.append((begin, free))
    return found


def _rise(beyond: Signal, power: float, width: float) -> Signal:
    """Return how a torque rises with the way beyond where it begins, rad, none before it.

    A round corner begins a little before (the softplus of Dugas et al. 2001).
    """
    way = at_least(0.0, beyond)
    if power == ROUND:
        return way + width * log1p(exp(-magnitude(beyond) / width))
    return expm1(at_most(20.0, way / width)) if power == EXPONENTIAL else way**power
