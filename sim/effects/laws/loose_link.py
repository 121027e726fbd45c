"""Links that do not follow their motors: a spring between the two.

Spong 1987 (elastic joints). The motor's own inertia, damping and friction lie before what is loose,
and its position is what is recorded.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sim.effects.effect import Columns, Effect, Limits, Theta
from sim.effects.hanging import hanging, over, times
from sim.effects.laws.abrupt import abrupt_starts, begun_calmly
from sim.effects.motion import RecordedJoint, Spring
from sim.effects.parameter import RELATIVE, Nonlinear, Parameter, named

#: Factor by which a compliance and that of its resonance may differ: set, as the last of these,
#: while looking at sessions of the unkind bench with seeds below 400. A gap may by no more.
AGREES = 2.0
#: Least share of a joint's inertia that lies behind a spring.
LEAST_LINK = 0.05
#: Damping ratio from which on nothing answers more at its resonance than below it.
PEAKED = 0.5**0.5
#: A share that is as near to its bound is there.
AT_BOUND = 0.01
#: A limb above its axis falls off a spring that is weaker than its weight: most of that slope.
UPSIDE_DOWN = 0.5
#: Where a link may swing on its spring, Hz, at the least, and where that is looked for: steps of a
#: quarter, as wide as the least damped swings.
SLOWEST = 0.5
RESONANCES = (1.5, 1.9, 2.4, 3.0, 3.7, 4.6, 5.8, 7.2, 9.0, 11.0, 14.0, 18.0, 25.0)
#: Share of a swing that samples have to show for them to determine it: it may have faded before
#: the first of them, or be quicker than the low-pass lets through.
FADED = 0.1
#: Non-linear parameter of what is loose at a limb: the share of the inertia, less the motor's, that
#: hangs behind it, and the least that a limb can have (set while looking at two of the unkind
#: bench's limbs, tuning seeds, that had a spring too many; so were the slowest and the peak below).
BEHIND = "inertia_behind"
LEAST_LIMB = 0.1
SHARE = Parameter("1", "share behind it (limb)", neutral=1.0, floor=LEAST_LIMB, ceiling=1.0)
#: The share of the weight that does; and of what is fitted as the limb's damping that acts behind a
#: spring: the motor's friction is before it.
WEIGHED, DAMPED = "weight_behind", "damping_behind"
#: Factor by which the lengths of the pendulums that device and limb are may differ, which the odds
#: of both shares differ by (set on one of our own sessions, which 4 kept from its own shares); and
#: shares that are near enough anyway.
PENDULUMS, NEAR = 8.0, 0.05
#: Times that it is asked how far a limb is behind its spring and how stiff it is there; a way, rad
#: or m, that is none.
SECANTS, LITTLE = 3, 1e-6
#: A weight below this share of the largest effort is none.
LEVEL = 1e-3


class LooseLink(Effect):
    """A link that is not where its motor is, which the motors of the other joints feel, too."""

    def thetas(self, joint: RecordedJoint) -> list[Theta]:
        # What is loose in a robot is its gear: all that it moves hangs behind.
        nothing = {BEHIND, DAMPED, WEIGHED}
        if joint.number in joint.recording.limbs:
            largest = float(np.abs(joint.effort).max())
            level = np.abs(_weight(joint, joint.number)).max() < LEVEL * largest
            nothing = {WEIGHED} if level else set()
        asked = (
            tuple((name, value) for name, value in theta.items() if name not in nothing)
            for theta in super().thetas(joint)
        )
        return [dict(once) for once in dict.fromkeys(asked)]


class SeriesElasticity(LooseLink):
    """A spring between the recorded position and the limb: the limb is twisted behind by d.

    The motor's own inertia and damping lie before the spring (Spong 1987); before one between a
    device and a limb, as that of cuffs on soft tissue, so do the device's links and friction: which
    shares of inertia, weight and damping are behind it is fitted. A swing that is damped so much
    that it has no peak is none: such a spring did what friction that winds up does (while looking
    at an opponent's). Behind it the link with M, D, K and the slope of gravity g' follows
    M d'' + (D + e) d' + (K + g' + k) d = u, where u is the torque that the link would need without
    a spring of k and e, and M, D and g' are those of where the arm is and how it moves; the balance
    changes by -(M d'' + D d' + (K + g') d). The column is that over the compliance 1 / k, which
    goes with the frequency at which the link swings on the spring, on average, so it is exact once
    both agree. What else is elastic of a limb is part of K by its secant over d (`_secant`).

    How the link swings when a piece of the recording begins nothing says but what is left of that
    piece: its initial state is fitted to it, in held-out trials too, as is usual where predictions
    are compared with data (Ljung 1999, System Identification).
    """

    name = "series_elasticity"
    complexity = 2
    signature = "the residual follows the torque's second derivative: it rings"
    element = "applied torque"
    separating_trial = "push the joint with short pulses, and record the limb's own angle"
    parameters = named(
        compliance=Parameter("rad/Nm", "1 / k", floor=0.0),
        resonance=Parameter("Hz", "at which the limb swings on it", neutral=25.0, floor=SLOWEST),
        damping_ratio=Parameter("1", "of that swing", floor=0.0, ceiling=PEAKED),
        inertia_behind=SHARE,
        weight_behind=replace(SHARE, floor=LEAST_LINK),
        damping_behind=replace(SHARE, floor=LEAST_LINK),
    )
    coefficients = ("compliance",)
    lower = (0.0,)
    nonlinear = (
        Nonlinear("resonance", RESONANCES, scaling=0.2, step=RELATIVE),
        Nonlinear("damping_ratio", (0.05, 0.2), scaling=0.5, step=RELATIVE),
        Nonlinear(BEHIND, (1.0,), scaling=0.2, step=RELATIVE),
        Nonlinear(WEIGHED, (1.0,), scaling=0.2, step=RELATIVE),
        Nonlinear(DAMPED, (1.0,), scaling=0.2, step=RELATIVE),
    )
    uses_estimate = has_to_agree = filters = True

    def columns(self, joint: RecordedJoint, theta: Theta) -> Columns:
        others = {n: spring for n, spring in joint.estimate.springs.items() if n != joint.number}
        thetas = {**{n: spring.theta for n, spring in others.items()}, joint.number: theta}
        there = _of_springs(joint, others)
        change = sum(_parts(joint, thetas, there).values()) - there
        scale = _spring(joint, joint.number, theta)
        return {number: scale * change[:, [number]] for number in joint.recording.joints}

    def limits(self, joint: RecordedJoint) -> Limits:
        # A spring that the usual effort twists further than the joint travels holds nothing.
        usual = float(np.sqrt(np.mean(joint.effort**2)))
        return {**super().limits(joint), "compliance": (0.0, joint.travel[1] / max(usual, 1e-300))}

    def beyond(
        self,
        joint: RecordedJoint,
        theta: Theta,
        coefficients: Mapping[int, float],
        *,
        difference: bool = False,
    ) -> str:
        if 0 in coefficients:
            agrees = coefficients[0] * _spring(joint, joint.number, theta)
            if not 1.0 / AGREES < agrees < AGREES:
                return "compliance"
        # A search that ends at a bound has found no link, or none that swings.
        if theta.get(BEHIND, 1.0) < LEAST_LIMB + AT_BOUND:
            return BEHIND
        if theta["damping_ratio"] > PEAKED - AT_BOUND:
            return "damping_ratio"
        if theta["resonance"] < SLOWEST + AT_BOUND:
            return "resonance"
        one, other = theta.get(BEHIND, 1.0), _weighed(theta)
        one, other = one * (1.0 - other), other * (1.0 - one)
        if not other / PENDULUMS - NEAR < one < other * PENDULUMS + NEAR:
            return WEIGHED
        return super().beyond(joint, theta, coefficients, difference=difference)


def springs_apart(joint: RecordedJoint, thetas: Mapping[int, Theta]) -> dict[int, Columns]:
    """Return the columns of springs beside each other, by their joints.

    What a link's being elsewhere takes of every joint is its own spring's.

    Args:
        joint: one of theirs; the springs of its estimate are left out.
        thetas: non-linear parameters of each spring.
    """
    apart: dict[int, Columns] = {}
    there = _of_springs(joint, joint.estimate.springs)
    for number, part in _parts(joint, thetas, there).items():
        column = _spring(joint, number, thetas[number]) * part
        apart[number] = {other: column[:, [other]] for other in joint.recording.joints}
    return apart


def springs_together(joint: RecordedJoint, thetas: Mapping[int, Theta]) -> Columns:
    """Return what springs add to every joint's torque, Nm or N, (n, 1), as in `springs_apart`."""
    there = _of_springs(joint, joint.estimate.springs)
    both = sum(_parts(joint, thetas, there).values(), np.zeros_like(there))
    return {number: both[:, [number]] for number in joint.recording.joints}


def _of_springs(joint: RecordedJoint, springs: Mapping[int, Spring]) -> np.ndarray:
    """Return what springs add to the torque of every joint, Nm or N, (n, joints)."""
    nothing = np.zeros_like(joint.recording.position)
    return sum((spring.torque for spring in springs.values()), nothing)


def _parts(
    joint: RecordedJoint, thetas: Mapping[int, Theta], there: np.ndarray
) -> dict[int, np.ndarray]:
    """Return what each of several springs adds to the torque of every joint, Nm or N, (n, joints).

    Args:
        joint: one of those with a spring.
        thetas: non-linear parameters of the spring at each.
        there: torque of springs that the estimate holds already, Nm or N, (n, joints).
    """
    recording, joints = joint.recording, list(thetas)
    # Time comes last in what follows, which is as `hanging` has it.
    load = (joint.estimate.carried - there)[:, joints].T
    for at, (number, theta) in enumerate(thetas.items()):
        load[at] -= taken_before(joint, number, theta)
    shares = np.array([theta.get(BEHIND, 1.0) for theta in thetas.values()])
    inertias, drags, slopes = (
        shares[:, None] * np.stack([of(number).T for number in joints], axis=1)
        for of in (joint.inertia, joint.drag, joint.slope)
    )
    inertia, damping, stiffness = (x[joints] for x in (inertias, drags, slopes))
    springs, own = np.empty((2, len(joints), 1, 1))
    for at, (number, theta) in enumerate(thetas.items()):
        inertia[at, at] = shares[at] * inertia_behind(joint, number)
        springs[at] = spring = _spring(joint, number, theta)
        own[at] = 2.0 * theta["damping_ratio"] * np.sqrt(spring * inertia[at, at].mean())
        damping[at, at] = damping_behind(joint, number, theta) + own[at]
        stiff = stiffness_behind(joint, number, theta)
        # A first estimate may be such that nothing would hang on the spring stably.
        least = -UPSIDE_DOWN * spring
        held = spring + np.maximum(stiff, least)
        if number in joint.estimate.elastic:
            stiff = stiff + _secant(joint, number, load[at], held)
        stiffness[at, at] = spring + np.maximum(stiff, least)
    begins = np.array([piece.start for piece in recording.slices])
    loads, abrupt = load[:, None], abrupt_starts(load, recording)
    if abrupt:
        loads = np.stack([load, begun_calmly(load, recording)], axis=1)
    ways = hanging(inertia, damping, stiffness, loads, begins, 1.0 / recording.rate)
    felt = springs * ways[0] + own * ways[1]
    felt[:, : loads.shape[1]] -= loads + there[:, joints].T[:, None]
    size = _swings(joint, joints, felt, abrupt)
    place, speed = np.einsum("wn,kmwn->kmn", size, ways)[:, :, None]
    load = np.einsum("wn,mwn->mn", size[: loads.shape[1]], loads)[:, None]
    twice = over(inertia, load - times(damping, speed) - times(stiffness, place))
    parts = -(inertias * twice[:, 0] + drags * speed[:, 0] + slopes * place[:, 0])
    whole = (springs * place + own * speed - load)[:, 0]
    for at, number in enumerate(joints):
        # What the others' being elsewhere takes of it is theirs.
        others = [other for other in range(len(joints)) if other != at]
        parts[number, at] = whole[at] - parts[number, others].sum(axis=0)
    return {number: parts[:, at].T for at, number in enumerate(joints)}


def _secant(
    joint: RecordedJoint, number: int, load: np.ndarray, stiffness: np.ndarray
) -> np.ndarray:
    """Return what is lost of a limb's elastic torque over the way that it is behind, over that way.

    The way is that of a limb which goes slowly, against how fast it swings on its spring.

    Args:
        joint: one of the recording, with its estimate.
        number: of the limb's joint.
        load: that the limb would need without a spring, Nm or N, (n,).
        stiffness: of the spring and what else holds the limb, Nm/rad or N/m, (n,).

    Returns:
        Nm/rad or N/m, (n,).
    """
    torque, secant = joint.estimate.elastic[number], np.zeros_like(load)
    whole = torque(secant)
    for _ in range(SECANTS):
        behind = load / np.maximum(stiffness + secant, UPSIDE_DOWN * stiffness)
        behind = np.where(np.abs(behind) > LITTLE, behind, LITTLE)
        secant = (whole - torque(behind)) / behind
    return secant


def _swings(
    joint: RecordedJoint, joints: list[int], felt: np.ndarray, abrupt: Sequence[int]
) -> np.ndarray:
    """Return how much of each way to move is there, (ways, n): 1, and what each piece began with.

    Args:
        joint: one of those that hang on springs.
        joints: all of those.
        felt: what each way to move adds to their torque, Nm or N, (joints, ways, n).
        abrupt: pieces in which the second load is, instead of the first, if less is left with it.
    """
    recording, loads = joint.recording, felt.shape[1] - 2 * len(joints)
    passed = np.moveaxis(recording.filtered(np.moveaxis(felt, -1, 0)), 0, -1)
    before = joint.estimate.residual[:, joints].T
    left = before[:, None] - passed[:, :loads]
    good = np.isfinite(left).all(axis=1) & recording.usable
    if recording.disturbed is not None:
        good &= ~recording.disturbed[:, joints].T
    left = np.where(good[:, None], left, 0.0)
    # Joints are weighed by what is left of them.
    mean, usual = _rms(left, good[:, None]), _rms(before[:, None], good[:, None])
    pieces, edge = recording.slices, recording.edge
    within = [slice(piece.start + edge, max(piece.stop - edge, 0)) for piece in pieces]
    shows = np.zeros(good.shape)
    for own in within:
        shows[:, own] = good[:, own]

    def by_piece(each: np.ndarray) -> np.ndarray:
        starts = [piece.start for piece in pieces]
        return np.asarray(np.add.reduceat(each, starts, axis=-1).sum(axis=0))

    # What faded where samples were lost no sample shows: it came out as any size. (A stranger's.)
    squares, smooth = felt[:, loads:] ** 2, passed[:, loads:] * shows[:, None]
    seen = np.minimum(by_piece(squares * shows[:, None]), by_piece(smooth**2))
    shown = seen > FADED**2 * by_piece(squares)
    shown &= by_piece(shows) > np.count_nonzero(shown, axis=0)
    size = np.zeros(felt.shape[1:])
    for number, (piece, own) in enumerate(zip(pieces, within, strict=True)):
        which = np.flatnonzero(shown[:, number])
        ways, load = smooth[:, which, own], 0
        found = _began(ways, left[:, 0, own], mean[:, 0])
        if number in abrupt:
            other = _began(ways, left[:, 1, own], mean[:, 1])
            rest = left[:, :, own] - np.einsum("mwn,wk->mkn", ways, np.transpose([found, other]))
            first, second = np.sum((rest / usual) ** 2, axis=(0, 2))
            if second < first:
                load, found = 1, other
        size[load, piece] = 1.0
        size[loads + which, piece] = found[:, None]
    return size


def _rms(signals: np.ndarray, good: np.ndarray) -> np.ndarray:
    """Return the root mean squares, (m, k, 1) and not 0, of the `good` of signals, (m, k, n)."""
    squares = np.where(good, signals, 0.0) ** 2
    count = np.maximum(np.count_nonzero(good, axis=-1, keepdims=True), 1)
    return np.asarray(np.maximum(np.sqrt(squares.sum(axis=-1, keepdims=True) / count), 1e-300))


def _began(ways: np.ndarray, left: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Return how much of each way to move, (w,), is in what is left.

    Args:
        ways: torque of each joint for each, Nm or N, (m, w, n).
        left: of each joint, Nm or N, (m, n).
        mean: by what each is weighed, (m, 1).
    """
    rows = (ways / mean[:, None]).swapaxes(0, 1).reshape(ways.shape[1], left.size)
    return np.asarray(np.linalg.lstsq(rows.T, (left / mean).ravel(), rcond=1e-6)[0])


def _spring(joint: RecordedJoint, number: int, theta: Theta) -> float:
    """Return the stiffness on which a joint's link swings so fast, on average, Nm/rad or N/m."""
    inertia = theta.get(BEHIND, 1.0) * float(inertia_behind(joint, number).mean())
    return inertia * (2.0 * np.pi * theta["resonance"]) ** 2


def inertia_behind(joint: RecordedJoint, number: int) -> np.ndarray:
    """Return the inertia that hangs behind the motor of a joint, kg m2 or kg, (n,)."""
    inertia = joint.inertia(number)[:, number]
    return np.maximum(inertia - joint.recording.motor_inertia(number), LEAST_LINK * inertia)


def taken_before(joint: RecordedJoint, number: int, theta: Theta) -> np.ndarray:
    """Return what links and damping before what is loose take, Nm or N, (n,).

    Args:
        joint: one of the recording, with its estimate.
        number: of the joint with what is loose.
        theta: non-linear parameters of that.
    """
    recording, velocity = joint.recording, joint.recording.velocity[:, number]
    motor = recording.motor_inertia(number) * recording.acceleration[:, number]
    motor = motor + recording.motor_damping(number) * velocity
    links = recording.rigid[:, number] - motor + joint.estimate.shared[:, number]
    weight, drag = _weight(joint, number), _limb_damping(joint, number) * velocity
    before = (1.0 - theta.get(BEHIND, 1.0)) * (links - weight)
    before += (1.0 - _weighed(theta)) * weight + (1.0 - theta.get(DAMPED, 1.0)) * drag
    return np.asarray(before)


def _weight(joint: RecordedJoint, number: int) -> np.ndarray:
    """Return what holds a joint's declared links against gravity, Nm or N, (n,)."""
    return np.asarray(joint.recording.weight(number) @ joint.recording.gravity)


def _weighed(theta: Theta) -> float:
    """Return the share of the weight behind what is loose: the inertia's if nothing is said."""
    return theta.get(WEIGHED, theta.get(BEHIND, 1.0))


def damping_behind(joint: RecordedJoint, number: int, theta: Theta) -> np.ndarray:
    """Return what the torque behind gains with its speed, as it moves, Nm s/rad or N s/m, (n,).

    The motor's damping lies before what is loose.
    """
    links = joint.drag(number)[:, number] - joint.recording.motor_damping(number)
    own = theta.get(DAMPED, 1.0) * _limb_damping(joint, number)
    return np.asarray(own + theta.get(BEHIND, 1.0) * links)


def _limb_damping(joint: RecordedJoint, number: int) -> float:
    """Return what is fitted as damping; a first estimate may be such that it would drive."""
    return max(float(joint.estimate.damping[number]), 0.0)


def stiffness_behind(joint: RecordedJoint, number: int, theta: Theta) -> np.ndarray:
    """Return what the torque behind gains with its position, Nm/rad or N/m, (n,).

    Of the links that is the slope of their weight.
    """
    own = joint.estimate.stiffness[number]
    return np.asarray(own + _weighed(theta) * joint.slope(number)[:, number])
