"""Torque that is local in time at a joint that rests: somebody pushes what a controller holds.

Friction at rest has any value, so a joint is compared with the course of its own torque there.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter
from scipy.stats import norm

from analysis.closeloop.identification.findings import Event
from analysis.closeloop.judgement.recurring import Way, clock_of
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.runs import MOVING, SHORT, runs
from analysis.closeloop.session.signals import last_digit

#: Shortest event, s.
SHORTEST = 0.08
#: An event's flanks and its peak, over the spread of a course: stiction creeps.
FLANK, PEAK = 2.5, 8.0
#: ... its peak over the Coulomb friction that the joint's motion shows.
STICTION = 3.0
#: What Coulomb friction changes by where a joint turns around, over it.
BOTH_SIDES = 2.0
#: ... and over the noise of single samples; where the joint hardly moves by itself, over what is
#: left of it in the fit's band: what a fit to its motion leaves of an excursion is more than noise,
#: and so is the stiction of a joint that never moves, which nothing shows the size of. (That share
#: was chosen while looking at limbs 559, 589 and 619 of the unkind bench.)
OVER_NOISE = 4.0
#: Time over which a resting joint's torque is compared with its own course, s, and what the
#: shortest rest lasts that has one.
COURSE, LEAST_REST = 4.0, 1.0
#: What is left of a motion within a hold is no push below this share of the torque that the motion
#: takes: a quick stretch that slowly comes back is a hold, too. (Set while looking at limb 36022 of
#: the unkind bench, tuning seeds: 0.02.)
OF_MOTION = 0.05
#: Time around a motion at which filters still feel it, s.
AROUND = 0.1
#: Share of an effort that arithmetic rounds off.
ROUNDING = 1e-9
#: Friction takes power all the time; of this share of it, more is taken than given.
RUBS = 0.5
#: A joint that goes so much in step with its torque (their correlation), by more than its noise, is
#: driven, however little it goes: one that is pushed goes against it, and one that only creeps on
#: goes neither way with it. (Set while looking at one axis of a KR300: 0.68 and 0.83.)
FOLLOWS = 0.5


def rest_events(
    recording: Recording,
    joint: int,
    friction: float,
    expected: np.ndarray | None,
    abrupt: np.ndarray | float,
    others: Sequence[int],
) -> Iterator[Event]:
    """Yield what stands out of a resting joint's own course, and is not there in other passes.

    Args:
        recording: all trials.
        joint: which.
        friction: that its motion shows, Nm or N.
        expected: its effort as a model fitted to its motion has it, low-passed, (n,); None if it
            hardly moves by itself. What that explains is no event.
        abrupt: torque near each sample of which filters are wrong, Nm or N, (n,).
        others: joints that move by themselves beside it.
    """
    beside = bool(others)
    still = recording.still or joint not in recording.joints
    courses = list(_courses(recording, joint, expected, still=still, beside=beside))
    if not courses:
        return
    sampling = recording.sampling
    hardly = expected is None and not still
    share = 2.0 * sampling.fit_cutoff / sampling.recorded if hardly else 1.0
    # Of each trial: where the joint moves, its effort's samples differ by more than their noise.
    noise = {
        int(trial): noise_of(recording.raw_effort(trial, joint), min(1.0, share))
        for trial in np.unique(recording.trial)
    }
    flicker = max(_flicker(recording.raw_position(trial, joint)) for trial in noise)
    # Of a course that only falls or rises nothing stands out, and this is nothing.
    usual_anywhere = quiet_spread(np.concatenate([course.nearest for course in courses]))
    excused = np.maximum(abrupt, _answered(recording, joint, expected, beside=beside))
    travel = float(np.ptp(recording.position[:, joint]))
    comes_back = _recurring(recording, courses, others)
    # Nothing else tells what its own moves take.
    itself = goes_itself(recording, joint) if expected is None else None
    for course in courses:
        samples, beyond = course.samples, course.beyond
        usual = max(usual_anywhere, quiet_spread(course.nearest))
        rounding = ROUNDING * float(np.abs(recording.effort[samples, joint]).max())
        own = max(OVER_NOISE * noise[int(recording.trial[samples[0]])], rounding)
        least = max(PEAK * usual, own)
        away = recording.position[samples, joint]
        away = away - np.median(away)
        for run in runs(np.abs(beyond) > max(FLANK * usual, 0.2 * least)):
            speed = recording.velocity[samples[run], joint]
            short = (run.stop - run.start) / recording.rate <= SHORTEST
            if short or _driven(away[run], speed, beyond[run], flicker):
                continue
            # Friction may be all of it where the joint rests, and is more at rest; of one that is
            # moved a little way it only goes from one side to the other.
            pushed = MOVING < np.ptp(away[run]) < SHORT * travel
            rubbing = (BOTH_SIDES if pushed else STICTION) * friction
            top = run.start + int(np.argmax(np.abs(beyond[run])))
            if abs(beyond[top]) <= max(least, rubbing, excused[samples[top]]):
                continue
            if itself is not None and itself[samples[top]]:
                continue
            if comes_back(samples[top]):
                continue
            yield Event(
                trial=int(recording.trial[samples[top]]),
                joint=joint,
                begin=float(recording.time[samples[run.start]]),
                end=float(recording.time[samples[run.stop - 1]]),
                peak=float(beyond[top]),
            )


@dataclass(frozen=True, kw_only=True)
class _Course:
    """A rest's effort beside its own course, Nm or N; arrays (n,)."""

    samples: np.ndarray
    #: What no torque explains that is known.
    beyond: np.ndarray
    #: The size of what the nearest of these torques leaves.
    nearest: np.ndarray


def _courses(
    recording: Recording, joint: int, expected: np.ndarray | None, *, still: bool, beside: bool
) -> Iterator[_Course]:
    """Yield the rests of a joint that last for `LEAST_REST`; arguments as of `rest_events`.

    What another joint's motion does at this one is no push, nor is what its own takes. Of the first
    friction may take any part.
    """
    needed = needed_by(recording, joint)
    for samples in _rests(recording, joint, still):
        effort = recording.effort[samples, joint]
        if len(samples) < LEAST_REST * recording.rate or np.isnan(effort).any():
            continue
        left = [
            _beyond(recording, effort - torque[samples])
            for torque in (recording.static[:, joint], needed, expected)
            if torque is not None
        ]
        nearest = np.min(np.abs(left), axis=0)
        between = beside & (left[0] * left[1] < 0.0)
        beyond = np.where(between, 0.0, np.sign(left[0]) * nearest)
        yield _Course(samples=samples, beyond=beyond, nearest=nearest)


def _recurring(
    recording: Recording, courses: Sequence[_Course], others: Sequence[int]
) -> Callable[[int], bool]:
    """Return what says whether the torque of a sample is there in other passes of the others."""
    every = np.concatenate([course.samples for course in courses])
    beyond = np.concatenate([course.beyond for course in courses])
    moving = [other for other in others if np.ptp(recording.position[every, other]) > MOVING]
    if not moving:
        return lambda _: False
    motion = (recording.position, recording.velocity, recording.acceleration)
    way = Way(clock_of(recording)[every], [x[every, other] for other in moving for x in motion])
    return lambda sample: way.comes_back(beyond, int(np.flatnonzero(every == sample)[0]))


def _answered(
    recording: Recording, joint: int, expected: np.ndarray | None, *, beside: bool
) -> np.ndarray:
    """Return torque that a motion near each sample may leave, Nm or N, (n,).

    A share of what it takes. Where another joint's motion is felt by one whose friction is unknown,
    that keeps for a while what the motion left there: all of it.
    """
    known = needed_by(recording, joint) if expected is None else expected
    taken = np.abs(known - recording.static[:, joint])
    found = OF_MOTION * _around(recording, taken, AROUND)
    if beside and expected is None:
        found = np.maximum(found, _around(recording, taken, COURSE))
    return found


def _rests(recording: Recording, joint: int, still: bool) -> list[np.ndarray]:
    """Return the samples of every rest, each (n,): one goes on where samples were lost meanwhile.

    Args:
        recording: all trials.
        joint: which.
        still: whether it never moves.
    """
    found: list[np.ndarray] = []
    ended = -1
    for piece in recording.slices:
        holds = recording.held(joint, piece) if not still else [slice(0, piece.stop - piece.start)]
        for hold in holds:
            samples = np.arange(piece.start + hold.start, piece.start + hold.stop)
            if samples[0] == ended and _same_rest(recording, joint, found[-1], samples):
                samples = np.concatenate([found.pop(), samples])
            found.append(samples)
            ended = piece.stop if samples[-1] + 1 == piece.stop else -1
    return found


def _same_rest(recording: Recording, joint: int, one: np.ndarray, other: np.ndarray) -> bool:
    """Whether a joint rests in one place before and after a gap in a trial."""
    places = (np.median(recording.position[samples, joint]) for samples in (one, other))
    same = recording.trial[one[-1]] == recording.trial[other[0]]
    return bool(same and abs(np.subtract(*places)) <= MOVING)


def _beyond(recording: Recording, torque: np.ndarray) -> np.ndarray:
    """Return a torque less its own course, Nm or N, (n,)."""
    width = min(int(COURSE * recording.rate) | 1, len(torque) | 1)
    return np.asarray(torque - median_filter(torque, width, mode="nearest"))


def _driven(away: np.ndarray, velocity: np.ndarray, beyond: np.ndarray, flicker: float) -> bool:
    """Whether a motor moved its joint away from rest itself: then its torque is no event.

    Where something pushes, the controller resists: its torque is against the way that the joint
    goes. A motor's own torque goes that way, or rubs. So does that of one that winds up until its
    joint breaks loose: what sticks yields a little, like a spring.

    Args:
        away: of the joint from where it rests, rad or m, (n,).
        velocity: of the joint, rad/s or m/s, (n,).
        beyond: torque beside the joint's own course, Nm or N, (n,).
        flicker: noise of the joint's position, rad or m.
    """
    if np.abs(away).max() <= MOVING:
        seen = np.ptp(away) > PEAK * flicker and np.ptp(away) > 0.0
        return bool(seen and np.corrcoef(away, beyond)[0, 1] > FOLLOWS)
    # On the way back its motor works against friction, whoever moved it.
    out = velocity * away > 0.0
    out = out if out.any() else np.ones(len(out), dtype=bool)
    return bool(away @ beyond > 0.0) or rubs(velocity[out], beyond[out])


def goes_itself(recording: Recording, joint: int) -> np.ndarray:
    """Return where a motor moves its joint out of a hold and back, (n,): it gives work going out.

    What holds a joint that somebody pushes away takes work up on that way.

    Args:
        recording: all trials.
        joint: which.
    """
    found = np.zeros(len(recording.time), dtype=bool)
    for piece in recording.slices:
        noise = noise_of(recording.raw_effort(int(recording.trial[piece.start]), joint))
        resting = recording.resting(joint, piece)
        for hold in recording.held(joint, piece):
            inside = slice(piece.start + hold.start, piece.start + hold.stop)
            place, velocity, effort = (
                x[inside, joint] for x in (recording.position, recording.velocity, recording.effort)
            )
            if not resting[hold].any():
                continue
            away = place - np.median(place[resting[hold]])
            beside = effort - np.median(effort[resting[hold]])
            for run in runs(np.abs(away) > MOVING):
                way = np.sign(away[run])
                out = np.maximum(velocity[run] * way, 0.0)
                given = out @ (beside[run] * way)
                found[inside][run] = given > noise * out.sum()
    return found


def _around(recording: Recording, torque: np.ndarray, seconds: float) -> np.ndarray:
    """Return the largest torque within some seconds around each sample, piece by piece, (n,)."""
    width = int(seconds * recording.rate) | 1
    pieces = [maximum_filter1d(torque[piece], width) for piece in recording.slices]
    return np.concatenate(pieces)


def needed_by(recording: Recording, joint: int) -> np.ndarray:
    """Return what the declared chain needs at a joint, low-passed as the effort is, (n,)."""
    return recording.filtered(recording.rigid[:, [joint]])[:, 0]


def rubs(velocity: np.ndarray, beyond: np.ndarray) -> bool:
    """Whether a torque works against the motion throughout, as the friction that nothing shows yet.

    Who pushes a held joint away works along its motion, and against it where he lets it back.

    Args:
        velocity: of the joint, rad/s or m/s, (n,).
        beyond: torque beside the joint's own course, Nm or N, (n,).
    """
    power = velocity * beyond
    return bool(power.sum() > RUBS * np.abs(power).sum())


def noise_of(signal: np.ndarray | None, share: float = 1.0) -> float:
    """Return the noise of a channel's samples, in its unit: what differs from one to the next.

    Of its power a low-pass leaves a share, as of white noise; of the last digit it leaves all.
    """
    if signal is None:
        return 0.0
    return max(spread(np.diff(signal)) * float(np.sqrt(share / 2.0)), last_digit(signal))


def _flicker(position: np.ndarray | None) -> float:
    """Return the noise of a position's samples, in its unit, beside a motion without jerks."""
    if position is None:
        return 0.0
    # Of white noise a third difference has twenty times the power.
    return max(spread(np.diff(position, 3)) / float(np.sqrt(20.0)), last_digit(position))


def spread(signal: np.ndarray) -> float:
    """Return the standard deviation of a signal from the median of its size."""
    return float(1.4826 * np.median(np.abs(signal))) if len(signal) else 0.0


def quiet_spread(signal: np.ndarray) -> float:
    """Return the same from the quietest quarter: somebody may push most of the time."""
    return float(np.quantile(np.abs(signal), 0.25) / norm.ppf(0.625))
