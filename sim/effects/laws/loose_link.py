"""Links that do not follow their motors: a spring between the two, or play.

Spong 1987 (elastic joints); Nordin and Gutman 2002 (backlash). The motor's own inertia, damping and
friction lie before spring and gap, and its position is what is recorded.
"""

from collections.abc import Iterator, Mapping

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
#: Samples of a flight through a gap that are computed at a time.
FLIGHT = 64


class LooseLink(Effect):
    """A link that is not where its motor is, which the motors of the other joints feel, too."""


class SeriesElasticity(LooseLink):
    """A spring between the recorded position and the limb: the limb is twisted behind by d.

    The motor's own inertia and damping lie before the spring (Spong 1987). Behind it the link with
    M, D, K and the slope of gravity g' follows M d'' + (D + e) d' + (K + g' + k) d = u, where u is
    the torque that the link would need without a spring of k and e, and M, D and g' are those of
    where the arm is and how it moves; the balance changes by -(M d'' + D d' + (K + g') d). The
    column is that over the compliance 1 / k, which goes with the frequency at which the link swings
    on the spring, on average, so it is exact once both agree.

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
        load = joint.estimate.carried[:, number]
        spring, inertia = self._spring(joint, theta), _behind(joint)
        own = 2.0 * theta["damping_ratio"] * np.sqrt(spring * inertia.mean())
        # A first estimate may be such that nothing would hang on the spring stably.
        damping = max(float(joint.estimate.damping[number]), 0.0) + _drag(joint) + own
        stiffness = np.maximum(_stiffness(joint), -UPSIDE_DOWN * spring) + spring
        begins = np.array([piece.start for piece in recording.slices])
        ways = hanging(inertia, damping, stiffness, load, begins, 1.0 / recording.rate)
        felt = spring * ways[..., 0] + own * ways[..., 1]
        felt[:, 0] -= load
        decay = 0.5 * float(damping.mean() / inertia.mean())
        swings = _swings(joint, felt, decay)
        change = np.einsum("nw,nw->n", felt, swings)
        behind = np.einsum("nwk,nw->nk", ways, swings)
        return {
            number: (spring * change)[:, None],
            **_felt_by_others(joint, *(-spring * behind.T)),
        }

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
        return float(_behind(joint).mean()) * float(2.0 * np.pi * theta["resonance"]) ** 2


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
        ahead = recording.smoothed(ahead)
        rate = recording.derivative(ahead)
        twice = recording.derivative(rate)
        damping = joint.estimate.damping[number] + _drag(joint)
        own = _behind(joint) * twice + damping * rate + _stiffness(joint) * ahead
        return {number: own[:, None], **_felt_by_others(joint, ahead, rate, twice)}

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


def hanging(
    inertia: np.ndarray,
    damping: np.ndarray,
    stiffness: np.ndarray,
    load: np.ndarray,
    begins: np.ndarray,
    step: float,
) -> np.ndarray:
    """Return how what hangs on a spring moves: M x'' + D x' + K x = u, which all change with time.

    Between two samples M, D and K are their means and u changes evenly: then every step is exact,
    however quick the spring (Franklin, Powell and Workman 1998, Digital Control of Dynamic Systems,
    section 6.3, triangle hold). All steps are one system of equations with three diagonals below
    the main one.

    Args:
        inertia, damping, stiffness, load: M, D, K and u of every sample, (n,); K is above zero.
        begins: the first samples of stretches, in which it begins anew.
        step: between samples, s.

    Returns:
        Place, speed and acceleration, (n, 3, 3), under the load from where that would hold it
        still, and without a load from a place of 1 and from a speed of 1.
    """
    # What computes assessments knows this module, and needs no SciPy.
    from scipy.linalg.lapack import dtbtrs

    count = len(load)
    goes_on = np.ones(count, dtype=bool)
    goes_on[begins] = False
    later = np.flatnonzero(goes_on)
    place, speed = 2 * np.arange(count), 2 * np.arange(count) + 1
    mass, drag, held = (0.5 * (x[later - 1] + x[later]) for x in (inertia, damping, stiffness))
    swing = _swing(0.5 * drag / mass, held / mass, step)
    # A row for each diagonal, the main one first; a step goes from one sample to the next.
    band = np.zeros((4, 2 * count), order="F")
    band[0] = 1.0
    before, now = later - 1, later
    band[2, place[before]], band[1, speed[before]] = -swing[:, 0, 0], -swing[:, 0, 1]
    band[3, place[before]], band[2, speed[before]] = -swing[:, 1, 0], -swing[:, 1, 1]
    given = np.zeros((2 * count, 3), order="F")
    given[place[begins], 0] = load[begins] / stiffness[begins]
    given[place[begins], 1] = given[speed[begins], 2] = 1.0
    # Under a load that changes evenly it may go evenly, too.
    rate = (load[now] - load[before]) / step / held
    even = np.stack([(load[before] - drag * rate) / held, rate], axis=-1)
    driven = -np.einsum("nij,nj->ni", swing, even)
    given[place[now], 0] = even[:, 0] + rate * step + driven[:, 0]
    given[speed[now], 0] = rate + driven[:, 1]
    found, _ = dtbtrs(band, given, uplo="L", diag="U", overwrite_b=True)
    places, speeds = found[place], found[speed]
    force = np.zeros_like(places)
    force[:, 0] = load
    twice = (force - damping[:, None] * speeds - stiffness[:, None] * places) / inertia[:, None]
    return np.stack([places, speeds, twice], axis=-1)


def _swing(decay: np.ndarray, square: np.ndarray, step: float) -> np.ndarray:
    """Return what a step makes of place and speed of what nothing drives, (n, 2, 2).

    Args:
        decay: half of damping over inertia, 1/s, (n,).
        square: stiffness over inertia, 1/s2, (n,).
        step: s.
    """
    # Beyond critical damping the turn is imaginary, and both functions of it stay real.
    turn = np.sqrt(square - decay**2 + 0j)
    even = np.exp(-decay * step) * np.cos(turn * step).real
    odd = np.exp(-decay * step) * (step * np.sinc(turn * step / np.pi)).real
    first = np.stack([even + decay * odd, odd], axis=-1)
    return np.stack([first, np.stack([-square * odd, even - decay * odd], axis=-1)], axis=-2)


def _swings(joint: RecordedJoint, felt: np.ndarray, decay: float) -> np.ndarray:
    """Return how much of each way to move is there, (n, 3): 1, and what each piece began with.

    Args:
        joint: with the residual that the torque is a part of.
        felt: torque of each way to move, Nm or N, (n, 3).
        decay: of a swing, 1/s.
    """
    recording = joint.recording
    size = np.zeros_like(felt)
    size[:, 0] = 1.0
    if np.exp(-decay * recording.edge / recording.rate) < FADED:
        return size
    smooth = recording.filtered(felt)
    left = joint.estimate.residual[:, joint.number] - smooth[:, 0]
    good = recording.usable & np.isfinite(left)
    if recording.disturbed is not None:
        good &= ~recording.disturbed[:, joint.number]
    for piece in recording.slices:
        inside = slice(piece.start + recording.edge, piece.stop - recording.edge)
        own = inside.start + np.flatnonzero(good[inside])
        if len(own) > 2:
            size[piece, 1:] = np.linalg.lstsq(smooth[own, 1:], left[own], rcond=1e-6)[0]
    return size


def _behind(joint: RecordedJoint) -> np.ndarray:
    """Return the inertia that hangs behind the motor, kg m2 or kg, (n,)."""
    inertia = joint.inertia[:, joint.number]
    return np.maximum(inertia - joint.recording.motor_inertia(joint.number), LEAST_LINK * inertia)


def _drag(joint: RecordedJoint) -> np.ndarray:
    """Return what the link's own torque gains with its speed, as it moves, Nm s/rad or N s/m, (n,).

    The motor's damping lies before what is loose.
    """
    recording, number = joint.recording, joint.number
    return recording.drag(number)[:, number] - recording.motor_damping(number)


def _stiffness(joint: RecordedJoint) -> np.ndarray:
    """Return what the link's own torque gains with its position, Nm/rad or N/m, (n,)."""
    recording, number = joint.recording, joint.number
    slope = recording.secant(number, 1e-4)[:, number]
    return np.asarray(joint.estimate.stiffness[number] + slope)


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
        joint.inertia * twice[:, None]
        + recording.drag(number) * speed[:, None]
        + recording.secant(number, 1e-4) * place[:, None]
    )
    return {other: torque[:, [other]] for other in recording.joints if other != number}
