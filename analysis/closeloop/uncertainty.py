"""Intervals of everything that was fitted: a bootstrap that resamples whole trials.

With few trials blocks of one second are resampled instead. Non-linear parameters take part through
the slope of the prediction, as one more column each (a Gauss-Newton step of every resample), so
their intervals and what they add to the others' come out of the same draws.
"""

from dataclasses import replace

import numpy as np

from analysis.closeloop.model import Channel, Model, Term, no_estimate, prediction
from analysis.closeloop.regression import Rows, solve

DRAWS = 300
#: Trials from which on whole trials are resampled.
MIN_TRIALS = 8
#: Parameters of the grid that are choices, not numbers to have an interval.
CHOICES = {"side", "power", "load", "viscous", "smooth", "width", "offset"}


def bootstrap(
    model: Model, rows: Rows, coefficients: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, dict[tuple[str, int, str], np.ndarray]]:
    """Return draws of the coefficients, (draws, n), and of each non-linear parameter, (draws,).

    The parameters are keyed by effect, joint and name.
    """
    base, lower = model.base(rows)
    target = model.target(rows)
    slopes, keys = _slopes(model, rows, coefficients)
    table = np.column_stack([base, *slopes, target])
    clusters = rows.trial if len(np.unique(rows.trial)) >= MIN_TRIALS else rows.block
    names = np.unique(clusters)
    grams = np.stack([table[clusters == name].T @ table[clusters == name] for name in names])
    bounds = np.concatenate([lower, np.full(len(slopes), -np.inf)])
    draws = np.empty((DRAWS, table.shape[1] - 1))
    for number in range(DRAWS):
        weights = rng.multinomial(len(names), np.full(len(names), 1.0 / len(names)))
        draws[number] = solve(np.tensordot(weights, grams, axes=1), bounds)
    size = base.shape[1]
    thetas = {key: theta + draws[:, size + i] for i, (key, theta) in enumerate(keys)}
    return draws[:, :size], thetas


def interval(draws: np.ndarray, value: float) -> list[float]:
    """Return the 90 % interval of `draws`, widened if need be to hold the value."""
    low, high = np.quantile(draws, [0.05, 0.95])
    return [float(min(low, value)), float(max(high, value))]


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
