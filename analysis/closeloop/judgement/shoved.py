"""Where a resting joint goes away although its motor holds it: somebody moved it."""

from collections.abc import Iterator, Sequence

import numpy as np

from analysis.closeloop.identification.findings import Event
from analysis.closeloop.judgement.holds import (
    OVER_NOISE,
    PEAK,
    needed_by,
    noise_of,
    quiet_spread,
    rubs,
)
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.runs import AWAY, runs

#: A joint rests for so long before and after it is pushed, s, and moves so far within that time,
#: over the noise of its position: the start of a trial, where it sags, is no push.
REST = 0.5
#: Friction may keep it on the way back, but this share of the way it comes: what slips does not.
RETURNS = 0.25


def away_events(recording: Recording, joint: int) -> Iterator[Event]:
    """Yield where a joint of a still arm goes away against its motor, and comes back.

    A push of a few times the effort's noise moves it by far more than its encoder's.

    Args:
        recording: all trials, in which no joint moves by itself.
        joint: which.
    """
    trials = np.unique(recording.trial)
    noise = max(noise_of(recording.raw_position(trial, joint)) for trial in trials)
    places = [recording.position[piece, joint] for piece in recording.slices]
    usual = max(noise, quiet_spread(np.concatenate([own - np.median(own) for own in places])))
    if usual <= 0.0:
        return
    # Of a joint that never moves by itself nothing can rub.
    beyond = None if recording.still else recording.effort[:, joint] - needed_by(recording, joint)
    for piece, place in zip(recording.slices, places, strict=True):
        moves = np.abs(recording.velocity[piece, joint]) > PEAK * usual / REST
        torque = (recording.effort - recording.static)[piece, joint]
        for run in _between_rests(moves, recording.rate):
            rested = slice(run.start - int(REST * recording.rate), run.start)
            away = place[run] - np.median(place[rested])
            push = torque[run] - np.median(torque[rested])
            top = int(np.argmax(np.abs(away)))
            back = abs(away[-1]) < (1.0 - RETURNS) * abs(away[top])
            rubbing = False
            if beyond is not None:
                beside = (beyond[piece] - np.median(beyond[piece][rested]))[run]
                # On the way back its motor works against friction, whoever moved it.
                rubbing = rubs(recording.velocity[piece, joint][run][: top + 1], beside[: top + 1])
            # Of an effort that is not recorded nothing can be said.
            if abs(away[top]) > PEAK * usual and back and away @ push < 0.0 and not rubbing:
                # It may creep back for seconds.
                far = np.flatnonzero(np.abs(away) > RETURNS * abs(away[top]))
                clock = recording.time[piece.start + run.start :]
                yield Event(
                    trial=int(recording.trial[piece.start]),
                    joint=joint,
                    begin=float(clock[far[0]]),
                    end=float(clock[far[-1]]),
                    peak=float(push[np.argmax(np.abs(push))]),
                )


def shoved_events(
    recording: Recording, joint: int, expected: np.ndarray | None, others: Sequence[int]
) -> Iterator[Event]:
    """Yield where a joint leaves its rest while its motor takes work up.

    Friction may keep it there. A motor that moves its joint, or whose torque grows until friction
    gives way, gives work on that way; so somebody else did. That has to hold beside each torque
    that the joint may have needed meanwhile: what it took before and after, so that no wrong
    gravity shows, and what is known of it.

    Args:
        recording: all trials.
        joint: which.
        expected: its effort as a model fitted to its motion has it, low-passed, (n,), if known.
        others: joints that move by themselves now and then: their reaction takes this one along.
    """
    rate = recording.rate
    known = [recording.static[:, joint], needed_by(recording, joint)]
    known += [] if expected is None else [expected]
    for piece in recording.slices:
        trial = int(recording.trial[piece.start])
        velocity, effort = (x[piece, joint] for x in (recording.velocity, recording.effort))
        noise = noise_of(recording.raw_effort(trial, joint))
        place = recording.position[piece, joint]
        calm = np.ones(len(place), dtype=bool)
        for other in others:
            calm &= recording.resting(other, piece)
        for run in _between_rests(~recording.resting(joint, piece), rate):
            before = slice(run.start - int(REST * rate), run.start)
            if not calm[before].all():
                continue
            after = slice(run.stop, run.stop + int(REST * rate))
            away = np.abs(place[run] - np.median(place[before]))
            out = slice(run.start, run.start + int(np.argmax(away)) + 1)
            # Torque against the motion, in the mean over the way, beside each of these.
            way = velocity[out] / np.abs(velocity[out]).sum()
            held = [float(np.median(effort[rest])) for rest in (before, after)]
            against = [-way @ (effort[out] - torque) for torque in held]
            sure = [-way @ (effort - torque[piece])[out] for torque in known]
            moving = np.abs(known[1] - known[0])[piece][run].max()
            if min(against) <= 0.0 or min(sure) <= max(OVER_NOISE * noise, moving):
                continue
            push = effort[run] - held[0]
            yield Event(
                trial=trial,
                joint=joint,
                begin=float(recording.time[piece.start + run.start]),
                end=float(recording.time[piece.start + run.stop - 1]),
                peak=float(push[np.argmax(np.abs(push))]),
            )


def _between_rests(moves: np.ndarray, rate: float) -> Iterator[slice]:
    """Yield motions of at most `AWAY` with a rest before and after, as long as `REST`.

    Args:
        moves: whether a joint moves, (n,).
        rate: samples per second.
    """
    rest, longest = int(REST * rate), int(AWAY * rate)
    found: list[slice] = []
    for run in runs(moves):
        if found and run.start - found[-1].stop < longest:
            run = slice(found.pop().start, run.stop)
        found.append(run)
    for run in found:
        rests = run.start >= rest and run.stop + rest <= len(moves)
        if rests and run.stop - run.start <= longest:
            yield run
