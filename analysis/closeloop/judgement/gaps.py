"""What was recorded beside lost samples, where no fit looks: a push may go on across them.

How a joint moved among lost samples nobody knows, and the filters carry that to both sides. How
much it matters shows where nothing is lost: samples are taken away there, too. What stands beside a
gap tells of a push as far as it is more.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from analysis.closeloop.identification.balance.luck import LEAST_BLOCKS
from analysis.closeloop.identification.balance.model import Model, evaluate, prediction
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.balance.terms import kept_columns
from analysis.closeloop.session.recording import Recording
from analysis.closeloop.session.runs import runs
from analysis.closeloop.session.signals import LEAST_MEASURED, PiecesLowpass, derivatives
from sim.effects.laws.elastic import Viscoelastic

#: The samples before and after every gap, of which no fit sees any.
Sides = Sequence[tuple[slice, slice]]


@dataclass(frozen=True, kw_only=True)
class Gaps:
    """Gaps beside which a push is looked for."""

    sides: Sides = ()
    #: What a gap leaves of a right model before and after it, Nm or N, low-passed, (edge, joints).
    early: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))
    late: np.ndarray = field(default_factory=lambda: np.empty((0, 0)))


def gaps_of(model: Model, rows: Rows) -> Gaps:
    """Return a recording's gaps and what they leave of a right model; none if that shows nowhere.

    As many samples as the longest has are taken away wherever none is lost, and what the model then
    leaves is compared. It is wrong by the motion that is bridged, and by what is quicker than the
    low-pass, which holds it back less where it sees one side only. The most of all places counts.
    (Of an opponent's it was a tenth of the torque that the motion takes, which had been excused.)

    Args:
        model: what is known by now.
        rows: the samples of all joints.
    """
    sides = sides_of(model.recording)
    torn = torn_elsewhere(model.recording, sides)
    effort = model.recording.unfiltered
    if effort is None or len(torn) < LEAST_BLOCKS or not rows.joints:
        return Gaps()
    left = effort - prediction(model, evaluate(model, rows).coefficients)
    wrong = np.abs(_left_by(model.recording, torn, left))
    return Gaps(
        sides=sides,
        early=np.max([wrong[before] for before, _ in torn], axis=0),
        late=np.max([wrong[after] for _, after in torn], axis=0),
    )


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
    """Return the recording with what was measured beside its gaps, too, but for rows in them."""
    if not sides or recording.unfiltered is None:
        return recording
    measured, lost = np.array(recording.measured), np.zeros(len(recording.time), dtype=bool)
    for before, after in sides:
        measured[before] = measured[after] = 1.0
        lost[before.stop : after.start] = True
    cutoff, rate = recording.sampling.fit_cutoff, recording.rate
    low = PiecesLowpass(measured, recording.slices, cutoff, rate)
    found = replace(recording, measured=measured, effort=low(recording.unfiltered))
    # The motion is the same: what only it tells is not computed again.
    known: Mapping[str, object] = {
        name: getattr(recording, name) for name in ("rigid", "inverse", "static", "_thinned")
    }
    vars(found).update(known, usable=found.usable & ~lost)
    return found


def torn_elsewhere(recording: Recording, sides: Sides) -> Sides:
    """Return the sides of gaps to be made where nothing is lost, as long as the longest is."""
    if not sides:
        return ()
    edge, found = recording.edge, []
    lost = max(after.start - before.stop for before, after in sides)
    for piece in recording.slices:
        for first in range(piece.start + 2 * edge, piece.stop - 2 * edge - lost, lost + 2 * edge):
            last = first + lost
            if recording.usable[first - edge : last + edge].all():
                found.append((slice(first - edge, first), slice(last, last + edge)))
    return found


def _left_by(recording: Recording, torn: Sides, left: np.ndarray) -> np.ndarray:
    """Return how gaps change what is left of every joint, Nm or N, low-passed, (n, joints).

    Args:
        recording: with all its samples.
        torn: the sides of gaps to be made.
        left: what a model leaves, not low-passed, (n, joints).
    """
    lost = np.zeros(len(recording.time), dtype=bool)
    for before, after in torn:
        lost[before.stop : after.start] = True
    sampling = replace(recording.sampling, recorded=recording.rate)
    moved = [derivatives(_bridged(recording, piece, lost), sampling) for piece in recording.slices]
    position, velocity, acceleration = np.concatenate(moved, axis=1)
    other = replace(
        recording,
        position=recording.position + position,
        velocity=recording.velocity + velocity,
        acceleration=recording.acceleration + acceleration,
        measured=np.where(lost, 0.0, recording.measured),
        cache={},
    )
    moved_left = left - (other.rigid - recording.rigid)
    return np.asarray(other.filtered(moved_left) - recording.filtered(left))


def _bridged(recording: Recording, piece: slice, lost: np.ndarray) -> np.ndarray:
    """Return by how much a stretch's positions differ with some samples bridged, (m, joints).

    Of what was recorded, as the stretch itself was made: how a bridge begins and ends is up to the
    noise of two samples.
    """
    time, number = recording.time[piece], recording.trial_of(piece)
    raw = recording.session.trials[number].time
    inside = (raw >= time[0]) & (raw <= time[-1])
    place = np.rint((raw - time[0]) * recording.rate).astype(int)
    kept = inside & ~lost[piece][np.clip(place, 0, len(time) - 1)]
    found = np.zeros_like(recording.position[piece])
    for joint in range(recording.position.shape[1]):
        position = recording.raw_position(number, joint)
        if position is not None and recording.name(joint) not in recording.device.ignored_joints:
            whole, torn = (_through(raw[own], position[own], time) for own in (inside, kept))
            found[:, joint] = torn - whole
    return found


def _through(time: np.ndarray, position: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return positions between samples, as `stretches` puts them there."""
    return np.asarray(CubicHermiteSpline(time, position, np.gradient(position, time))(wanted))


def of_gaps(model: Model, rows: Rows, joint: int, gaps: Gaps) -> np.ndarray:
    """Return torque beside gaps that they may leave themselves, Nm or N, low-passed, (n,).

    As much as they do elsewhere, and by how much the torque of every effect changes around there. A
    limb hardly matters: where it is, is known.

    Args:
        model: what is known by now.
        rows: the samples of all joints.
        joint: which.
        gaps: beside which it is looked for a push.
    """
    found = np.zeros(len(model.recording.time))
    if not gaps.sides:
        return found
    effects = [
        kept_columns(term)[joint] @ own
        for term, own in model.split(evaluate(model, rows).coefficients)
        if joint in term.columns and not isinstance(term.effect, Viscoelastic)
    ]
    for before, after in gaps.sides:
        around = slice(before.start, after.stop)
        changes = sum(np.ptp(torque[around]) for torque in effects)
        found[before] = gaps.early[:, joint] + changes
        found[after] = gaps.late[:, joint] + changes
    return found
