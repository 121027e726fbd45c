"""A late motor is late at every frequency of the motion, or it is none.

A robot is recorded in closed loop. A torque that nobody knows of (a tremor, a person's push) moves
the joint, and the controller answers: effort and motion are then related by the controller, and a
fit takes some of that for a late motor (Ljung 1999, System Identification, section 13.4; Forssell
and Ljung 1999, Closed-loop identification revisited). A true delay has one size at every frequency;
what the controller does in the band of a disturbance does not go on into the band of the motion. So
what such an effect explains is cut into octaves, and in each its size is asked for again.
"""

from collections.abc import Iterator

import numpy as np
from scipy.fft import dct, idct

from analysis.closeloop.identification.balance.model import Candidate, Model, evaluate, prediction
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.findings import Step
from analysis.closeloop.identification.growing import Grown
from analysis.closeloop.session.recording import Recording

#: Lowest octave's upper edge, Hz.
LOWEST = 0.5
#: How far an effect's size in an octave may be from that of the whole fit, over it, and how many
#: standard errors a difference has to be. Set on one tremor (0.8, 4 errors), one delay (0.01) and
#: one lag (0.14) of the unkind bench, tuning seeds.
OFF, ERRORS = 0.5, 3.0


def held_in_octaves(grown: Grown, rows: Rows) -> tuple[Grown, tuple[str, ...]]:
    """Take out effects of another size in one octave than over all of them, the last found first.

    Only of what passes the whole effort on, such as a delay: of other effects, what else is missing
    yet may differ from octave to octave.

    Args:
        grown: the model with its effects.
        rows: the samples that were fitted.

    Returns:
        The model with the effects that stay, and a sentence for each that went.
    """
    notes: list[str] = []
    while True:
        gone = next((step for step in reversed(grown.steps) if _differs(grown, step, rows)), None)
        if gone is None:
            return grown, tuple(notes)
        candidate = gone.taken.candidate
        notes.append(
            f"{candidate.effect.name} of {rows.recording.name(candidate.joint)} is not added: it "
            "would have another size at one frequency than at the others, as the controller's "
            "answer to an unknown torque has"
        )
        model = grown.model.without(candidate)
        left = tuple(step for step in grown.steps if step is not gone)
        grown = Grown(model, evaluate(model, rows), left)


def _differs(grown: Grown, step: Step, rows: Rows) -> bool:
    candidate = step.taken.candidate
    if not candidate.effect.channel or candidate not in grown.model.effects:
        return False
    return any(
        abs(size - 1.0) > max(OFF, ERRORS * error)
        for size, error in sizes(grown.model, candidate, rows)
    )


def sizes(model: Model, candidate: Candidate, rows: Rows) -> Iterator[tuple[float, float]]:
    """Yield an effect's size in each octave, over that of the whole fit, and its standard error.

    Args:
        model: with the effect; fitted to the rows.
        candidate: the effect and its joint.
        rows: the samples that were fitted.
    """
    joint, recording = candidate.joint, rows.recording
    expected = _expected(model, rows, joint)
    torque = expected - _expected(model.without(candidate), rows, joint)
    left = np.nan_to_num(recording.effort[:, joint] - expected)
    samples, block = rows.samples[joint], rows.block[rows.parts[joint]]
    below = np.zeros((len(left), 2))
    edge = LOWEST
    while edge < 2.0 * recording.sampling.fit_cutoff:
        both = _below(np.column_stack([torque, left]), edge, recording)
        own, rest = (both - below)[samples].T
        below, edge = both, 2.0 * edge
        power = float(own @ own)
        if power > 0.0:
            further = float(own @ rest) / power
            blocks = np.bincount(block, own * (rest - further * own))
            yield 1.0 + further, float(np.sqrt(blocks @ blocks)) / power


def _expected(model: Model, rows: Rows, joint: int) -> np.ndarray:
    torque = prediction(model, evaluate(model, rows).coefficients)[:, [joint]]
    return rows.recording.filtered(torque)[:, 0]


def _below(signals: np.ndarray, cutoff: float, recording: Recording) -> np.ndarray:
    """Return what of signals, (n, k), lies below a frequency, Hz.

    By cosines, whose even continuation makes nothing of where a piece begins.
    """
    out = np.empty_like(signals)
    for piece in recording.slices:
        spectrum = dct(signals[piece], axis=0)
        spectrum[np.arange(len(spectrum)) >= 2.0 * len(spectrum) * cutoff / recording.rate] = 0.0
        out[piece] = idct(spectrum, axis=0)
    return out
