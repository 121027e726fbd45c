"""Links that do not follow their motors: a spring between the two, or play.

Spong 1987 (elastic joints); Nordin and Gutman 2002 (backlash). The motor's own inertia, damping and
friction lie before spring and gap, and its position is what is recorded.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from sim.effects.effect import Columns, Effect, Limits, Theta
from sim.effects.motion import RecordedJoint
from sim.effects.parameter import RELATIVE, Nonlinear, Parameter, Reading, named

#: Factor by which a compliance and that of its resonance may differ: set, as the last of these,
#: while looking at sessions of the unkind bench with seeds below 400. A gap may by no more.
AGREES = 2.0
#: Least share of a joint's inertia that lies behind a spring.
LEAST_LINK = 0.05
#: A limb above its axis falls off a spring that is weaker than its weight: most of that slope.
UPSIDE_DOWN = 0.5
#: Where a link may swing on its spring, Hz: steps of a quarter, as wide as the least damped swings.
RESONANCES = (1.5, 1.9, 2.4, 3.0, 3.7, 4.6, 5.8, 7.2, 9.0, 11.0, 14.0, 18.0, 25.0)
#: What a swing has faded to, before the first samples that show it, is not determined by them.
FADED = 0.1
#: Times that the twist is computed anew for how it leans.
LEANS = 3
#: Samples of a flight through a gap that are computed at a time.
FLIGHT = 64


class SeriesElasticity(Effect):
    """A spring between the recorded position and the limb: the limb is twisted behind by d.

    The motor's own inertia and damping lie before the spring (Spong 1987). Behind it the link with
    M, D, K and the slope of gravity g' follows M d'' + (D + e) d' + (K + g' + k) d = u, where u is
    the torque that the link would need without a spring of k and e; the balance changes by
    -(M d'' + D d' + (K + g') d). The column is that over the compliance 1 / k, which goes with the
    frequency at which the link swings on the spring, so it is exact once both agree.

    How the link swings when a piece of the recording begins nothing says but what is left of that
    piece: its initial state is fitted to it, in held-out trials too, as is usual where predictions
    are compared with data (Ljung 1999, System Identification).
    """

    name = "series_elasticity"
    complexity = 2
    signature = (
        "the residual follows the second derivative of the torque: ringing after fast changes"
    )
    element = "applied torque"
    separating_trial = "push the joint with short pulses, and record the limb's own angle"
    parameters = named(
        compliance=Parameter("rad/Nm", "1 / k", floor=0.0),
        resonance=Parameter("Hz", "at which the limb swings on the spring", floor=0.0),
        damping_ratio=Parameter("1", "of that swing by the spring's own damping", floor=0.0),
    )
    coefficients = ("compliance",)
    lower = (0.0,)
    nonlinear = (
        Nonlinear("resonance", RESONANCES, scaling=0.2, step=RELATIVE),
        Nonlinear("damping_ratio", (0.05, 0.2), scaling=0.5, step=RELATIVE),
    )
    uses_estimate = has_to_agree = filters = True

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        recording, number = joint.recording, joint.number
        estimate = joint.estimate
        inertia, stiffness = self._link(joint)
        load = estimate.carried[:, number]
        spring = self._spring(joint, theta)
        # A first estimate may be such that nothing would hang on the spring stably.
        damping = max(float(estimate.damping[number]), 0.0)
        stiffness = max(stiffness, -UPSIDE_DOWN * spring)
        own = 2.0 * theta["damping_ratio"] * np.sqrt(spring * inertia)
        lost = [inertia, damping, stiffness]
        whole = [inertia, damping + own, stiffness + spring]
        # Where the slope of gravity is not its mean, what is twisted leans as if by a further load.
        slope = recording.secant(number, 1e-4)[:, number]
        slope = (slope - np.nanmean(slope)) / spring
        leans = np.zeros(len(load))
        for _ in range(LEANS):
            pull = load - leans
            twisted = recording.through(pull[:, None], [-x for x in lost], whole)[:, 0]
            leans = slope * (pull + twisted)
        swings = _swings(joint, whole, twisted - leans)
        return {number: ((twisted - leans + (1.0 - slope) * swings) * spring)[:, None]}

    def beyond(
        self,
        joint: RecordedJoint,
        theta: Theta,
        coefficients: Mapping[int, float],
        *,
        difference: bool = False,
    ) -> str:
        if 0 in coefficients:
            agrees = coefficients[0] * self._spring(joint, theta)
            if not 1.0 / AGREES < agrees < AGREES:
                return "compliance"
        return super().beyond(joint, theta, coefficients, difference=difference)

    def _spring(self, joint: RecordedJoint, theta: Theta) -> float:
        inertia, _ = self._link(joint)
        return inertia * (2.0 * np.pi * theta["resonance"]) ** 2

    def _link(self, joint: RecordedJoint) -> tuple[float, float]:
        """Return mean inertia and stiffness of what hangs behind the spring."""
        recording, number = joint.recording, joint.number
        inertia = float(np.nanmean(recording.own_inertia[:, number]))
        inertia = max(inertia - recording.motor_inertia(number), LEAST_LINK * inertia)
        slope = float(np.nanmean(recording.secant(number, 1e-4)[:, number]))
        return inertia, float(joint.estimate.stiffness[number]) + slope


class Backlash(Effect):
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
    parameters = named(gap=Parameter("rad", "whole play", floor=0.0))
    lower = (0.0,)
    nonlinear = (
        Nonlinear(
            "crossed",
            (0.002, 0.004, 0.008, 0.016, 0.032, 0.064, 0.128),
            scaling=0.4,
            over_travel=True,
        ),
    )
    uses_estimate = has_to_agree = timed = at_reversals = True

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        recording, number = joint.recording, joint.number
        gap = theta["crossed"] * joint.travel[1]
        pull = joint.estimate.carried[:, number] / _behind(joint)
        ahead = np.empty(len(pull))
        for piece in recording.slices:
            ahead[piece] = lies(pull[piece], gap, 1.0 / recording.rate)
        return {number: _felt(joint, recording.smoothed(ahead))[:, None]}

    def readings(self, joint: RecordedJoint, theta: Theta) -> dict[str, Reading]:
        return {"gap": Reading(column=0, scale=theta["crossed"] * joint.travel[1])}

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
        return {"gap": (0.0, joint.travel[1])}


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


def _swings(joint: RecordedJoint, whole: Sequence[float], torque: np.ndarray) -> np.ndarray:
    """Return what swings from before each piece began add to a torque, Nm or N, (n,).

    Args:
        joint: with the residual that the torque is a part of.
        whole: inertia, damping and stiffness of what swings.
        torque: without them, (n,).
    """
    recording = joint.recording
    inertia, damping, stiffness = whole
    decay = 0.5 * damping / inertia
    turn = np.sqrt(max(stiffness / inertia - decay**2, 0.0))
    out = np.zeros(len(torque))
    if not turn or np.exp(-decay * recording.edge / recording.rate) < FADED:
        return out
    since = np.concatenate(
        [np.arange(piece.stop - piece.start) / recording.rate for piece in recording.slices]
    )
    fades = np.exp(-decay * since)
    modes = np.column_stack([fades * np.cos(turn * since), fades * np.sin(turn * since)])
    smooth = recording.filtered(np.column_stack([torque, modes]))
    left = joint.estimate.residual[:, joint.number] - smooth[:, 0]
    good = recording.usable & np.isfinite(left)
    if recording.disturbed is not None:
        good &= ~recording.disturbed[:, joint.number]
    for piece in recording.slices:
        inside = slice(piece.start + recording.edge, piece.stop - recording.edge)
        own = inside.start + np.flatnonzero(good[inside])
        if len(own) > 2:
            size = np.linalg.lstsq(smooth[own, 1:], left[own], rcond=1e-6)[0]
            out[piece] = modes[piece] @ size
    return out


def _behind(joint: RecordedJoint) -> np.ndarray:
    """Return the inertia that hangs behind the motor, kg m2 or kg, (n,)."""
    inertia = joint.recording.own_inertia[:, joint.number]
    return np.maximum(inertia - joint.recording.motor_inertia(joint.number), LEAST_LINK * inertia)


def _felt(joint: RecordedJoint, ahead: np.ndarray) -> np.ndarray:
    """Return the torque that a limb ahead by `ahead` (rad or m, (n,)) takes: M, D and K of it."""
    recording, estimate, number = joint.recording, joint.estimate, joint.number
    rate = recording.derivative(ahead)
    twice = recording.derivative(rate)
    # The slope of gravity and declared springs over the joint's own position.
    slope = estimate.stiffness[number] + recording.secant(number, 1e-4)[:, number]
    return np.asarray(_behind(joint) * twice + estimate.damping[number] * rate + slope * ahead)
