"""Bounded least squares of the balance, scored on left-out groups.

All sums of squares come from one Gram matrix a fold, so a candidate with any number of variants
costs one product of its columns. Non-linear parameters are chosen on the training folds only, so a
held-out score owes nothing to the trials it is scored on.
"""

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.stats import norm, rankdata
from scipy.stats import t as student

from analysis.closeloop.identification.balance.halves import lone_carriers, lone_movers
from analysis.closeloop.identification.balance.least_squares import fits_without_each, gram_matrices
from analysis.closeloop.session.recording import Recording

#: Length over which the losses of a comparison are averaged before their spread is taken, s: a
#: movement in one direction, in which what is left hangs together, but no less and no more than
#: these. (That a quick robot's are shorter was found on the Staubli TX40.)
LEAST_BLOCK_SECONDS, BLOCK_SECONDS = 0.5, 1.0
#: Folds when all fit trials share one group: stretches of time instead of groups.
TIME_FOLDS = 6
#: Folds of blocks that are dealt out in turn, for what may not be asked to extrapolate.
SCATTERED = 5
#: What takes this share of all that is lost on rows it was not fitted to is no luck, though one
#: quick second should hold nearly all of it; it only has to win blocks by so many errors of their
#: ranks. Set on one delay of the unkind bench (tuning seeds): 0.98 of the loss, 1.3 errors.
WHOLE_GAIN, WHOLE_Z = 0.8, 2.5
#: Share of a loss that is rounding: the solver's ridge alone is a tenth of it.
ROUNDING = 1e-9


@dataclass(frozen=True, kw_only=True)
class Rows:
    """The samples that enter the fit, joint by joint; arrays over rows have shape (r,)."""

    recording: Recording
    #: For each analysed joint, its samples.
    samples: Mapping[int, np.ndarray]
    weight: np.ndarray
    fold: np.ndarray
    block: np.ndarray
    trial: np.ndarray
    grouped: bool
    #: Columns that were stacked before, by what they are; `once` fills it.
    stacked: dict[Hashable, Any] = field(default_factory=dict, repr=False)

    def once(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return what `make` gives, made at the first call with `key` only."""
        if key not in self.stacked:
            self.stacked[key] = make()
        return self.stacked[key]

    @property
    def joints(self) -> tuple[int, ...]:
        """Joints that have rows."""
        return tuple(joint for joint, own in self.samples.items() if len(own))

    @cached_property
    def parts(self) -> dict[int, slice]:
        """Where each joint's rows lie in arrays over rows."""
        ends = np.cumsum([len(own) for own in self.samples.values()])
        return {
            joint: slice(int(end) - len(own), int(end))
            for (joint, own), end in zip(self.samples.items(), ends, strict=True)
        }

    @cached_property
    def joint_of_block(self) -> np.ndarray:
        """Joint of each block, (blocks,)."""
        found = np.zeros(int(self.block.max()) + 1, dtype=int)
        for joint, part in self.parts.items():
            found[self.block[part]] = joint
        return found

    @property
    def of_one_second(self) -> float:
        """How many rows a second of one joint has, on average."""
        return len(self.weight) / len(self.joint_of_block)

    def left_by_joint(self, losses: np.ndarray) -> dict[int, float]:
        """Return the root mean square of every joint in its own unit, from the blocks' losses."""
        total = np.bincount(self.joint_of_block, losses)
        return {
            joint: float(np.sqrt(total[joint] / len(samples)) / self.weight[self.parts[joint]][0])
            for joint, samples in self.samples.items()
            if len(samples)
        }

    def of_joint(self, joint: int) -> "Rows":
        """Return the rows of one joint."""
        part = self.parts[joint]
        return Rows(
            recording=self.recording.of_joint(joint),
            samples={joint: self.samples[joint]},
            weight=self.weight[part],
            fold=self.fold[part],
            block=np.unique(self.block[part], return_inverse=True)[1],
            trial=self.trial[part],
            grouped=self.grouped,
        )

    @property
    def fold_of_block(self) -> np.ndarray:
        """Fold of each block, (blocks,)."""
        found = np.zeros(int(self.block.max()) + 1, dtype=int)
        found[self.block] = self.fold
        return found

    @cached_property
    def folds(self) -> list[np.ndarray]:
        return [np.flatnonzero(self.fold == number) for number in range(int(self.fold.max()) + 1)]

    @cached_property
    def halved(self) -> np.ndarray:
        """Which rows are of trials that alone show something, so that halves are left out, (r,)."""
        if not self.grouped:
            return np.zeros(len(self.trial), dtype=bool)
        numbers, first = np.unique(self.trial, return_index=True)
        other = self.fold != self.fold[first][np.searchsorted(numbers, self.trial)]
        return np.isin(self.trial, self.trial[other])

    def stack(self, columns: Mapping[int, np.ndarray], width: int) -> np.ndarray:
        """Low-pass columns per joint and stack them over rows, weighted, (r, width)."""
        parts = []
        for joint, samples in self.samples.items():
            if joint in columns:
                parts.append(self.recording.filtered(columns[joint])[samples])
            else:
                parts.append(np.zeros((len(samples), width)))
        return np.asarray(np.concatenate(parts) * self.weight[:, None])

    def stack_effort(self) -> np.ndarray:
        """Stack the measured effort, which is low-passed already, (r,)."""
        effort = [self.recording.effort[samples, joint] for joint, samples in self.samples.items()]
        return np.asarray(np.concatenate(effort) * self.weight)

    def effort_power(self, joint: int) -> float:
        """Return the sum of squares of one joint's weighted effort."""
        effort = self.recording.effort[self.samples[joint], joint]
        return float(((effort * self.weight[self.parts[joint]]) ** 2).sum())

    def smoothing_power(self, joint: int) -> float:
        """Return the sum of squares of what smoothing may have taken of a joint's torque, weighted.

        The positions passed a low-pass before they were differentiated. What it takes of the torque
        at a second pass is about what it took at the first.
        """

        def make() -> float:
            torque = self.recording.inverse[:, [joint]]
            gone = self.recording.filtered(torque - self.recording.smoothed(torque))[:, 0]
            weighted = gone[self.samples[joint]] * self.weight[self.parts[joint]]
            return float(weighted @ weighted)

        return float(self.once(("smoothing", joint), make))

    def where(self, kept: np.ndarray) -> "Rows":
        """Return some of the rows, (r,)."""
        return replace(
            self,
            samples={joint: own[kept[self.parts[joint]]] for joint, own in self.samples.items()},
            weight=self.weight[kept],
            fold=np.unique(self.fold[kept], return_inverse=True)[1],
            block=np.unique(self.block[kept], return_inverse=True)[1],
            trial=self.trial[kept],
            stacked={},
        )

    def reweighted(self, noise: Mapping[int, float]) -> "Rows":
        """Return the same rows with every joint's noise as the unit of its residual.

        A joint without rows, as one that is pushed wherever it moves, needs none.
        """
        weight = [
            np.full(len(s), 1.0 / noise[j] if len(s) else 1.0) for j, s in self.samples.items()
        ]
        return replace(self, weight=np.concatenate(weight), stacked={})


def select_rows(recording: Recording, trials: tuple[int, ...], *, rests: bool = False) -> Rows:
    """Choose samples of `trials`, away from the ends that the filter touches, thinned.

    Args:
        recording: all trials.
        trials: the numbers of those to fit.
        rests: whether to keep samples at rest, where friction is not determined.
    """
    step = max(1, int(recording.rate / (4.0 * recording.sampling.fit_cutoff)))
    edge = recording.edge
    groups = list(dict.fromkeys(recording.session.trials[i].group for i in trials))
    halves = _halves(recording, trials)
    samples, fold, block, trial = {}, [], [], []
    blocks = 0
    for joint in recording.joints:
        chosen = []
        movement = recording.movement_seconds(joint)
        length = float(np.clip(movement, LEAST_BLOCK_SECONDS, BLOCK_SECONDS))
        for piece in recording.slices:
            number = recording.trial_of(piece)
            if number not in trials or np.isnan(recording.effort[piece, joint]).any():
                continue
            inside = np.arange(piece.start + edge, piece.stop - edge, step)
            inside = inside[recording.usable[inside]]
            if recording.disturbed is not None:
                inside = inside[~recording.disturbed[inside, joint]]
            moving = ~recording.resting(joint, piece)[inside - piece.start]
            # What is left of a joint that somebody pushed may be its rests alone.
            if moving.sum() * step / recording.rate < 0.2:
                continue
            rows = inside if rests else inside[moving]
            chosen.append(rows)
            clock = recording.time[rows] - recording.time[piece.start]
            within = (clock / length).astype(int)
            block.append(blocks + within)
            blocks += int(within.max()) + 1
            trial.append(np.full(len(rows), number))
            own = 2 * groups.index(recording.session.trials[number].group)
            fold.append(own + (recording.time[rows] > halves.get(number, np.inf)))
        samples[joint] = np.concatenate(chosen) if chosen else np.empty(0, dtype=int)
    fold, block, trial = ([np.empty(0, dtype=int), *found] for found in (fold, block, trial))
    folds = np.concatenate(fold)
    present = np.unique(folds)
    grouped = len(present) > 1
    if grouped:
        folds = np.searchsorted(present, folds)
    else:
        # Stretches of time, the same of every joint.
        lengths = [len(own) for own in samples.values()]
        folds = np.concatenate([np.arange(n) * TIME_FOLDS // max(n, 1) for n in lengths])
    _, dense = np.unique(np.concatenate(block), return_inverse=True)
    return Rows(
        recording=recording,
        samples=samples,
        weight=np.ones(len(folds)),
        fold=folds,
        block=dense,
        trial=np.concatenate(trial),
        grouped=grouped,
    )


def _halves(recording: Recording, trials: tuple[int, ...]) -> dict[int, float]:
    """Return when to halve the trials of a group that alone carries a payload or moves joints."""
    fitted = {number: recording.session.trials[number] for number in trials}
    seen = recording.usable
    if recording.disturbed is not None:
        seen = seen & ~recording.disturbed.any(axis=1)
    travel: dict[str, list[np.ndarray]] = {}
    for number, trial in fitted.items():
        own = recording.position[seen & (recording.trial == number)]
        if len(own):
            travel.setdefault(trial.group, []).append(np.ptp(own, axis=0))
    alone = lone_carriers([*fitted.values()]) | lone_movers(travel, recording.joints)
    return {
        number: float(np.median(recording.time[recording.trial == number]))
        for number, trial in fitted.items()
        if trial.group in alone
    }


def scattered_folds(rows: Rows) -> list[np.ndarray]:
    """Return folds of whole blocks, dealt out in turn."""
    return [np.flatnonzero(rows.block % SCATTERED == number) for number in range(SCATTERED)]


@dataclass(frozen=True, kw_only=True)
class Variant:
    """One choice of non-linear parameters: the columns that are not absorbed by the base."""

    theta: Mapping[str, float]
    columns: np.ndarray
    kept: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class Score:
    """A model's fit to all rows, and what it loses on rows it was not fitted to."""

    variant: Variant
    #: Base coefficients, then those of the kept columns.
    coefficients: np.ndarray
    #: Mean squared held-out residual of every block (in units of the noise), (blocks,).
    losses: np.ndarray
    sse: float

    @property
    def loss(self) -> float:
        return float(self.losses.sum())


def score(
    rows: Rows,
    target: np.ndarray,
    base: np.ndarray,
    base_lower: np.ndarray,
    variants: Sequence[Variant],
    lower: Sequence[float],
    *,
    fold_rows: Sequence[np.ndarray] | None = None,
) -> Score:
    """Fit every variant beside the base and score the best on left-out folds.

    Args:
        rows: what the arrays' rows are.
        target: effort less what is known, weighted, (r,).
        base: columns that are always there, weighted, (r, b).
        base_lower: lower bounds of their coefficients, (b,).
        variants: at least one; an empty one scores the base itself.
        lower: lower bounds of an effect's coefficients; the last repeats.
        fold_rows: other folds than the groups.
    """
    folds = rows.folds if fold_rows is None else fold_rows
    grams, bounds = [], []
    for variant in variants:
        table = np.column_stack([base, variant.columns, target])
        grams.append(gram_matrices(table, folds))
        own = [lower[min(i, len(lower) - 1)] for i in variant.kept]
        bounds.append(np.concatenate([base_lower, own]))
    fits = [fits_without_each(own, bound) for own, bound in zip(grams, bounds, strict=True)]
    residual = np.zeros(len(target))
    for number, fold in enumerate(folds):
        best, coefficients, _ = _best_fit([fit[number] for fit in fits])
        table = np.column_stack([base[fold], variants[best].columns[fold]])
        residual[fold] = target[fold] - table @ coefficients
    best, coefficients, sse = _best_fit([fit[-1] for fit in fits])
    losses = np.bincount(rows.block, residual**2)
    return Score(variant=variants[best], coefficients=coefficients, losses=losses, sse=sse)


def _best_fit(fits: Sequence[tuple[np.ndarray, float]]) -> tuple[int, np.ndarray, float]:
    """Return which of several fits leaves least, its coefficients and its sum of squares."""
    best = min(range(len(fits)), key=lambda number: fits[number][1])
    return best, *fits[best]


def compare(worse: np.ndarray, better: np.ndarray) -> tuple[float, float]:
    """Return the summed difference of two models' block losses and its standard error.

    The error is at least what rounding makes: the same torque under two names differs by that.
    One block tells none: then it may be anything.
    """
    difference = worse - better
    if len(difference) < 2:
        return float(difference.sum()), np.inf
    error = float(np.sqrt(len(difference)) * difference.std(ddof=1))
    return float(difference.sum()), max(error, ROUNDING * float(worse.sum()), 1e-300)


def rank_z(worse: np.ndarray, better: np.ndarray) -> float:
    """Return how steadily the better model wins blocks: Wilcoxon's signed-rank statistic.

    Unlike the mean of `compare` it does not ask that blocks win alike: where acceleration grows as
    the square of a speed, a few fast seconds hold nearly all of a gain that every second shows.
    Source: Wilcoxon 1945, Individual comparisons by ranking methods.
    """
    difference = (worse - better)[worse != better]
    count = len(difference)
    if not count:
        return 0.0
    won = float(rankdata(np.abs(difference))[difference > 0].sum())
    spread = np.sqrt(count * (count + 1) * (2 * count + 1) / 24)
    return float((won - count * (count + 1) / 4) / spread)


def takes_all(worse: np.ndarray, better: np.ndarray) -> bool:
    """Whether nearly nothing is left of the losses, (blocks,), however few blocks hold them."""
    gain = float((worse - better).sum())
    steadily = rank_z(worse, better) > WHOLE_Z or ratio_z(worse, better) > WHOLE_Z
    return gain > WHOLE_GAIN * float(worse.sum()) and steadily


def ratio_z(worse: np.ndarray, better: np.ndarray) -> float:
    """Return how steadily losses, (blocks,), fall by a factor: Student's t of their logarithms.

    Ranks of fewer than eight blocks are never sure, though each should lose all but a thousandth.

    Returns:
        Standard errors of a normal distribution that are as rare; 0 of fewer than three blocks.
    """
    held = (worse > 0.0) & (better > 0.0)
    if held.sum() < 3:
        return 0.0
    factors = np.log(worse[held] / better[held])
    error = max(float(factors.std(ddof=1)) / np.sqrt(len(factors)), 1e-12)
    return float(norm.isf(student.sf(float(factors.mean()) / error, len(factors) - 1)))
