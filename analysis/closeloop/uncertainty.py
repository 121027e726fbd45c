"""Intervals of everything that was fitted: a jackknife by trial and one by place.

Every trial is left out of the fit in turn, which shows what noise and the choice of trials do, and
so is every place, one direction over one eighth of the range, in all trials at once: where the real
form differs from the model's, the misfit comes back there in every trial and does not average out
over them. The two variances add; what is noise alone counts twice then, and such an interval is up
to 1.4 times as wide as it need be. Both are cluster-robust variances of the kind CR3, which few
clusters of unequal weight do not make too small (Bell and McCaffrey 2002), with Student's t for one
degree of freedom less than the fewer clusters (Cameron and Miller 2015, A practitioner's guide to
cluster-robust inference).

Non-linear parameters take part through the slope of the prediction, as one more column each (a
Gauss-Newton step of every fit), so their intervals and what they add to the others' come out of the
same fits. How far that step goes for all rows is the error of the grid they were chosen from; an
interval holds both ends of it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t

from analysis.closeloop.model import Channel, Model, Term, no_estimate, prediction
from analysis.closeloop.regression import Rows, solve

#: Confidence of every interval.
CONFIDENCE = 0.9
#: Trials from which on whole trials are left out; below, one-second blocks.
MIN_TRIALS = 4
#: Parts of the range that are left out, each in either direction.
PARTS = 8
#: Parameters of the grid that are choices, not numbers to have an interval.
CHOICES = {"side", "power", "load", "viscous", "smooth", "width", "offset"}


@dataclass(frozen=True, kw_only=True)
class Fits:
    """The fit to all rows, then the fits without each cluster of each partition in turn."""

    #: Coefficients, (1 + clusters, n).
    coefficients: np.ndarray
    #: Non-linear parameters by effect, joint and name, (1 + clusters,) each.
    thetas: Mapping[tuple[str, int, str], np.ndarray]
    #: Number of clusters of each partition.
    sizes: tuple[int, ...]

    def interval(
        self, found: np.ndarray, value: float, lowest: float = -np.inf
    ) -> tuple[float, float]:
        """Return the 90 % interval of a quantity.

        Args:
            found: the quantity from each of the fits, (1 + clusters,).
            value: what is reported; with `found[0]` a part of the interval.
            lowest: physical bound; the interval ends there.
        """
        return jackknife_interval(
            found[0], np.split(found[1:], np.cumsum(self.sizes)[:-1]), value, lowest
        )


def jackknife_interval(
    whole: float, left_out: list[np.ndarray], value: float, lowest: float = -np.inf
) -> tuple[float, float]:
    """Return a 90 % interval from fits that leave out cluster after cluster.

    Args:
        whole: the quantity from all rows.
        left_out: for each partition, the quantity without each of its clusters, (clusters,).
        value: what is reported.
        lowest: physical bound.
    """
    variance = 0.0
    for found in left_out:
        moved = found[np.isfinite(found)] - whole
        variance += (len(found) - 1) / len(found) * float(moved @ moved)
    fewest = min(len(found) for found in left_out)
    half = float(t.ppf((1 + CONFIDENCE) / 2, fewest - 1)) * float(np.sqrt(variance))
    return max(min(value - half, whole), min(lowest, value)), max(value + half, whole)


def leave_out(model: Model, rows: Rows, coefficients: np.ndarray) -> Fits:
    """Fit the model to all rows, and without each trial and each place in turn."""
    base, lower = model.base(rows)
    target = model.target(rows)
    slopes, keys = _slopes(model, rows, coefficients)
    table = np.column_stack([base, *slopes, target])
    bounds = np.concatenate([lower, np.full(len(slopes), -np.inf)])
    trials = rows.trial if len(np.unique(rows.trial)) >= MIN_TRIALS else rows.block
    fits, sizes = [solve(table.T @ table, bounds)], []
    for clusters in (trials, places(rows)):
        grams = [part.T @ part for part in (table[clusters == n] for n in np.unique(clusters))]
        # One trial of a second is one block; a joint that moves is in several places at least.
        if len(grams) > 1:
            total = np.sum(grams, axis=0)
            fits += [solve(total - gram, bounds) for gram in grams]
            sizes.append(len(grams))
    every = np.array(fits)
    size = base.shape[1]
    return Fits(
        coefficients=every[:, :size],
        thetas={key: theta + every[:, size + i] for i, (key, theta) in enumerate(keys)},
        sizes=tuple(sizes),
    )


def places(rows: Rows) -> np.ndarray:
    """Return each row's joint, part of that joint's range and direction as one number, (r,)."""
    found = []
    for joint, samples in rows.samples.items():
        position = rows.recording.position[samples, joint]
        forward = rows.recording.velocity[samples, joint] > 0
        low, high = (position.min(), position.max()) if len(position) else (0.0, 0.0)
        part = ((position - low) / max(high - low, 1e-300) * PARTS).astype(int)
        found.append((joint * PARTS + np.minimum(part, PARTS - 1)) * 2 + forward)
    return np.concatenate(found)


def _slopes(
    model: Model, rows: Rows, coefficients: np.ndarray
) -> tuple[list[np.ndarray], list[tuple[tuple[str, int, str], float]]]:
    """Return the prediction's slope over every non-linear parameter, stacked over rows."""
    slopes, keys = [], []
    parts: list[Term | Channel] = [*model.terms, *model.channels]
    for part in parts:
        if part.candidate is None:
            continue
        for name, value in part.theta.items():
            if name in CHOICES:
                continue
            step = 1e-3 + 0.02 * abs(value) if name not in ("delay", "time_constant") else 5e-4
            up, down = (
                prediction(_moved(model, part, name, value + sign * step), coefficients)
                for sign in (1.0, -1.0)
            )
            slope = (up - down) / (2 * step)
            column = rows.stack({j: slope[:, [j]] for j in rows.samples}, 1)[:, 0]
            if float(column @ column) > 1e-12 * len(column):
                slopes.append(column)
                keys.append(((part.candidate.effect.name, part.candidate.joint, name), value))
    return slopes, keys


def _moved(model: Model, part: Term | Channel, name: str, value: float) -> Model:
    """Return the model with one non-linear parameter moved."""
    theta = {**part.theta, name: value}
    if isinstance(part, Channel):
        moved = replace(part, theta=theta)
        return replace(model, channels=tuple(moved if c is part else c for c in model.channels))
    assert part.candidate is not None
    effect = part.candidate.effect
    if effect.uses_estimate and name not in ("order", "offset"):
        return model
    columns = effect.columns(model.recording, part.joint, theta, no_estimate(model.recording))
    moved_term = replace(part, theta=theta, columns=columns)
    return replace(model, terms=tuple(moved_term if t is part else t for t in model.terms))
