"""What was recorded beside lost samples, where no fit looks: a push may go on across them.

How a joint moved among lost samples nobody knows, and the filters carry that to both sides. So rows
there tell of a push only what more than the motion takes, and what stands on both sides alike.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from analysis.closeloop.identification.balance.model import Model, evaluate
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.balance.terms import kept_columns
from analysis.closeloop.judgement.beyond import Beyond
from analysis.closeloop.judgement.holds import needed_by
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.runs import runs
from analysis.closeloop.session.signals import LEAST_MEASURED, PiecesLowpass
from sim.effects.laws.elastic import Viscoelastic

#: The samples before and after every gap, of which no fit sees any.
Sides = Sequence[tuple[slice, slice]]


def sides_of(recording: Recording) -> Sides:
    """Return the samples on both sides of every gap that a stretch goes on over.

    They are as many as the filters reach (`stretches.away_from_gaps`); a sample or two that are
    lost alone are no gap.
    """
    found = []
    for piece in recording.slices:
        for run in runs(recording.measured[piece] < LEAST_MEASURED):
            if run.stop - run.start > 2 * recording.edge:
                first, last = piece.start + run.start, piece.start + run.stop
                found.append(
                    (slice(first, first + recording.edge), slice(last - recording.edge, last))
                )
    return found


def with_sides(recording: Recording, sides: Sides) -> Recording:
    """Return the recording with what was measured beside its gaps, too."""
    if not sides or recording.unfiltered is None:
        return recording
    measured = np.array(recording.measured)
    for side in (side for pair in sides for side in pair):
        measured[side] = 1.0
    cutoff, rate = recording.sampling.fit_cutoff, recording.rate
    low = PiecesLowpass(measured, recording.slices, cutoff, rate)
    found = replace(recording, measured=measured, effort=low(recording.unfiltered))
    # The motion is the same: what only it tells is not computed again.
    known: Mapping[str, object] = {
        name: getattr(recording, name) for name in ("rigid", "inverse", "static", "_thinned")
    }
    vars(found).update(known)
    return found


def of_bridges(model: Model, rows: Rows, joint: int, sides: Sides) -> np.ndarray:
    """Return torque beside gaps that a wrong motion may be, Nm or N, low-passed, (n,).

    All that the declared chain's motion takes around there, and by how much the torque of every
    effect changes. A limb hardly matters: where it is, is known.
    """
    recording = model.recording
    found = np.zeros(len(recording.time))
    if not sides:
        return found
    moving = np.abs(needed_by(recording, joint) - recording.static[:, joint])
    fitted = model.split(evaluate(model, rows).coefficients)
    effects = [
        kept_columns(term)[joint] @ own
        for term, own in fitted
        if joint in term.columns and not isinstance(term.effect, Viscoelastic)
    ]
    for before, after in sides:
        around = slice(before.start, after.stop)
        found[around] = moving[around].max() + sum(np.ptp(torque[around]) for torque in effects)
    return found


def standing_on_both(beyond: Beyond, samples: np.ndarray, sides: Sides) -> Beyond:
    """Return what is left of a joint's rows, beside a gap only as far as on its other side.

    Args:
        beyond: what is left, of every row.
        samples: of the rows, (r,).
        sides: of the gaps.
    """
    alone, left = np.array(beyond.alone), np.array(beyond.left)
    for before, after in sides:
        middle = (before.stop + after.start) // 2
        early = (samples >= before.start) & (samples < middle)
        late = (samples >= middle) & (samples < after.stop)
        for signal in (alone, left):
            one, other = signal[early], signal[late]
            signal[early], signal[late] = _within(one, other), _within(other, one)
    return replace(beyond, alone=alone, left=left)


def _within(own: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the part of a signal that goes no further to either side than another does."""
    least, most = float(np.min(other, initial=0.0)), float(np.max(other, initial=0.0))
    return np.asarray(np.clip(own, least, most))
