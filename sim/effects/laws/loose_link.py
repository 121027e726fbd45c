"""Links that do not follow their motors: a spring between the two.

Spong 1987 (elastic joints). The motor's own inertia, damping and friction lie before what is loose,
and its position is what is recorded.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sim.effects.effect import Columns, Effect, Limits, Theta
from sim.effects.hanging import hanging
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
    load = joint.estimate.carried - there
    for number, theta in thetas.items():
        load[:, number] -= taken_before(joint, number, theta)
    shares = np.array([theta.get(BEHIND, 1.0) for theta in thetas.values()])
    inertias = shares * np.stack([joint.inertia(n) for n in joints], axis=-1)
    drags = shares * np.stack([joint.drag(n) for n in joints], axis=-1)
    slopes = shares * np.stack([joint.slope(n) for n in joints], axis=-1)
    inertia, damping, stiffness = (x[:, joints].copy() for x in (inertias, drags, slopes))
    springs, own = np.empty((2, len(joints)))
    for place, (number, theta) in enumerate(thetas.items()):
        itself, share = (slice(None), place, place), float(shares[place])
        inertia[itself] = share * inertia_behind(joint, number)
        springs[place] = _spring(joint, number, theta)
        own[place] = 2.0 * theta["damping_ratio"] * np.sqrt(springs[place] * inertia[itself].mean())
        damping[itself] = damping_behind(joint, number, theta) + own[place]
        stiff = stiffness_behind(joint, number, theta)
        # A first estimate may be such that nothing would hang on the spring stably.
        least = -UPSIDE_DOWN * springs[place]
        held = springs[place] + np.maximum(stiff, least)
        if number in joint.estimate.elastic:
            stiff = stiff + _secant(joint, number, load[:, number], held)
        stiffness[itself] = springs[place] + np.maximum(stiff, least)
    begins = np.array([piece.start for piece in recording.slices])

    def hung(load: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        ways = hanging(inertia, damping, stiffness, load, begins, 1.0 / recording.rate)
        felt = springs[:, None] * ways[:, 0] + own[:, None] * ways[:, 1]
        felt[..., 0] -= load
        return ways, felt, *_swings(joint, joints, felt, there[:, joints])

    ways, felt, swings, left = hung(load[:, joints])
    if abrupt := abrupt_starts(load[:, joints], recording):
        calm = hung(begun_calmly(load[:, joints], recording))
        for number in abrupt:
            if calm[3][number] < left[number]:
                piece = recording.slices[number]
                for one, other in zip((ways, felt, swings), calm[:3], strict=True):
                    one[piece] = other[piece]
    place, speed, twice = np.moveaxis(np.einsum("nkmw,nw->nkm", ways, swings)[:, :, None], 1, 0)
    parts = -(inertias * twice + drags * speed + slopes * place)
    whole = np.einsum("nmw,nw->nm", felt, swings)
    for at, number in enumerate(joints):
        # What the others' being elsewhere takes of it is theirs.
        others = [other for other in range(len(joints)) if other != at]
        parts[:, number, at] = whole[:, at] - parts[:, number, others].sum(axis=1)
    return {number: parts[..., at] for at, number in enumerate(joints)}


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
    joint: RecordedJoint, joints: list[int], felt: np.ndarray, there: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return how much of each way to move is there, (n, ways): 1, and what each piece began with.

    And the squares of what is left with it in each piece, over those of what was before, (pieces,).

    Args:
        joint: one of those that hang on springs.
        joints: all of those.
        felt: their torque for each way to move, Nm or N, (n, joints, ways).
        there: torque of springs that the estimate holds already, Nm or N, (n, joints).
    """
    recording = joint.recording
    size = np.zeros((len(felt), felt.shape[2]))
    size[:, 0] = 1.0
    before = joint.estimate.residual[:, joints]
    left = before + recording.filtered(there - felt[..., 0])
    good = np.isfinite(left) & recording.usable[:, None]
    if recording.disturbed is not None:
        good &= ~recording.disturbed[:, joints]
    # Joints are weighed by what is left of them.
    mean = np.maximum(np.sqrt(np.mean(left**2, axis=0, where=good)), 1e-300)
    scale = mean / np.maximum(np.sqrt(np.mean(before**2, axis=0, where=good)), 1e-300)
    weight = good / mean
    left = np.where(good, left, 0.0) * weight
    pieces = recording.slices
    within = [slice(piece.start + recording.edge, piece.stop - recording.edge) for piece in pieces]

    def seen(ways: np.ndarray, where: np.ndarray, parts: Sequence[slice]) -> np.ndarray:
        each = [np.einsum("nm,nmw,nmw->w", where[own], ways[own], ways[own]) for own in parts]
        return np.array(each)

    # What faded where samples were lost no sample shows: it came out as any size. (A stranger's.)
    begun = felt[..., 1:]
    least = FADED**2 * seen(begun, np.ones(good.shape), pieces)
    shown = seen(begun, good.astype(float), within) > least
    smooth = recording.filtered(begun) if np.any(shown) else np.zeros_like(begun)
    shown &= seen(smooth, good.astype(float), within) > least
    for piece, inside, own in zip(pieces, within, shown, strict=True):
        if np.count_nonzero(good[inside]) > np.count_nonzero(own) > 0:
            ways = (smooth[inside][..., own] * weight[inside, :, None]).reshape(-1, own.sum())
            found = np.linalg.lstsq(ways, left[inside].reshape(-1), rcond=1e-6)[0]
            size[piece, 1 + np.flatnonzero(own)] = found
            left[inside] -= (ways @ found).reshape(left[inside].shape)
    return size, np.array([float(np.sum((left[own] * scale) ** 2)) for own in within])


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
