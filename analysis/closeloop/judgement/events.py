"""Torque that is local in time and does not come back: a person pushes, something is in the way.

Looked for before any effect is, so that no effect is made of it, and the fit is spared it. A joint
that moves is compared with what the declared model and splines on all signals make of its other
seconds, fitted so that a few wrong ones do not count (bisquare weights, Beaton and Tukey 1974); a
joint that rests, with the course of its own torque there, because friction at rest has any value.
What stands out is no event if the same residual is there whenever the joint passes in the same
way. Thresholds were set on the synthetic sessions of `tests/testbed` (seeds below 100) and on two
recordings of a UR10e (`still_hold` has none, `pushed_while_still` five pushes).
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter, uniform_filter1d
from scipy.spatial import cKDTree

from analysis.closeloop.identification.balance.least_squares import gram_matrices
from analysis.closeloop.identification.balance.luck import LEAST_BLOCKS, MIN_TORQUE
from analysis.closeloop.identification.balance.model import (
    Model,
    evaluate,
    prediction,
)
from analysis.closeloop.identification.balance.regression import SCATTERED, Rows, select_rows
from analysis.closeloop.identification.balance.sticking import (
    coupled_motors,
    driven,
    friction_of,
    samples_step,
    unknown_friction,
)
from analysis.closeloop.identification.explainable import phase_groups, signal_groups
from analysis.closeloop.identification.findings import Event
from analysis.closeloop.identification.presliding import rubbing_anyway, with_free_presliding
from analysis.closeloop.judgement.holds import (
    AROUND,
    SHORTEST,
    STICTION,
    away_events,
    rest_events,
    spread,
)
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.runs import runs
from analysis.closeloop.session.signals import lowpass, rms

#: An event's peak and its flanks, over the spread of the residual (from its median).
PEAK, FLANK = 6.0, 2.5
#: Lengths over which the residual is averaged, s: a weak push shows by lasting.
SCALES = (0.0, 0.2, 0.6)
#: Time that a motor moves its joint, s, before a fit to it tells what an excursion from rest takes.
TELLS = 6.0
#: Rows of a joint in motion, below which nothing is said of it.
LEAST_ROWS = 50
#: How many events a second of motion are none but a form that is wrong.
OFTEN = 0.15
#: What takes a larger share of the time than this is not local.
LOCAL = 0.25
#: An event's peak over what the fit's upper octave holds of the torque that the motion needs: where
#: a motion starts at once, filters and the time of a sample are wrong by a share of that. Set on
#: four sessions of the unkind bench (tuning seeds): 0.04 to 0.3 without an event, 10 at a push.
ABRUPT = 0.5
#: ... unless it is so many times the share that is left wherever else a motion starts as abruptly.
#: Set on two of its arms (tuning 34015, 34110): 2 and 3 at the start of a stretch, 5 at a push.
AS_ABRUPT = 4.0
#: Time to a place that is another one, s.
ELSEWHERE = 1.0
#: How near another pass is (in deviations of place, speed and acceleration), and which share of
#: the residual makes it the same.
NEAR, ALIKE = 0.3, 0.4
#: How many neighbouring rows noise makes alike, which a fit takes for as many less.
COLOUR = 10.0
#: Share of the rows that tell what is usual where a fit is about as sure.
LIKE = 0.25
#: Rounds of the robust fit, and its bisquare's width.
ROUNDS, WIDTH = 5, 4.7


def find_events(model: Model, recording: Recording) -> tuple[Event, ...]:
    """Return the events of every trial and joint with an effort, in the order of time.

    Args:
        model: what is known by now: what is declared, and effects that were found.
        recording: all trials.
    """
    found: list[Event] = []
    friction = dict.fromkeys(recording.joints, 0.0)
    expected: dict[int, np.ndarray] = {}
    if not recording.still:
        rows = select_rows(recording, tuple(range(len(recording.session.trials))))
        for joint in recording.joints:
            samples = rows.samples[joint]
            rubbed = friction_of(model, rows, joint) if len(samples) else 0.0
            friction[joint] = rubbed + sum(own for own, _ in coupled_motors(model, rows, joint))
            if len(samples) < LEAST_ROWS:
                continue
            # Of one that hardly rubs, a push itself would be taken for friction.
            rubs = rubbed > MIN_TORQUE * rms(recording.effort[samples, joint])
            known = rubbing_anyway(model, joint) if rubs else model
            own = _joined(_moving(known, rows, joint, unknown_friction(model, rows, joint)))
            own = [event for event in own if event.end - event.begin > SHORTEST]
            seconds = len(samples) * samples_step(samples) / recording.rate
            if int(driven(recording, joint, samples).sum()) * seconds > TELLS * len(samples):
                torque = prediction(model, evaluate(model, rows).coefficients)[:, [joint]]
                expected[joint] = recording.filtered(torque)[:, 0]
            found += own if len(own) <= max(3.0, OFTEN * seconds) else []
    for joint in range(recording.effort.shape[1]):
        moved = expected.get(joint)
        abrupt = 0.0 if moved is None else ABRUPT * upper_octave(recording, joint)
        beside = bool(expected.keys() - {joint})
        found += rest_events(recording, joint, friction.get(joint, 0.0), moved, abrupt, beside)
        if not expected:
            # Where another joint moves, its reaction takes this one along.
            found += away_events(recording, joint)
    return tuple(sorted(_joined(found), key=lambda one: (one.begin, one.joint)))


def spared(recording: Recording, events: tuple[Event, ...]) -> Recording:
    """Return the recording with the samples of events marked: no fit uses them."""
    disturbed = np.zeros(recording.effort.shape, dtype=bool)
    for event in events:
        inside = (recording.time >= event.begin) & (recording.time <= event.end)
        disturbed[inside & (recording.trial == event.trial), event.joint] = True
    return replace(recording, disturbed=disturbed)


@dataclass(frozen=True, kw_only=True)
class Beyond:
    """What is left of a joint by the model alone, and with splines beside it; arrays (r,)."""

    #: By the model, fitted without outliers, Nm or N, low-passed; the smaller of what it leaves
    #: with its friction as it is and free to turn, which misses starts unlike all others.
    alone: np.ndarray
    #: With splines, every second predicted from others, Nm or N, low-passed.
    left: np.ndarray
    #: The variance of that prediction, over that of a row's own noise.
    doubt: np.ndarray

    @property
    def least(self) -> np.ndarray:
        """The smaller of both: where the model is right, what splines miss is their own."""
        return _smaller(self.alone, self.left)

    @property
    def sure(self) -> np.ndarray:
        """What splines leave, made smaller by their doubt, Nm or N.

        No event is made of a place where the joint was once.
        """
        return np.asarray(self.left / np.sqrt(1.0 + COLOUR * self.doubt))

    @property
    def relative(self) -> np.ndarray:
        """The same over what is usual of it where splines are about as sure."""
        sure = self.sure
        order = np.argsort(self.doubt, kind="stable")
        width = min(max(LEAST_ROWS, int(LIKE * len(order))), len(order))
        usual = np.empty_like(sure)
        usual[order] = 1.4826 * median_filter(np.abs(sure[order]), width)
        return np.asarray(sure / np.maximum(usual, 1e-12))


def beyond_splines(model: Model, rows: Rows, joint: int) -> Beyond:
    """Return what the model leaves of a joint, alone and with splines on all signals beside it."""
    part, recording = rows.parts[joint], rows.recording
    groups = signal_groups(rows, joint) | phase_groups(recording, joint)
    splines = np.concatenate(list(groups.values()), axis=1)
    base, _ = with_free_presliding(model, [joint]).base(rows)
    stacked = rows.stack(model.transformed({joint: splines}), splines.shape[1])
    table = np.concatenate([np.ones((len(base), 1)), base, stacked], axis=1)[part]
    scale = np.sqrt((table**2).mean(axis=0))
    kept = scale > 1e-9
    table = table[:, kept] / scale[kept]
    target = model.target(rows)[part]
    both = np.column_stack([table, target])
    folds = [np.flatnonzero(rows.block[part] % SCATTERED == k) for k in range(SCATTERED)]
    weight, left, doubt = np.ones(len(target)), target, np.zeros(len(target))
    for _ in range(ROUNDS):
        grams = gram_matrices(both * np.sqrt(weight)[:, None], folds)
        total = grams.sum(axis=0)
        left, doubt = np.empty_like(target), np.empty_like(target)
        for own, gram in zip(folds, grams, strict=True):
            left[own], doubt[own] = _predicted(total - gram, table[own], target[own])
        sure = left / np.sqrt(1.0 + COLOUR * doubt)
        size = np.abs(sure) / (WIDTH * max(spread(sure), 1e-12))
        weight = np.where(size < 1, (1 - size**2) ** 2, 0.0)
    alone = _smaller(
        _left(target, base[part], weight), _left(target, model.base(rows)[0][part], weight)
    )
    if spread(left) > np.sqrt(2.0) * spread(alone):
        # A joint that drifts while it is held has too few seconds for splines: their own error is
        # larger than all that the model leaves, so they have nothing to say. (Twice the power: set
        # while looking at limbs 639 and 5059 of the unkind bench.)
        return Beyond(alone=alone, left=alone, doubt=np.zeros(len(alone)))
    return Beyond(alone=alone, left=left, doubt=doubt)


def _smaller(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return what is nearer to zero, row by row, (r,)."""
    return np.where(np.abs(one) < np.abs(other), one, other)


def _left(target: np.ndarray, table: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Return what a weighted fit of a table, (r, k), and a constant leaves of a target, (r,)."""
    table = np.column_stack([np.ones(len(table)), table])
    root = np.sqrt(weight)
    return np.asarray(
        target - table @ np.linalg.lstsq(table * root[:, None], target * root, rcond=None)[0]
    )


def _predicted(
    gram: np.ndarray, table: np.ndarray, target: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the residual of rows that were not fitted, and the variance of their prediction."""
    size = len(gram) - 1
    matrix = gram[:size, :size] + 1e-5 * float(np.trace(gram[:size, :size])) / size * np.eye(size)
    inverse = np.linalg.inv(matrix)
    left = target - table @ (inverse @ gram[:size, size])
    return left, ((table @ inverse) * table).sum(axis=1)


def _moving(model: Model, rows: Rows, joint: int, friction: np.ndarray) -> Iterator[Event]:
    """Yield what stands out of a moving joint's residual and is not there in other passes.

    Args:
        model: what is known by now.
        rows: the samples of all joints in motion.
        joint: which.
        friction: that no motion shows, Nm or N, low-passed, (n,). Where it turns, sticking for a
            moment as long as a controller takes, its friction has any value, as at rest.
    """
    recording, samples = rows.recording, rows.samples[joint]
    if len(np.unique(rows.block[rows.parts[joint]])) < SCATTERED:
        return
    beyond = beyond_splines(model, rows, joint)
    left = beyond.least
    step = float(np.median(np.diff(recording.time[samples])))
    pieces = np.split(
        np.arange(len(samples)), np.flatnonzero(np.diff(samples) > 2 * samples_step(samples)) + 1
    )
    turned = recording.since_reversal(joint)[samples]
    motion = [x[samples, joint] for x in (recording.velocity, recording.acceleration)]
    places = [recording.position[samples, joint], np.sign(turned) * np.log(np.abs(turned) + 0.02)]
    clock = _clock(recording)[samples]
    ways = [_Way(clock, [place, *motion]) for place in places]
    octave = np.maximum(upper_octave(recording, joint)[samples], 1e-12)
    stuck = STICTION * friction[samples]
    # Less than matters beside the effort is no event either.
    stuck = np.maximum(stuck, MIN_TORQUE * rms(recording.effort[samples, joint]))
    for seconds in SCALES:
        width = max(1, round(seconds / step))
        relative, sure, alone, predicted, excused, abrupt = (
            _averaged(signal, pieces, width)
            for signal in (beyond.relative, beyond.sure, beyond.alone, beyond.left, stuck, octave)
        )
        # What a right model leaves is noise; of a wrong one splines take what is usual.
        usual = max(min(spread(alone), spread(predicted)), 1e-12)
        size = np.abs(relative) / max(spread(relative), 1e-12)
        size = np.minimum(size, np.abs(alone) / usual)
        smooth = np.sign(predicted) * size
        if np.mean(size > PEAK) > LOCAL:
            continue
        for piece in pieces:
            for run in runs(size[piece] > FLANK):
                own = piece[run]
                least = np.minimum(np.abs(sure[own]), np.abs(alone[own]))
                clear = own[_lasting(least > excused[own], size[own])]
                if not len(clear):
                    continue
                calm = clear[least[clear - own[0]] > ABRUPT * abrupt[clear]]
                among = calm if len(calm) else clear
                top = int(among[np.argmax(size[among])])
                if not len(calm) and not _more_than_abrupt(alone, abrupt, rows, joint, top):
                    continue
                if any(way.comes_back(smooth, top) for way in ways):
                    continue
                peak = own[np.argmax(np.abs(left[own]))]
                yield Event(
                    trial=int(recording.trial[samples[top]]),
                    joint=joint,
                    begin=float(recording.time[samples[own[0]]]),
                    end=float(recording.time[samples[own[-1]]]),
                    peak=float(left[peak]),
                )


def _lasting(beyond: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Return which rows of a run show an event, (r,): its top, or else two in a row.

    What is unknown where a joint turns may last a row longer than its motion says.

    Args:
        beyond: which rows have more than what is unknown there, (r,).
        size: of every row, over what is usual, (r,).
    """
    clear = beyond & (size > PEAK)
    if clear[np.argmax(size)]:
        return clear
    both = clear[1:] & clear[:-1]
    return np.asarray(np.append(both, False) | np.append(False, both))


def _averaged(signal: np.ndarray, pieces: Sequence[np.ndarray], width: int) -> np.ndarray:
    """Return the means over `width` rows around each, piece by piece."""
    found = np.array(signal)
    for piece in pieces:
        found[piece] = uniform_filter1d(signal[piece], width)
    return found


def upper_octave(recording: Recording, joint: int) -> np.ndarray:
    """Return how much torque near each sample the motion needs in the fit's upper octave, (n,)."""
    torque, cutoff = recording.inverse[:, joint], recording.sampling.fit_cutoff
    found = np.empty(len(torque))
    for piece in recording.slices:
        low, high = (lowpass(torque[piece], share * cutoff, recording.rate) for share in (0.5, 1.0))
        found[piece] = maximum_filter1d(np.abs(high - low), int(AROUND * recording.rate) | 1)
    return found


def _more_than_abrupt(
    left: np.ndarray, octave: np.ndarray, rows: Rows, joint: int, top: int
) -> bool:
    """Whether more is left than wherever else a motion is about as abrupt.

    Args:
        left: what the model leaves of a joint's rows, Nm or N, (r,).
        octave: torque that its motion needs there in the fit's upper octave, Nm or N, (r,).
        rows: the samples of all joints in motion.
        joint: which.
        top: the row in question.
    """
    time, block = _clock(rows.recording)[rows.samples[joint]], rows.block[rows.parts[joint]]
    like = (octave > 0.5 * octave[top]) & (np.abs(time - time[top]) > ELSEWHERE)
    share = np.abs(left) / octave
    if len(np.unique(block[like])) < LEAST_BLOCKS:
        return False
    return bool(share[top] > AS_ABRUPT * share[like].max())


def _clock(recording: Recording) -> np.ndarray:
    """Return the time of every sample, s, (n,), one trial after the other."""
    longest = float(np.ptp(recording.time)) + 2.0 * ELSEWHERE
    return np.asarray(recording.time + longest * recording.trial)


class _Way:
    """Passes through the same motion: the same place or phase, speed and acceleration."""

    def __init__(self, time: np.ndarray, signals: list[np.ndarray]) -> None:
        state = np.column_stack(signals)
        self._state = state / np.maximum(state.std(axis=0), 1e-12)
        self._tree = cKDTree(self._state)
        self._time = time

    def comes_back(self, residual: np.ndarray, top: int) -> bool:
        """Whether the joint leaves the same residual in other passes as at row `top`."""
        time = self._time
        near = np.array(self._tree.query_ball_point(self._state[top], NEAR), dtype=int)
        near = np.sort(near[np.abs(time[near] - time[top]) > ELSEWHERE])
        if not len(near):
            return False
        passes = np.split(near, np.flatnonzero(np.diff(time[near]) > 0.5) + 1)
        alike = [float(np.median(residual[one])) / residual[top] for one in passes]
        return bool(3 * int(np.sum(np.array(alike) > ALIKE)) >= max(3, len(alike)))


def _joined(events: Iterable[Event]) -> list[Event]:
    """Return events with those of one joint joined that overlap or follow within a second."""
    found: list[Event] = []
    for event in sorted(events, key=lambda one: (one.trial, one.joint, one.begin)):
        last = found[-1] if found else None
        same = last is not None and (last.trial, last.joint) == (event.trial, event.joint)
        if last is not None and same and event.begin <= last.end + 0.3:
            peak = max(last.peak, event.peak, key=abs)
            found[-1] = replace(last, end=max(last.end, event.end), peak=peak)
        else:
            found.append(event)
    return found
