"""Torque that is local in time and does not come back: a person pushes, something is in the way.

Looked for before any effect is, so that no effect is made of it, and the fit is spared it. A joint
that moves is compared with what the declared model and splines on all signals make of its other
seconds; a joint that rests, with the course of its own torque there, because friction at rest has
any value. What stands out is no event if the same residual is there whenever the joint passes in
the same way. Thresholds were set on the synthetic sessions of `tests/testbed` (seeds below 100) and
on two recordings of a UR10e (`still_hold` has none, `pushed_while_still` five pushes).
"""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from analysis.closeloop.identification.balance.luck import LEAST_BLOCKS, MIN_TORQUE
from analysis.closeloop.identification.balance.model import Model, evaluate, prediction
from analysis.closeloop.identification.balance.regression import SCATTERED, Rows, select_rows
from analysis.closeloop.identification.balance.sticking import (
    coupled_motors,
    driven,
    friction_of,
    samples_step,
)
from analysis.closeloop.identification.findings import Event
from analysis.closeloop.identification.presliding import rubbing_anyway
from analysis.closeloop.identification.spectrum import strongest_line
from analysis.closeloop.judgement.beyond import (
    LEAST_ROWS,
    Beyond,
    beyond_splines,
    pieces_of,
    right_between,
    stretches_beyond,
)
from analysis.closeloop.judgement.excused import excused
from analysis.closeloop.judgement.gaps import gaps_of, of_gaps, with_sides
from analysis.closeloop.judgement.holds import (
    AROUND,
    LEAST_REST,
    SHORTEST,
    goes_itself,
    rest_events,
    spread,
)
from analysis.closeloop.judgement.recurring import ELSEWHERE, Way, clock_of
from analysis.closeloop.judgement.shoved import away_events, shoved_events
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.runs import runs
from analysis.closeloop.session.signals import least_digit, lowpass, rms

#: An event's peak and its flanks, over the spread of the residual (from its median).
PEAK, FLANK = 6.0, 2.5
#: Lengths over which the residual is averaged, s: a weak push shows by lasting.
SCALES = (0.0, 0.2, 0.6)
#: Time that a motor moves its joint, s, before a fit to it tells what an excursion from rest takes.
TELLS = 6.0
#: How often a second of motion something may stand out; more often it is a form that is wrong,
#: unless the form is right wherever nothing does.
OFTEN = 0.15
#: What takes a larger share of the time than this is not local.
LOCAL = 0.25
#: An event's peak over the root mean square of an oscillation: twice its amplitude, for as long as
#: something shakes the joint a weaker push cannot be told.
OF_LINE = 2.0 * float(np.sqrt(2.0))
#: What swings to the other side by this share of a peak, and by so many deviations, within so many
#: seconds, is no push. (Set on an opponent's arms with springs or a gap, 0.5 to 1, and with pushes,
#: 0.01 to 0.35.)
SWING, BEYOND_NOISE, BESIDE = 0.5, 4.0, 0.3
#: An event's peak over what the fit's upper octave holds of the torque that the motion needs: where
#: a motion starts at once, filters and the time of a sample are wrong by a share of that. Set on
#: four sessions of the unkind bench (tuning seeds): 0.04 to 0.3 without an event, 10 at a push.
ABRUPT = 0.5
#: ... unless it is so many times the share that is left wherever else a motion starts as abruptly.
#: Set on two of its arms (tuning 34015, 34110): 2 and 3 at the start of a stretch, 5 at a push.
AS_ABRUPT = 4.0


@dataclass(frozen=True, kw_only=True)
class Standing:
    """What stands out of a recording."""

    #: Events, in the order of time.
    told: tuple[Event, ...]
    #: Stretches that may be, too, where a model's form is wrong, so that none can be told from it.
    doubted: tuple[Event, ...]


def find_events(model: Model, recording: Recording) -> tuple[Event, ...]:
    """Return the events that are told of every trial and joint; arguments as `standing_out`."""
    return standing_out(model, recording).told


def standing_out(model: Model, recording: Recording) -> Standing:
    """Return what stands out of every trial and joint with an effort.

    Args:
        model: what is known by now: what is declared, and effects that were found.
        recording: all trials.
    """
    found: list[Event] = []
    doubted: list[Event] = []
    friction = dict.fromkeys(recording.joints, 0.0)
    expected: dict[int, np.ndarray] = {}
    if not recording.still:
        trials = tuple(range(len(recording.session.trials)))
        rows = select_rows(recording, trials)
        gaps = gaps_of(model, rows)
        every = select_rows(with_sides(recording, gaps.sides), trials) if gaps.sides else rows
        for joint in recording.joints:
            samples = rows.samples[joint]
            if not len(samples):
                continue
            rubbed = friction_of(model, rows, joint)
            friction[joint] = rubbed + sum(own for own, _ in coupled_motors(model, rows, joint))
            if len(samples) < LEAST_ROWS:
                continue
            # Of one that hardly rubs, a push itself would be taken for friction.
            rubs = rubbed > MIN_TORQUE * rms(recording.effort[samples, joint])
            known = rubbing_anyway(model, joint) if rubs else model
            unknown = excused(model, rows, joint) + of_gaps(model, rows, joint, gaps)
            seconds = len(samples) * samples_step(samples) / recording.rate
            moved = driven(recording, joint, samples) | goes_itself(recording, joint)[samples]
            if int(moved.sum()) * seconds > TELLS * len(samples):
                torque = prediction(model, evaluate(model, rows).coefficients)[:, [joint]]
                expected[joint] = recording.filtered(torque)[:, 0]
            if len(np.unique(every.block[every.parts[joint]])) < SCATTERED:
                continue
            usable = model.recording.usable[every.samples[joint]]
            beyond = beyond_splines(known, every, joint, usable)
            own, right = _told(beyond, every, joint, unknown, OFTEN * seconds)
            found += _over_rests(own, rows, joint)
            if not right:
                doubted += stretches_beyond(beyond.alone, every, joint, PEAK, FLANK)
    for joint in range(recording.effort.shape[1]):
        moved = expected.get(joint)
        abrupt = 0.0 if moved is None else ABRUPT * upper_octave(recording, joint)
        others = sorted(expected.keys() - {joint})
        found += rest_events(recording, joint, friction.get(joint, 0.0), moved, abrupt, others)
        if expected:
            found += shoved_events(recording, joint, moved, others)
        else:
            found += away_events(recording, joint)
    rounded = {joint: _rounded(recording, joint) for joint in range(recording.effort.shape[1])}
    found = [event for event in found if abs(event.peak) > rounded[event.joint]]
    told = tuple(sorted(_joined(found), key=lambda one: (one.begin, one.joint)))
    return Standing(told=told, doubted=tuple(doubted))


def _told(
    beyond: Beyond, rows: Rows, joint: int, unknown: np.ndarray, often: float
) -> tuple[list[Event], bool]:
    """Return the events of a moving joint, and whether its model is right between them.

    Args:
        beyond: what the model leaves.
        rows, joint, unknown: as of `_moving`.
        often: how many events are too many, unless the model is right between them.
    """
    every = [*_moving(beyond, rows, joint, unknown)]
    right = right_between(beyond, rows, joint, [event for event, _ in every])
    if len(_long(event for event, _ in every)) > max(3.0, often):
        # Splines miss what a push itself makes of the motion.
        every = [*_moving(beyond.by_model, rows, joint, unknown)] if right else []
    return _long(event for event, swings in every if not swings), right


def _rounded(recording: Recording, joint: int) -> float:
    """Return how far apart rounding sets two torques that a joint has, Nm or N: a step."""
    raw = [recording.raw_effort(trial, joint) for trial in range(len(recording.session.trials))]
    known = [signal for signal in raw if signal is not None]
    return float(np.sqrt(12.0)) * least_digit(np.concatenate(known)) if known else 0.0


def spared(recording: Recording, events: tuple[Event, ...]) -> Recording:
    """Return the recording with the samples of events marked, too: no fit uses them."""
    disturbed = np.zeros(recording.effort.shape, dtype=bool)
    if recording.disturbed is not None:
        disturbed |= recording.disturbed
    for event in events:
        inside = (recording.time >= event.begin) & (recording.time <= event.end)
        disturbed[inside & (recording.trial == event.trial), event.joint] = True
    return replace(recording, disturbed=disturbed)


def _moving(
    beyond: Beyond, rows: Rows, joint: int, unknown: np.ndarray
) -> Iterator[tuple[Event, bool]]:
    """Yield what stands out of a moving joint's residual and is not there in other passes.

    With each whether it swings back (`_swings`), so that it is no event.

    Args:
        beyond: what is left of it beside what is known by now.
        rows: the samples of all joints in motion.
        joint: which.
        unknown: torque that no motion shows, Nm or N, low-passed, (n,). Where a joint turns,
            sticking for a moment as long as a controller takes, its friction has any value, as at
            rest; when a link flies through its play, and how it lands, no sample says.
    """
    recording, samples = rows.recording, rows.samples[joint]
    left, pieces = beyond.least, pieces_of(rows, joint)
    step = float(np.median(np.diff(recording.time[samples])))
    turned = recording.since_reversal(joint)[samples]
    motion = [x[samples, joint] for x in (recording.velocity, recording.acceleration)]
    places = [recording.position[samples, joint], np.sign(turned) * np.log(np.abs(turned) + 0.02)]
    clock = clock_of(recording)[samples]
    ways = [Way(clock, [place, *motion]) for place in places]
    octave = np.maximum(upper_octave(recording, joint)[samples], 1e-12)
    # Less than matters beside the effort is no event, nor what shakes the joint all along.
    matters = MIN_TORQUE * rms(recording.effort[samples, joint])
    line = strongest_line([beyond.alone[piece] for piece in pieces], 1.0 / step)
    matters = max(matters, 0.0 if line is None else OF_LINE * line.rms)
    every: np.ndarray | None = None
    for seconds in SCALES:
        width = max(1, round(seconds / step))
        relative, sure, alone, predicted, excused, abrupt = (
            _averaged(signal, pieces, width)
            for signal in (
                beyond.relative,
                beyond.sure,
                beyond.alone,
                beyond.left,
                unknown[samples],
                octave,
            )
        )
        # What a right model leaves is noise; of a wrong one splines take what is usual.
        usual = max(min(spread(alone), spread(predicted)), 1e-12)
        size = np.abs(relative) / max(spread(relative), 1e-12)
        size = np.minimum(size, np.abs(alone) / usual)
        smooth = np.sign(predicted) * size
        # Of single rows, by the first scale: means of what rings are its first swing alone.
        every = smooth if every is None else every
        if np.mean(size > PEAK) > LOCAL:
            continue
        for piece in pieces:
            for run in runs(size[piece] > FLANK):
                own = piece[run]
                least = np.minimum(np.abs(sure[own]), np.abs(alone[own]))
                told = np.minimum(np.abs(predicted[own]), np.abs(alone[own])) > matters
                clear = own[_lasting((least > excused[own]) & told, size[own])]
                if not len(clear):
                    continue
                calm = clear[least[clear - own[0]] > ABRUPT * abrupt[clear]]
                among = calm if len(calm) else clear
                top = int(among[np.argmax(size[among])])
                if not len(calm) and not _more_than_abrupt(alone, abrupt, rows, joint, top):
                    continue
                if any(way.comes_back(smooth, top) for way in ways):
                    continue
                # Since it turned, not where: gravity is nowhere else the opposite.
                if ways[1].comes_back(smooth, top, mirrored=True):
                    continue
                peak = own[np.argmax(np.abs(left[own]))]
                event = Event(
                    trial=int(recording.trial[samples[top]]),
                    joint=joint,
                    begin=float(recording.time[samples[own[0]]]),
                    end=float(recording.time[samples[own[-1]]]),
                    peak=float(left[peak]),
                )
                yield event, _swings(every, piece, run, max(1, round(BESIDE / step)))


def _swings(every: np.ndarray, piece: np.ndarray, run: slice, beside: int) -> bool:
    """Whether what stands out of a run swings to the other side as well, just before or after it.

    Somebody pushes one way. A spring that rings, the knock of a gap that closes, and a controller
    that answers either do not.

    Args:
        every: what is left of every row, over what is usual, with its sign, (r,).
        piece: the rows of one motion without a gap.
        run: which of them.
        beside: how many rows before and after it are looked at, or as many as it has.
    """
    beside = max(beside, run.stop - run.start)
    around = every[piece[max(0, run.start - beside) : run.stop + beside]]
    own = every[piece[run]]
    peak = float(own[np.argmax(np.abs(own))])
    other = float(np.max(-np.sign(peak) * around))
    return other > max(SWING * abs(peak), BEYOND_NOISE)


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
    time, block = clock_of(rows.recording)[rows.samples[joint]], rows.block[rows.parts[joint]]
    like = (octave > 0.5 * octave[top]) & (np.abs(time - time[top]) > ELSEWHERE)
    share = np.abs(left) / octave
    if len(np.unique(block[like])) < LEAST_BLOCKS:
        return False
    return bool(share[top] > AS_ABRUPT * share[like].max())


def _long(events: Iterable[Event]) -> list[Event]:
    """Return events joined, without those that are shorter than any."""
    return [event for event in _joined(events) if event.end - event.begin > SHORTEST]


def _over_rests(events: Sequence[Event], rows: Rows, joint: int) -> list[Event]:
    """Return a joint's events with those joined between which it only rests, too shortly to judge.

    A push holds it there as well. (A stranger's three lost their middle, and K was 2 % off by it.)
    """
    samples, found = rows.samples[joint], [*events[:1]]
    time, trial = rows.recording.time[samples], rows.recording.trial[samples]
    for last, event in itertools.pairwise(events):
        between = (trial == event.trial) & (time > last.end) & (time < event.begin)
        follows = last.trial == event.trial and event.begin - last.end < LEAST_REST
        if follows and last.peak * event.peak > 0.0 and not between.any():
            begin = found.pop().begin
            peak = max(last.peak, event.peak, key=abs)
            event = replace(event, begin=begin, peak=peak)
        found.append(event)
    return found


def _joined(events: Iterable[Event]) -> list[Event]:
    """Return events with those of one joint joined that overlap or follow at once."""
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
