"""Of gears: ripple, and friction that winds up before it slides.

Dahl 1968 (friction that depends on the way since reversal); Pfeiffer and Holzl 1995 (ripple).
"""

from collections.abc import Callable

import numpy as np

from sim.effects.effect import TURNS, AppliedEffect, Columns, Law, Limits, Theta, turns_freely
from sim.effects.functions import Signal, cos, exp, sin
from sim.effects.motion import PRESLIDING_SHARE, Motion, RecordedJoint
from sim.effects.parameter import (
    PERIODS,
    RELATIVE,
    Nonlinear,
    Parameter,
    Values,
    named,
    size,
)

#: Periods over the travel of which a period has come back: of fewer, a smooth curve is as good.
COMES_BACK = 2.0
#: ... and the fewest that are looked for: a limb turns less than most robots. (Of limbs, set while
#: looking at a stranger's eleven.)
OF_LIMBS, OF_ROBOTS = 0.5, 1.0


class TorqueRipple(Law):
    """A torque that is periodic in position: cogging, gear teeth, commutation."""

    name = "torque_ripple"
    complexity = 3
    signature = "the residual is periodic in position, the same at every speed"
    separating_trial = "move slowly and evenly through the range, both ways"
    owner = "robot"
    parameters = named(
        cosine=size("Nm", 1.0, "ripple, cosine part", low=-1.0),
        sine=size("Nm", 1.0, "its sine part", low=-1.0),
        order=Parameter(PERIODS, "of the ripple", 1.0, 40.0, neutral=12.0, choice=True),
    )
    coefficients = ("cosine", "sine")
    nonlinear = (Nonlinear("order", scaling=0.01, step=RELATIVE),)
    uses_estimate = True

    def torque(self, parameters: Values, motion: Motion) -> Signal:
        angle = parameters["order"] * motion.position
        return parameters["cosine"] * cos(angle) + parameters["sine"] * sin(angle)

    def thetas(self, joint: RecordedJoint) -> list[Theta]:
        """Return the orders that stand out in the residual's spectrum over position."""
        residual = joint.estimate.residual[:, joint.number]
        good = np.isfinite(residual) & (np.abs(joint.velocity) > 2 * joint.rest_speed)
        _, half = joint.travel
        if good.sum() < 200:
            return []
        limb = joint.number in joint.recording.limbs
        orders = 0.25 * np.pi / half * np.arange(4 * (OF_LIMBS if limb else OF_ROBOTS), 238)
        power = beyond_a_line(joint.position[good], residual[good], orders)
        around = np.concatenate([[0.0], power, [0.0]])
        peaks = np.flatnonzero((power > around[:-2]) & (power >= around[2:]))
        best = peaks[np.argsort(power[peaks])[::-1][:4]]
        return [
            {"order": float(orders[peak] + shift * np.pi / half)}
            for peak in best
            for shift in (-0.12, 0.0, 0.12)
        ]

    def limits(self, joint: RecordedJoint) -> Limits:
        if joint.number not in joint.recording.limbs:
            return super().limits(joint)
        return {**super().limits(joint), "order": (OF_LIMBS * np.pi / joint.travel[1], np.inf)}

    def unlikely(self, joint: RecordedJoint, theta: Theta) -> bool:
        periods = theta["order"] * joint.travel[1] / np.pi
        return periods < COMES_BACK


#: Way over which a transmission winds up at most where its joint turns for ever, rad.
WOUND = 2.0 * np.pi * TURNS
#: Ways over which something winds up, over half the travel.
WAYS = (0.03, 0.042, 0.06, 0.085, 0.12, 0.17, 0.25, 0.35, 0.5)
#: How what winds up does so; part of `Hysteresis` and of what else winds up.
EXPONENT = Parameter(
    "1",
    "Dahl's: 1 winds up ever more slowly, 0 is a spring",
    neutral=1.0,
    floor=0.0,
    ceiling=1.0,
    choice=True,
)


class Hysteresis(AppliedEffect):
    """Friction that builds up over a distance after each reversal (Dahl's model).

    dz/dq = (1 - sign(v) z)^exponent / distance; of an exponent of 0 a spring that yields remains.
    """

    name = "hysteresis"
    complexity = 2
    signature = "after each reversal the residual rises over the same distance, not the same time"
    separating_trial = "move to and fro with small and with large amplitudes at one speed"
    parameters = named(
        torque=Parameter("Nm", "once it slides", floor=0.0),
        distance=Parameter("rad", "over which it builds up", floor=0.0),
        exponent=EXPONENT,
    )
    coefficients = ("torque",)
    lower = (0.0,)
    nonlinear = (
        Nonlinear("distance", WAYS, scaling=0.4, step=RELATIVE, over_travel=True),
        Nonlinear("exponent", (1.0, 0.0)),
    )
    rubs = directed = at_reversals = winds = remembers = True

    def limits(self, joint: RecordedJoint) -> Limits:
        least = PRESLIDING_SHARE * joint.travel[1]
        # What turns for ever winds nothing up over more than cables do.
        free = turns_freely(joint.recording, joint.number)
        return {**super().limits(joint), "distance": (least, WOUND if free else np.inf)}

    def thetas(self, joint: RecordedJoint) -> list[Theta]:
        most = self.limits(joint)["distance"][1]
        return [t for t in super().thetas(joint) if t["distance"] * joint.travel[1] <= most]

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        """Return the friction state along the recorded motion; each piece starts at 0."""
        fixed = self.fixed(joint, theta)
        return {joint.number: joint.wound(fixed["distance"], fixed["exponent"])[:, None]}

    def simulated(self, parameters: Values, step: float) -> Callable[[Motion], float]:
        state = 0.0

        def torque(motion: Motion) -> float:
            nonlocal state
            way = float(motion.velocity) * step
            exponent = parameters.get("exponent", 1.0)
            state = self.wound(state, way, parameters["distance"], exponent)
            return parameters["torque"] * state

        return torque

    @staticmethod
    def wound(state: float, way: float, distance: float, exponent: float) -> float:
        """Return the state, -1 to 1, after a way from `state`, with its sign; in closed form."""
        if exponent == 0.0:
            return min(1.0, max(-1.0, state + way / distance))
        sign = float((way > 0) - (way < 0))
        left = float(exp(-abs(way) / distance))
        return sign + (state - sign) * left if sign else state


def beyond_a_line(position: np.ndarray, torque: np.ndarray, orders: np.ndarray) -> np.ndarray:
    """Return how much of a torque waves over position explain beside a line, Nm2 or N2, (orders,).

    Least squares at each order (Zechmeister and Kuerster 2009, The generalised Lomb-Scargle
    periodogram, with a slope beside the mean): positions come where the motion dwells, and a sum
    over them takes what a spring and an offset leave for long waves.

    Args:
        position: rad or m, (n,).
        torque: Nm or N, (n,).
        orders: waves over 2 pi of position, ascending.
    """
    low, high = float(position.min()), float(position.max())
    # Sixteen places a wave, so that places stand for the samples around them.
    count = 1 + int(16 * (high - low) * orders[-1] / (2 * np.pi))
    place = np.minimum(((position - low) / (high - low) * count).astype(int), count - 1)
    weight = np.bincount(place, minlength=count).astype(float)
    taken = weight > 0
    mean = np.bincount(place, torque, minlength=count)[taken] / weight[taken]
    weight = np.sqrt(weight[taken])
    x = (np.flatnonzero(taken) + 0.5) / count
    line, _ = np.linalg.qr(weight[:, None] * np.column_stack([np.ones(len(x)), x]))
    left = weight * mean
    left = left - line @ (line.T @ left)
    found = np.empty(len(orders))
    for number, order in enumerate(orders):
        angle = order * (high - low) * x
        waves = weight[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        waves, _ = np.linalg.qr(waves - line @ (line.T @ waves))
        found[number] = float(((waves.T @ left) ** 2).sum())
    return found
