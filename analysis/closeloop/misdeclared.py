"""What of a robot's declaration its trials contradict: signs, exchanged columns, gravity.

Effects are looked for beside what is declared, so a sign that is wrong there ends in a wrong name.
The mistakes that are made most each have one remedy, which is tried: an effort is turned round, two
or two joints' positions are exchanged, one joint is counted the other way round, gravity acts
another way or not at all. One is right if it
leaves less than half of what the declaration leaves, beside friction, inertia and an offset of
every joint, and whatever the links' masses; of several the one that leaves least is told.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import nnls

from analysis.closeloop.errors import SessionError
from analysis.closeloop.remedies import scaled, with_motions_exchanged
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.runs import TRAVEL
from analysis.closeloop.session.signals import rms

#: Share of what is left under the declaration that a remedy may leave.
LEAVES = 0.5
#: The same of what is left if a counterweight is the reason.
BALANCED = 0.8
#: Share of an effort's variance below which what is left says nothing.
LITTLE = 0.1
#: Share of a declared weight below which an effort does not hold it: nearer to none than to half.
UNFELT = 0.25
#: Width of the step of friction, over the root mean square of the velocity.
STEP = 0.05
#: Standard gravity, m/s2.
STANDARD = 9.80665


@dataclass(frozen=True)
class Joint:
    """One joint's part of what is compared, low-passed, over the trials that are fitted."""

    number: int
    name: str
    #: Its effort, and torque of the declared links, in motion and held, (r,).
    effort: np.ndarray
    declared: np.ndarray
    static: np.ndarray
    #: What holds it in one m/s2 of gravity along x, y and z, (r, 3).
    weight: np.ndarray
    #: Where it is, from its middle, (r,).
    position: np.ndarray
    #: Velocity, its direction, acceleration, and a constant of either sign, (r, 5).
    unknown: np.ndarray

    def left(
        self,
        effort: np.ndarray,
        gravity: np.ndarray | None = None,
        *,
        balanced: bool = False,
        sprung: bool = False,
    ) -> float:
        """Return the share of an effort's variance that this joint's torque leaves of it.

        Args:
            effort: its own or another's, (r,).
            gravity: further gravity, m/s2, (3,).
            balanced: whether something may pull harder than the links, the other way.
            sprung: whether a spring may.
        """
        known = self.declared if gravity is None else self.declared + self.weight @ gravity
        # Inertia resists with a counterweight, too.
        pulling = [self.static, -self.static] if balanced else []
        pulling += [self.position, -self.position] if sprung else []
        table = np.column_stack([known, *pulling, self.unknown, effort - effort.mean()])
        # Nothing but the constants may be negative: links, friction and inertia resist.
        triangle = np.asarray(np.linalg.qr(table, mode="r"))
        _, rest = nnls(triangle[:, :-1], triangle[:, -1])
        return float(rest**2) / max(float(table[:, -1] @ table[:, -1]), 1e-300)


def check_declared(recording: Recording) -> None:
    """Refuse a robot's session with an effort turned round, or with efforts or positions exchanged.

    Of limbs nothing is asked: their stiffness takes in what gravity does (`signs` has theirs).

    Raises:
        SessionError: names the joint's column in the first trial.
    """
    joints = _joints(recording)
    wrong, left = _wrong_columns(joints)
    for looked_for in (_exchanged_positions, _turned_positions):
        found = looked_for(recording, joints, LEAVES * left)
        if found is not None:
            wrong, left = [found[0]], found[1]
    gravity = _other_gravity(recording, joints)
    if not wrong or (gravity is not None and gravity[1] < left):
        return
    column, why = wrong[0]
    first = recording.session.trials[recording.fit_trials[0]].file
    raise SessionError(why, file=first, column=column)


def doubtful_gravity(recording: Recording) -> list[str]:
    """Return a sentence if a robot moves as in another gravity, or its model has none itself."""
    joints = _joints(recording)
    gravity = _other_gravity(recording, joints)
    found = [gravity[0]] if gravity is not None else [*_unfelt_weights(joints)]
    model = recording.device.model
    compensated = [model.body(b).name for b in range(model.nbody) if model.body_gravcomp[b]]
    if compensated:
        found.append(
            f"the declared model compensates gravity itself (gravcomp of {', '.join(compensated)}),"
            " as few logged efforts do: leave gravcomp out if yours hold the links"
        )
    return found


def _joints(recording: Recording) -> list[Joint]:
    """Return what the joints of a robot without a limb show; nothing of another device."""
    limbs = set(recording.limbs).intersection(recording.joints)
    return [] if limbs else [*_moved(recording)]


def _moved(recording: Recording) -> Iterator[Joint]:
    for number in recording.joints:
        rows = np.isfinite(recording.effort[:, number]) & recording.usable
        rows &= np.isin(recording.trial, recording.fit_trials)
        velocity = recording.velocity[:, number]
        spread = rms(velocity[rows]) if rows.any() else 0.0
        if not spread:
            continue
        one = np.ones(len(velocity))
        unknown = np.column_stack(
            [velocity, np.tanh(velocity / (STEP * spread)), recording.acceleration[:, number]]
        )
        # Without declared damping, which may be anybody's guess: velocity has its own unknown.
        rigid = recording.rigid[:, number] - recording.motor_damping(number) * velocity
        links = [rigid, recording.static[:, number], recording.weight(number)]
        position = recording.position[:, number] - recording.position[rows, number].mean()
        table = recording.filtered(np.column_stack([*links, unknown, position]))[rows]
        yield Joint(
            number=number,
            name=recording.name(number),
            effort=recording.effort[rows, number],
            declared=table[:, 0],
            static=table[:, 1],
            weight=table[:, 2:5],
            position=table[:, -1],
            unknown=np.column_stack([table[:, 5:-1], one[rows], -one[rows]]),
        )


def _exchanged_positions(
    recording: Recording, joints: list[Joint], most: float
) -> tuple[tuple[str, str], float] | None:
    """Return a position that is another's, with why, and what then is left; None if none is.

    Args:
        recording: all trials.
        joints: what they show.
        most: what may be left, of all joints together.
    """
    own = {joint.number: joint.left(joint.effort) for joint in joints}
    far = [joint for joint in joints if np.ptp(joint.position) > TRAVEL]
    found = None
    for one, other in combinations(far, 2):
        if max(own[one.number], own[other.number]) <= LITTLE:
            continue
        mended = _moved(with_motions_exchanged(recording, (one.number, other.number)))
        left = {joint.number: joint.left(joint.effort) for joint in mended}
        if _better(own, left) and sum(left.values()) < most:
            most = sum(left.values())
            why = (
                f"looks exchanged with that of {other.name}: the declared models leave at most "
                f"{max(left.values()):.0%} of an effort's variance the other way round, as "
                f"recorded up to {max(own.values()):.0%}; exchange their columns of position"
            )
            found = (f"{one.name}.position", why), most
    return found


def _turned_positions(
    recording: Recording, joints: list[Joint], most: float
) -> tuple[tuple[str, str], float] | None:
    """Return a joint whose position is counted the other way round; args as above.

    Its effort may be, too: of either way what leaves less. A counterweight turns only gravity, and
    a spring may do what a limb that nobody declared does.
    """
    own = {joint.number: joint.left(joint.effort, sprung=True) for joint in joints}
    if max(own.values(), default=0.0) <= LITTLE:
        return None
    most = min(most, BALANCED * sum(joint.left(joint.effort, balanced=True) for joint in joints))
    found = None
    for turned in joints:
        if np.ptp(turned.position) <= TRAVEL:
            continue
        sign = np.ones(recording.position.shape[1])
        sign[turned.number] = -1.0
        left, also = {}, False
        for joint in _moved(scaled(recording, sign)):
            left[joint.number] = joint.left(joint.effort, sprung=True)
            if joint.number == turned.number:
                other = joint.left(-joint.effort, sprung=True)
                also = other < left[joint.number]
                left[joint.number] = min(other, left[joint.number])
        if _better(own, left) and sum(left.values()) < most:
            most = sum(left.values())
            of_effort = ", of velocity and of effort" if also else " and of velocity"
            why = (
                f"is counted the other way round: so the declared models leave at most "
                f"{max(left.values()):.0%} of an effort's variance, as recorded up to "
                f"{max(own.values()):.0%}; turn the sign of {turned.name}'s position{of_effort}"
            )
            found = (f"{turned.name}.position", why), most
    return found


def _better(own: Mapping[int, float], other: Mapping[int, float]) -> bool:
    """Whether every joint's torque explains its effort better another way, or well either way.

    A joint beyond two parallel ones feels their sum, whichever is which.

    Args:
        own: share that is left of each joint's effort as recorded.
        other: the same the other way.
    """
    return own.keys() == other.keys() and all(
        other[j] < (LEAVES * left if left > LITTLE else LITTLE) for j, left in own.items()
    )


def turned_efforts(recording: Recording) -> list[str]:
    """Return the joints of a robot whose effort the declared links explain turned round."""
    joints = _joints(recording)
    return [joint.name for joint in _turned(_doubtful(joints), len(joints))]


def _doubtful(joints: list[Joint]) -> list[Joint]:
    """Return the joints whose effort the declared links leave, and that move far enough to tell."""
    far = (joint for joint in joints if np.ptp(joint.position) > TRAVEL)
    return [joint for joint in far if joint.left(joint.effort) > LITTLE]


def _turned(doubtful: list[Joint], many: int) -> list[Joint]:
    """Return the joints whose effort is turned round.

    One alone has to leave less than half of what it leaves as recorded. Efforts have one convention
    in all of a log: beside most others that are turned, one that is better so is turned, too. (A
    stranger's KUKA LBR, of whose last joint friction is all that is felt.)

    Args:
        doubtful: joints whose effort the declared links leave.
        many: number of all joints.
    """
    own = {joint.number: joint.left(joint.effort) for joint in doubtful}
    other = {joint.number: joint.left(-joint.effort) for joint in doubtful}
    sure = {
        joint.number
        for joint in doubtful
        if other[joint.number] < LEAVES * own[joint.number]
        # Behind a counterweight only gravity is turned round, and friction still resists.
        and other[joint.number] < BALANCED * joint.left(joint.effort, balanced=True)
    }
    if 2 * len(sure) > max(many, 2):
        sure |= {number for number in own if other[number] < BALANCED * own[number]}
    return [joint for joint in doubtful if joint.number in sure]


def _wrong_columns(joints: list[Joint]) -> tuple[list[tuple[str, str]], float]:
    """Return efforts that are another's or turned round, with why, and what then is left.

    What is exchanged comes first: it leaves less than half of what is left of one turned round. But
    not where more are turned round than are exchanged: these are one mistake.
    """
    left = {joint.number: joint.left(joint.effort) for joint in joints}
    own, doubtful = dict(left), _doubtful(joints)
    turned, found = _turned(doubtful, len(joints)), []
    left |= {joint.number: joint.left(-joint.effort) for joint in turned}
    for one, other in combinations(doubtful, 2):
        if len(one.effort) != len(other.effort):
            continue
        pair = one.left(other.effort), other.left(one.effort)
        if pair[0] < LEAVES * left[other.number] and pair[1] < LEAVES * left[one.number]:
            left[other.number], left[one.number] = pair
            why = (
                f"looks exchanged with that of {other.name}: the declared models leave "
                f"{pair[0]:.0%} and {pair[1]:.0%} of their variance the other way round, as "
                f"recorded {own[other.number]:.0%} and {own[one.number]:.0%}; exchange their "
                "columns, of position or of effort"
            )
            found.append((f"{one.name}.effort", why))
    if turned:
        told = f"{turned[0].name}.effort", _of_turned(turned, own)
        found.insert(0 if len(turned) > 2 * len(found) else len(found), told)
    return found, sum(left.values())


def _of_turned(turned: list[Joint], own: Mapping[int, float]) -> str:
    """Return why efforts are refused as turned round, every one with what it leaves."""
    first, *more = turned
    as_well = (
        f" (so have those of {', '.join(joint.name for joint in more)}; turn all of them)"
        if more
        else ""
    )
    there = ", ".join(f"{joint.left(-joint.effort):.0%}" for joint in turned)
    here = ", ".join(f"{own[joint.number]:.0%}" for joint in turned)
    return (
        f"has the opposite sign of what {first.name} needs{as_well}: turned round the declared "
        f"model leaves {there} of the variance, as recorded {here}; effort is positive along "
        "the joint's axis, as position is"
    )


def _unfelt_weights(joints: list[Joint]) -> Iterator[str]:
    """Yield a sentence for each joint whose effort holds next to nothing of a large weight.

    Of the weight what friction and inertia do not imitate would alone be more than the effort
    varies by. (A stranger's Schunk LWA4P, whose second joint had a hundredth of its weight.)
    """
    for joint in joints:
        effort = joint.effort - joint.effort.mean()
        table = np.column_stack([joint.unknown, joint.static, effort])
        triangle = np.asarray(np.linalg.qr(table, mode="r"))
        weight, shown = triangle[-2, -2:]
        if abs(weight) > np.linalg.norm(effort) and abs(shown) < UNFELT * abs(weight):
            declared = rms(joint.static - joint.static.mean())
            yield (
                f"the effort of {joint.name} shows {shown / weight:.0%} of the weight that the "
                f"model declares there, which varies by {declared:.3g}, the effort by "
                f"{rms(effort):.3g}: is it logged after gravity compensation (then say "
                '"gravity": [0, 0, 0] in session.json), does something balance it, or is it in '
                "another unit?"
            )


def _other_gravity(recording: Recording, joints: list[Joint]) -> tuple[str, float] | None:
    """Return which gravity explains all joints better, and what it leaves; None if none does.

    Each beside a spring at every joint, which pulls as another gravity does over a short way.
    """
    declared = recording.gravity
    ways = [np.zeros(3), *(sign * STANDARD * axis for axis in np.eye(3) for sign in (1.0, -1.0))]
    ways = [way for way in ways if np.linalg.norm(way - declared) > 0.1 * STANDARD]
    before = sum(joint.left(joint.effort, sprung=True) for joint in joints)
    if before <= LITTLE * len(joints):
        return None
    left = [sum(j.left(j.effort, way - declared, sprung=True) for j in joints) for way in ways]
    best = int(np.argmin(left))
    if left[best] >= LEAVES * before:
        return None
    found, told = (", ".join(f"{g + 0.0:.3g}" for g in way) for way in (ways[best], declared))
    sentence = (
        f"the joints move as in a gravity of [{found}] m/s2: that leaves "
        f"{left[best] / len(joints):.0%} of the efforts' variance, the declared [{told}] leaves "
        f"{before / len(joints):.0%}; is the device mounted another way, does something "
        f"balance it, or is its effort logged after gravity compensation? If mounted or logged so, "
        f'say "gravity": [{found}] in session.json'
    )
    return sentence, left[best]
