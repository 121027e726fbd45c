"""What a joint's torque leaves beside what is known, and beside splines on all its signals.

Fitted so that a few wrong seconds do not count (bisquare weights, Beaton and Tukey 1974), every
second predicted from others.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

from analysis.closeloop.identification.balance.least_squares import gram_matrices
from analysis.closeloop.identification.balance.model import Model
from analysis.closeloop.identification.balance.regression import SCATTERED, Rows
from analysis.closeloop.identification.balance.sticking import samples_step
from analysis.closeloop.identification.explainable import phase_groups, signal_groups
from analysis.closeloop.identification.findings import Event
from analysis.closeloop.identification.presliding import with_free_presliding
from analysis.closeloop.judgement.holds import spread
from analysis.closeloop.session.runs import runs

#: Rows of a joint in motion, below which nothing is said of it.
LEAST_ROWS = 50
#: How many neighbouring rows noise makes alike, which a fit takes for as many less.
COLOUR = 10.0
#: Share of the rows that tell what is usual where a fit is about as sure.
LIKE = 0.25
#: Trials in which a limb's tone may differ, and the share of the spread that is left if it does.
LEAST_TRIALS, DIFFERS = 3, 0.7
#: How long before and after an event filters carry it, s.
BESIDE = 0.1
#: Rounds of the robust fit, and its bisquare's width.
ROUNDS, WIDTH = 5, 4.7


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
    def by_model(self) -> "Beyond":
        """The same without splines, which have nothing to say where the model is right."""
        return Beyond(alone=self.alone, left=self.alone, doubt=np.zeros(len(self.alone)))

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


def beyond_splines(
    model: Model, rows: Rows, joint: int, fitted: np.ndarray | None = None
) -> Beyond:
    """Return what the model leaves of a joint, alone and with splines on all signals beside it.

    Args:
        model: what is known by now.
        rows: the samples of all joints.
        joint: which.
        fitted: the joint's rows that may be fitted, (r,); None if all may.
    """
    part, recording = rows.parts[joint], rows.recording
    groups = signal_groups(rows, joint) | phase_groups(recording, joint)
    splines = np.concatenate(list(groups.values()), axis=1)
    base, _ = with_free_presliding(model, [joint]).base(rows)
    turned, target = model.base(rows)[0][part], model.target(rows)[part]
    folds = [np.flatnonzero(rows.block[part] % SCATTERED == k) for k in range(SCATTERED)]
    tone = _tone(turned, target, folds, rows, joint)
    stacked = rows.stack(model.transformed({joint: splines}), splines.shape[1])
    table = np.concatenate([np.ones((len(base), 1)), base, stacked], axis=1)[part]
    table = np.column_stack([table, tone])
    scale = np.sqrt((table**2).mean(axis=0))
    kept = scale > 1e-9
    table = table[:, kept] / scale[kept]
    both = np.column_stack([table, target])
    sound = np.ones(len(target)) if fitted is None else fitted.astype(float)
    weight, left, doubt = sound, target, np.zeros(len(target))
    for _ in range(ROUNDS):
        grams = gram_matrices(both * np.sqrt(weight)[:, None], folds)
        total = grams.sum(axis=0)
        left, doubt = np.empty_like(target), np.empty_like(target)
        for own, gram in zip(folds, grams, strict=True):
            left[own], doubt[own] = _predicted(total - gram, table[own], target[own])
        sure = left / np.sqrt(1.0 + COLOUR * doubt)
        size = np.abs(sure) / (WIDTH * max(spread(sure), 1e-12))
        weight = sound * np.where(size < 1, (1 - size**2) ** 2, 0.0)
    alone = _smaller(_left(target, base[part], weight), _left(target, turned, weight))
    velocity = recording.velocity[:, [joint]]
    drag = rows.stack(model.transformed({joint: velocity * np.abs(velocity)}), 1)[part]
    # What grows with the speed like that of a fluid pushes nobody where a joint is fastest, which
    # is seldom. (A stranger's eight.)
    alone = _smaller(alone, _left(target, np.column_stack([turned, drag]), weight))
    if tone.size:
        alone = _smaller(alone, _left(target, np.column_stack([turned, tone]), weight))
    if spread(left) > np.sqrt(2.0) * spread(alone):
        # A joint that drifts while it is held has too few seconds for splines: their own error is
        # larger than all that the model leaves, so they have nothing to say. (Twice the power: set
        # while looking at limbs 639 and 5059 of the unkind bench.)
        return Beyond(alone=alone, left=left, doubt=doubt).by_model
    return Beyond(alone=alone, left=left, doubt=doubt)


def right_between(beyond: Beyond, rows: Rows, joint: int, events: Sequence[Event]) -> bool:
    """Whether a joint's model leaves no more between events than splines on all signals do.

    Of a form that is wrong they take some wherever the joint goes, and events are what it leaves.
    """
    between = ~_within(rows, joint, events)
    if between.sum() < LEAST_ROWS:
        return False
    return spread(beyond.alone[between]) <= spread(beyond.left[between])


def stretches_beyond(
    alone: np.ndarray, rows: Rows, joint: int, peak: float, flank: float
) -> list[Event]:
    """Return where a joint's model by itself leaves much more than it usually does.

    Args:
        alone: what it leaves, Nm or N, (r,).
        rows: the samples of all joints in motion.
        joint: which.
        peak: how much more that is at its most, over its spread.
        flank: and how much as long as it lasts.
    """
    samples, recording = rows.samples[joint], rows.recording
    size = np.abs(alone) / max(spread(alone), 1e-12)
    return [
        Event(
            trial=int(recording.trial[samples[run.start]]),
            joint=joint,
            begin=float(recording.time[samples[run.start]]) - BESIDE,
            end=float(recording.time[samples[run.stop - 1]]) + BESIDE,
            peak=float(alone[run][np.argmax(size[run])]),
        )
        for piece in pieces_of(rows, joint)
        for run in (slice(piece[0] + r.start, piece[0] + r.stop) for r in runs(size[piece] > flank))
        if size[run].max() > peak
    ]


def pieces_of(rows: Rows, joint: int) -> list[np.ndarray]:
    """Return the numbers of a joint's rows, (k,) each, in pieces without a gap."""
    samples = rows.samples[joint]
    gaps = np.flatnonzero(np.diff(samples) > 2 * samples_step(samples)) + 1
    return np.split(np.arange(len(samples)), gaps)


def _within(rows: Rows, joint: int, events: Sequence[Event]) -> np.ndarray:
    """Return which of a joint's rows events touch, or filters carry them to, (r,)."""
    samples = rows.samples[joint]
    time, trial = rows.recording.time[samples], rows.recording.trial[samples]
    inside = np.zeros(len(samples), dtype=bool)
    for event in events:
        near = (time >= event.begin - BESIDE) & (time <= event.end + BESIDE)
        inside |= near & (trial == event.trial)
    return inside


def _tone(
    known: np.ndarray, target: np.ndarray, folds: list[np.ndarray], rows: Rows, joint: int
) -> np.ndarray:
    """Return what stiffness, damping and rest of its own in every trial are fitted with, (r, k).

    No columns unless a limb's muscles are that different: what they do in one trial and not in the
    others is not local. (In two strangers' sessions, some of it was told as pushes.)

    Args:
        known: columns of the model, (r, c).
        target: what they are fitted to, Nm or N, (r,).
        folds: rows of which each is predicted from the others.
        rows: the samples of all joints in motion.
        joint: whose limb.
    """
    none = np.empty((len(target), 0))
    trials = rows.trial[rows.parts[joint]]
    if joint not in rows.recording.limbs or len(np.unique(trials)) < LEAST_TRIALS:
        return none
    samples, recording = rows.samples[joint], rows.recording
    motion = [x[samples, joint] for x in (recording.position, recording.velocity)]
    each = np.column_stack([np.ones(len(samples)), *motion])
    tone = np.column_stack([each * (trials == number)[:, None] for number in np.unique(trials)])
    left = []
    for table in (np.column_stack([np.ones(len(known)), known]), np.column_stack([known, tone])):
        found = np.empty_like(target)
        for own in folds:
            others = np.setdiff1d(np.arange(len(target)), own)
            fit = np.linalg.lstsq(table[others], target[others], rcond=1e-9)[0]
            found[own] = target[own] - table[own] @ fit
        left.append(spread(found))
    return tone if left[1] < DIFFERS * left[0] else none


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
