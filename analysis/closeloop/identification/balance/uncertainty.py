"""Intervals of everything that was fitted: a jackknife by trial, and what places add to it.

Every trial is left out of the fit in turn, which shows what noise and the choice of trials do.
Where the real form differs from the model's, the misfit comes back at the same places in every
trial and does not average out over them; so every place is left out in turn, too, in all trials at
once. But noise moves that jackknife as well, and would count twice if the two variances were added.
As in clustering in two ways (Cameron, Gelbach and Miller 2011, Robust inference with multiway
clustering; by jackknives, and never less than one way alone: MacKinnon, Nielsen and Webb 2024,
Jackknife inference with two-way clustering) what both hold is taken off once:

    variance = V(trials) + max(0, V(places) - r V(places of each trial))

V(places of each trial) is a jackknife over the same places in one trial at a time: what noise
alone makes of them. Leaving out whole clusters overstates noise, the more so the larger they are; r
is the ratio of both under white noise, which the columns determine (as in Bell and McCaffrey 2002,
Bias reduction in standard errors for linear regression with multi-stage samples). So the difference
is nothing on average where nothing comes back. A misfit that is smooth is shared by neighbouring
places, which calls for few and large ones (Bester, Conley and Hansen 2011, Inference with dependent
data using cluster covariance estimators); one that follows the direction, as friction does, for
both directions apart; one that follows speed, for parts of the velocity's range. So the range is
cut in several ways, and the one that shows most counts.
Student's t has the degrees of freedom of Satterthwaite (1946) for the sum, each part having one
less than its clusters.

Non-linear parameters take part through the slope of the prediction, as one more column each (a
Gauss-Newton step of every fit), so their intervals and what they add to the others' come out of the
same fits. How far that step goes for all rows is the error of the grid they were chosen from; an
interval holds both ends of it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import t

from analysis.closeloop.contract import CONFIDENCE
from analysis.closeloop.identification.balance.least_squares import inverse_of, solve
from analysis.closeloop.identification.balance.model import (
    Model,
    estimate_beside,
    prediction,
    unfitted,
)
from analysis.closeloop.identification.balance.regression import Rows
from analysis.closeloop.identification.balance.terms import Channel, Term

#: Trials from which on whole trials are left out; below, one-second blocks.
MIN_TRIALS = 4
#: Ways to cut the range into places: of which signal, how many parts, and whether either direction
#: is on its own.
CUTS = (("position", 8, True), ("position", 3, False), ("velocity", 3, False))


@dataclass(frozen=True, kw_only=True)
class Fits:
    """The fit to all rows, that fit moved a little, then the fits without each cluster in turn."""

    #: Coefficients, (1 + parameters + clusters, n).
    coefficients: np.ndarray
    #: Non-linear parameters by effect, joint and name, (1 + parameters + clusters,) each.
    thetas: Mapping[tuple[str, int, str], np.ndarray]
    #: How far each parameter was moved, (parameters,).
    steps: np.ndarray
    #: Clusters of each partition: trials, then places and the places of each trial, by turns.
    sizes: tuple[int, ...]
    #: Covariance that each partition would give under white noise, (parameters, parameters) each.
    white: tuple[np.ndarray, ...]

    def left_out(self, found: np.ndarray) -> list[np.ndarray]:
        """Return a quantity without each cluster, of every partition, from that of each fit."""
        return np.split(found[1 + len(self.steps) :], np.cumsum(self.sizes)[:-1])

    def interval(
        self, found: np.ndarray, value: float, lowest: float = -np.inf
    ) -> tuple[float, float]:
        """Return the 90 % interval of a quantity.

        Args:
            found: the quantity from each of the fits, (1 + parameters + clusters,).
            value: what is reported; with `found[0]` a part of the interval.
            lowest: physical bound; the interval ends there. Where the step for all rows ends
                there, too, no fit says how far it could go the other way: as far, then.
        """
        count = len(self.steps)
        slope = (found[1 : 1 + count] - found[0]) / self.steps
        slope = np.where(np.isfinite(slope), slope, 0.0)
        trials, *rest = (variance(found[0], part) for part in self.left_out(found))
        noise = [max(float(slope @ white @ slope), 1e-300) for white in self.white]
        beyond = [
            (everywhere - ratio * cells, clusters - 1.0)
            for everywhere, cells, ratio, clusters in zip(
                rest[::2],
                rest[1::2],
                [whole / part for whole, part in zip(noise[1::2], noise[2::2], strict=True)],
                self.sizes[1::2],
                strict=True,
            )
        ]
        half = half_width(trials, self.sizes[0] - 1.0, beyond)
        if found[0] <= lowest < value:
            half = max(half, value - found[0])
        low, high = min(value - half, found[0]), max(value + half, found[0])
        return max(low, min(lowest, value)), high


def half_width(noise: float, freedom: float, beyond: Sequence[tuple[float, float]] = ()) -> float:
    """Return half of a 90 % interval.

    Args:
        noise: variance over trials.
        freedom: its degrees of freedom.
        beyond: for each way to cut the range, the variance that places show beyond noise, which
            may come out negative, and its degrees of freedom.
    """
    extra, own = max(beyond, default=(0.0, 1.0))
    extra = max(extra, 0.0)
    total = noise + extra
    if extra > 0.0:
        freedom = total**2 / (noise**2 / freedom + extra**2 / own)
    return float(t.ppf((1 + CONFIDENCE) / 2, freedom)) * float(np.sqrt(total))


def variance(whole: float, found: np.ndarray) -> float:
    """Return the jackknife's variance of a quantity from what it is without each cluster.

    Args:
        whole: the quantity from all rows.
        found: the quantity without each cluster, (clusters,); those that are not finite are left.
    """
    moved = found[np.isfinite(found)] - whole
    return (len(found) - 1) / len(found) * float(moved @ moved)


def leave_out(
    model: Model, rows: Rows, coefficients: np.ndarray, *, form_free: bool = True
) -> Fits:
    """Fit the model to all rows, and without each cluster of every partition in turn.

    Where there are few trials, seconds take their place; a single second leaves only places.

    Args:
        model: fitted.
        rows: the samples that were fitted.
        coefficients: its fit.
        form_free: whether the non-linear parameters of terms take part; those of channels do.
    """
    base, lower = model.base(rows)
    target = model.target(rows)
    slopes, keys = _slopes(model, rows, coefficients, form_free=form_free)
    table = np.column_stack([base, *slopes, target])
    bounds = np.concatenate([lower, np.full(len(slopes), -np.inf)])
    gram = table.T @ table
    whole = solve(gram, bounds)
    inverse = _covariance(gram, np.flatnonzero(whole * (whole > bounds)))
    steps = np.maximum(np.sqrt(inverse.diagonal()), 1e-9 * (1.0 + np.abs(whole)))
    fits, sizes, white = [whole, *(whole + np.diag(steps))], [], []
    for clusters in partitions(rows):
        order = np.argsort(clusters, kind="stable")
        starts = np.flatnonzero(np.diff(clusters[order])) + 1
        # Sorted as a whole: a part that is taken by its rows has another last digit.
        grams = np.array([part.T @ part for part in np.split(table[order], starts)])
        fits += _solve_each(gram - grams, bounds)
        sizes.append(len(grams))
        white.append(_under_white_noise(gram, grams, inverse))
    every = np.array(fits)
    size = base.shape[1]
    return Fits(
        coefficients=every[:, :size],
        thetas={key: theta + every[:, size + i] for i, (key, theta) in enumerate(keys)},
        steps=steps,
        sizes=tuple(sizes),
        white=tuple(white),
    )


def _solve_each(grams: np.ndarray, bounds: np.ndarray) -> list[np.ndarray]:
    """Return the coefficients of each of many Gram matrices, (clusters, n + 1, n + 1)."""
    size = len(bounds)
    found = inverse_of(grams[:, :size, :size]) @ grams[:, :size, size:]
    return [
        fit if np.all(fit >= bounds) else solve(gram, bounds)
        for fit, gram in zip(found[:, :, 0], grams, strict=True)
    ]


def _covariance(gram: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Return the covariance of the fit to white noise of variance one; zero for what is held."""
    out = np.zeros((len(gram) - 1, len(gram) - 1))
    out[np.ix_(free, free)] = inverse_of(gram[np.ix_(free, free)])
    return out


def _under_white_noise(gram: np.ndarray, grams: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    """Return what a jackknife's covariance is on average under white noise of variance one.

    Without cluster g the fit moves by -A^-1 X_g' (1 - H_g)^-1 e_g, and its residual e_g has the
    covariance 1 - H_g. So the square is A^-1 X_g' (1 - H_g)^-1 X_g A^-1 on average, where what
    stands in the middle is G_g + G_g (A - G_g)^-1 G_g with the cluster's Gram matrix G_g.

    Args:
        gram: of all rows, (n + 1, n + 1).
        grams: of each cluster, (clusters, n + 1, n + 1).
        inverse: A^-1, zero for coefficients that are held at a bound, (n, n).
    """
    size = len(inverse)
    own = grams[:, :size, :size]
    total = (own + own @ inverse_of(gram[:size, :size] - own) @ own).sum(axis=0)
    return np.asarray((len(own) - 1) / len(own) * inverse @ total @ inverse)


def partitions(rows: Rows) -> list[np.ndarray]:
    """Return each row's trial, then its place and its place within its trial, for every cut.

    Of few trials, and of one that alone moves a joint or carries a load, seconds are left out:
    without that trial nothing would be known of what it shows.
    """
    trials = rows.block
    if len(np.unique(rows.trial)) >= MIN_TRIALS:
        trials = np.where(rows.halved, rows.trial.max() + 1 + rows.block, rows.trial)
    cuts = [places(rows, *cut) for cut in CUTS]
    if len(np.unique(trials)) == 1:
        trials = cuts[0]
    found = [trials]
    for cut in cuts:
        found += [cut, trials * (int(cut.max()) + 1) + cut]
    return found


def places(rows: Rows, signal: str, count: int, directed: bool) -> np.ndarray:
    """Return each row's joint, part of that joint's range and direction as one number, (r,)."""
    found = []
    for joint, samples in rows.samples.items():
        values = getattr(rows.recording, signal)[samples, joint]
        low, high = (values.min(), values.max()) if len(values) else (0.0, 0.0)
        part = ((values - low) / max(high - low, 1e-300) * count).astype(int)
        part = joint * count + np.minimum(part, count - 1)
        forward = rows.recording.velocity[samples, joint] > 0
        found.append(part * 2 + forward if directed else part)
    return np.concatenate(found)


def _slopes(
    model: Model, rows: Rows, coefficients: np.ndarray, *, form_free: bool
) -> tuple[list[np.ndarray], list[tuple[tuple[str, int, str], float]]]:
    """Return the prediction's slope over every non-linear parameter, stacked over rows."""
    slopes, keys = [], []
    for part, name, slope in slopes_of(model, coefficients):
        if not form_free and isinstance(part, Term):
            continue
        column = rows.stack({j: slope[:, [j]] for j in rows.samples}, 1)[:, 0]
        if float(column @ column) > 1e-12 * len(column):
            slopes.append(column)
            keys.append(((*part.at.key, name), part.theta[name]))
    return slopes, keys


def slopes_of(
    model: Model, coefficients: np.ndarray
) -> Iterator[tuple[Term | Channel, str, np.ndarray]]:
    """Yield every non-linear parameter of an effect with the prediction's slope over it.

    Of declared effects, too: nobody declared their values. Loads that trials name hang where their
    own columns say.

    Args:
        model: fitted.
        coefficients: of its columns.

    Yields:
        The part of the model, the parameter's name, and the slope, (n, joints); NaN where a joint
        has no effort. Choices, which have no slope, are left out, and what is as usual.
    """
    parts: list[Term | Channel] = [*model.terms, *model.channels]
    for part in parts:
        if isinstance(part, Term) and (part.effect is None or part.load is not None):
            continue
        for parameter in part.at.effect.nonlinear:
            name = parameter.name
            # A robot's spring has no part of its inertia to fit.
            if parameter.step is None or name not in part.theta:
                continue
            value = part.theta[name]
            if value == parameter.usual:
                continue
            step = parameter.step[0] + parameter.step[1] * abs(value)
            # A time that is shorter than the step does not become less than nothing.
            physical = part.at.effect.parameters.get(name)
            positive = physical is not None and physical.floor >= 0.0 and value > 0.0
            least = max(value - step, 0.5 * value) if positive else value - step
            up, down = (
                prediction(moved(model, coefficients, part, name, there), coefficients)
                for there in (value + step, least)
            )
            yield part, name, (up - down) / (value + step - least)


def moved(
    model: Model, coefficients: np.ndarray, part: Term | Channel, name: str, value: float
) -> Model:
    """Return a fitted model with one non-linear parameter of an effect moved."""
    theta = {**part.theta, name: value}
    if isinstance(part, Channel):
        moved = replace(part, theta=theta)
        return replace(model, channels=tuple(moved if c is part else c for c in model.channels))
    joint = unfitted(model.recording, part.joint)
    if part.at.effect.uses_estimate:
        joint = replace(joint, estimate=estimate_beside(model, coefficients, part))
    moved_term = replace(part, theta=theta, columns=part.at.effect.columns(joint, theta))
    return replace(model, terms=tuple(moved_term if t is part else t for t in model.terms))
