"""Play between a motor and its link: Nordin and Gutman 2002."""

from collections.abc import Iterator, Mapping

import numpy as np

from sim.effects.effect import Columns, Limits, Theta
from sim.effects.laws.loose_link import (
    AGREES,
    BEHIND,
    SHARE,
    LooseLink,
    damping_behind,
    inertia_behind,
    stiffness_behind,
    taken_before,
)
from sim.effects.motion import RecordedJoint
from sim.effects.parameter import RELATIVE, Nonlinear, Parameter, Reading, named

#: Samples of a flight through a gap that are computed at a time.
FLIGHT = 64
#: Shares of a limb's inertia with which a search begins: where the load changes sign depends on
#: them. (Set while looking at three of an opponent's limbs.)
BEGIN_BEHIND = (1.0, 0.6, 0.3, 0.15)


class Backlash(LooseLink):
    """Play between motor and limb: the limb lies on the side to which the load pushes it.

    Where the torque between the two changes sign the limb leaves its side, and flies by its own
    load until it meets the other one and stays there (Nordin and Gutman 2002, section 2.2, with
    an impact that is lost). The motor meanwhile carries nothing: with the limb ahead by x the
    balance lacks -(M x'' + D x' + (K + g') x). The column is that over the gap, of a flight
    through a gap of that size, so it is exact once both agree.
    """

    name = "backlash"
    complexity = 2
    signature = "the residual jerks just after the load changes sign, not where the velocity does"
    element = "applied torque"
    separating_trial = "move to and fro where the load changes sign, and again with a preload"
    parameters = named(gap=Parameter("rad", "whole play", floor=0.0), inertia_behind=SHARE)
    lower = (0.0,)
    nonlinear = (
        Nonlinear(
            "crossed",
            (0.002, 0.004, 0.008, 0.016, 0.032, 0.064, 0.128),
            scaling=0.4,
            over_travel=True,
        ),
        Nonlinear(BEHIND, BEGIN_BEHIND, scaling=0.2, step=RELATIVE),
    )
    uses_estimate = has_to_agree = timed = at_reversals = True

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        recording, number = joint.recording, joint.number
        gap = theta["crossed"] * joint.travel[1]
        share = theta.get(BEHIND, 1.0)
        behind = share * inertia_behind(joint, number)
        pull = (joint.estimate.carried[:, number] - taken_before(joint, number, theta)) / behind
        ahead = np.empty(len(pull))
        for piece in recording.slices:
            ahead[piece] = lies(pull[piece], gap, 1.0 / recording.rate)
        ahead = recording.smoothed(ahead)
        rate = recording.derivative(ahead)
        twice = recording.derivative(rate)
        own = behind * twice + damping_behind(joint, number, theta) * rate
        own += stiffness_behind(joint, number, theta) * ahead
        return {number: own[:, None], **_felt_by_others(joint, ahead, rate, twice)}

    def readings(self, joint: RecordedJoint, theta: Theta) -> dict[str, Reading]:
        gap = Reading(column=0, scale=theta["crossed"] * joint.travel[1])
        return {**super().readings(joint, theta), "gap": gap}

    def beyond(
        self,
        joint: RecordedJoint,
        theta: Theta,
        coefficients: Mapping[int, float],
        *,
        difference: bool = False,
    ) -> str:
        if 0 in coefficients and not 1.0 / AGREES < coefficients[0] < AGREES:
            return "gap"
        return super().beyond(joint, theta, coefficients, difference=difference)

    def limits(self, joint: RecordedJoint) -> Limits:
        # Play of half the travel is no transmission.
        return {**super().limits(joint), "gap": (0.0, joint.travel[1])}


def lies(pull: np.ndarray, gap: float, step: float) -> np.ndarray:
    """Return how far a limb lies ahead of its motor in a gap, rad or m, (n,).

    Args:
        pull: acceleration that the motor gives the limb where it carries it, rad/s2 or m/s2, (n,).
        gap: from one side to the other, rad or m.
        step: between samples, s.
    """
    half, count = 0.5 * gap, len(pull)
    ahead = np.empty(count)
    # A limb that is pulled lies behind.
    side = -1.0 if pull[0] > 0.0 else 1.0
    leaves = {side: np.flatnonzero(side * pull > 0.0) for side in (-1.0, 1.0)}
    start = 0
    while start < count:
        free = leaves[side]
        place = int(np.searchsorted(free, start))
        leave = int(free[place]) if place < len(free) else count
        ahead[start:leave] = side * half
        start = leave
        for flown in _flight(pull[leave:], side * half, step):
            out = np.flatnonzero(np.abs(flown) >= half)
            stop = start + (int(out[0]) if len(out) else len(flown))
            ahead[start:stop] = flown[: stop - start]
            start = stop
            if len(out):
                side = float(np.sign(flown[out[0]]))
                ahead[start] = side * half
                start += 1
                break
    return ahead


def _flight(pull: np.ndarray, begin: float, step: float) -> Iterator[np.ndarray]:
    """Yield where a limb is that nothing pulls while its motor moves on, a stretch at a time."""
    place, speed = begin, 0.0
    for start in range(0, len(pull), FLIGHT):
        speeds = speed - step * np.cumsum(pull[start : start + FLIGHT])
        places = place + step * np.cumsum(speeds)
        place, speed = float(places[-1]), float(speeds[-1])
        yield places


def _felt_by_others(
    joint: RecordedJoint, place: np.ndarray, speed: np.ndarray, twice: np.ndarray
) -> Columns:
    """Return the torques that a link takes of the other joints where it is ahead of its motor.

    Args:
        joint: whose link it is.
        place, speed, twice: by how much, and its first and second derivative, (n,).
    """
    recording, number = joint.recording, joint.number
    torque = (
        joint.inertia(number) * twice[:, None]
        + joint.drag(number) * speed[:, None]
        + joint.slope(number) * place[:, None]
    )
    return {other: torque[:, [other]] for other in recording.joints if other != number}
