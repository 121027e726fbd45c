"""Joints that something shakes: their residual oscillates where the declared torque hardly does.

A tremor or a pump moves the joint at its own frequency, and the controller answers. In so narrow a
band effort and motion have one gain and one phase, which any two linear effects imitate: a lag and
an inertia, or a spring and its damping. But what only passes the motion on has no frequency that
the motion lacks (Ljung 1999, System Identification, section 13.4, on what closed loops hide). A
loop that rings because its motor is late is not shaken: its inertia needs torque at that frequency.
"""

import numpy as np

from analysis.closeloop.identification.balance.model import Model, estimate_of
from analysis.closeloop.identification.balance.regression import Rows, Score
from analysis.closeloop.identification.spectrum import Peak, below, strongest_line
from analysis.closeloop.session.recording import Recording

#: Share of a residual's power that one line holds, and that it has of the declared torque's at
#: least if the motion is what it comes from. Half, set while looking at tremors and pumps of the
#: unkind bench's seeds 900 to 1039 and at a loop that rings (tuning 7046: 0.59 of the torque).
MOST = 0.5


def shaken(model: Model, score: Score, rows: Rows) -> dict[int, Peak]:
    """Return the joints whose residual is mostly a line that is not what their motion needs.

    Args:
        model: fitted.
        score: its fit.
        rows: the samples that were fitted.

    Returns:
        The line of each.
    """
    recording = model.recording
    residual = np.nan_to_num(estimate_of(model, score.coefficients).residual)
    found = {}
    for joint in rows.joints:
        pieces = [residual[piece, joint] for piece in recording.slices]
        line = strongest_line(pieces, recording.rate)
        if line is None:
            continue
        torque = recording.inverse[:, joint]
        both = np.column_stack([residual[:, joint], torque - torque[rows.samples[joint]].mean()])
        left, needed = _share_within(line, both, recording, rows.samples[joint])
        if left > MOST > needed:
            found[joint] = line
    return found


def only_answers(
    line: Peak,
    before: np.ndarray,
    after: np.ndarray,
    rows: Rows,
    joint: int,
    *,
    passed: bool,
) -> bool:
    """Whether an effect takes away of a line that shakes its joint, and of little else.

    Torque that mostly has the line's frequency may be its cause, as a motor's ripple. What shakes
    one joint shakes its neighbours too, by some gain and phase: where torque passes from another
    joint, it is the cause only if it leaves no such line. (Set on three arms of an opponent that
    vibrate.)

    Args:
        line: of the residual without the effect.
        before: the residual, (n, joints), without the effect.
        after: with it.
        rows: the samples that were fitted.
        joint: which.
        passed: whether the effect's torque passes from another joint.
    """
    left = np.nan_to_num(np.column_stack([before[:, joint], after[:, joint]]))
    signals = np.column_stack([left, left[:, 0] - left[:, 1]])
    samples = rows.samples[joint]
    power = (signals[samples] ** 2).sum(axis=0)
    share = _share_within(line, signals, rows.recording, samples)
    gain, beside = power[0] - power[1], (1.0 - share[:2]) * power[:2]
    cause = share[2] > MOST and not (passed and share[1] > MOST)
    return bool(not cause and beside[0] - beside[1] < MOST * gain)


def _share_within(
    line: Peak, signals: np.ndarray, recording: Recording, samples: np.ndarray
) -> np.ndarray:
    """Return the share of each signal's power, (n, k), that a line holds, (k,)."""
    rate, pieces = recording.rate, recording.slices
    lower, upper = (below(signals, hertz, rate, pieces) for hertz in (line.low_hz, line.high_hz))
    beside = ((signals - upper + lower)[samples] ** 2).sum(axis=0)
    return np.asarray(1.0 - beside / np.maximum((signals[samples] ** 2).sum(axis=0), 1e-300))
