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

#: Share of a residual's power that one line holds, and that it has of the declared torque's at
#: least if the motion is what it comes from. Half, set while looking at tremors and pumps of the
#: unkind bench's seeds 900 to 1039 and at a loop that rings (tuning 7046: 0.59 of the torque).
MOST = 0.5


def shaken(model: Model, score: Score, rows: Rows) -> frozenset[int]:
    """Return the joints whose residual is mostly a line that is not what their motion needs.

    Args:
        model: fitted.
        score: its fit.
        rows: the samples that were fitted.
    """
    recording = model.recording
    residual = np.nan_to_num(estimate_of(model, score.coefficients).residual)
    found = set()
    for joint in rows.joints:
        pieces = [residual[piece, joint] for piece in recording.slices]
        line = strongest_line(pieces, recording.rate)
        if line is None:
            continue
        torque = recording.inverse[:, joint]
        both = np.column_stack([residual[:, joint], torque - torque[rows.samples[joint]].mean()])
        left, needed = _share_within(line, both, model, rows.samples[joint])
        if left > MOST > needed:
            found.add(joint)
    return frozenset(found)


def _share_within(line: Peak, signals: np.ndarray, model: Model, samples: np.ndarray) -> np.ndarray:
    """Return the share of each signal's power, (n, k), that a line holds, (k,)."""
    rate, pieces = model.recording.rate, model.recording.slices
    lower, upper = (below(signals, hertz, rate, pieces) for hertz in (line.low_hz, line.high_hz))
    beside = ((signals - upper + lower)[samples] ** 2).sum(axis=0)
    return np.asarray(1.0 - beside / np.maximum((signals[samples] ** 2).sum(axis=0), 1e-300))
