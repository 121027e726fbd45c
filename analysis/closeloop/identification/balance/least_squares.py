"""Least squares with bounds from Gram matrices, which add up over any partition of the rows."""

from collections.abc import Callable, Iterable

import numpy as np
from scipy.linalg.lapack import dtrtrs

from sim.effects.effect import Effect

#: Directions of columns that are so much weaker than the strongest are not told.
TOLD = 1e-6


def gram_matrices(table: np.ndarray, parts: Iterable[np.ndarray]) -> np.ndarray:
    """Return the Gram matrix of each part of a table's rows, (parts, n, n)."""
    return np.stack([table[part].T @ table[part] for part in parts])


def sums_of_others(grams: np.ndarray) -> np.ndarray:
    """Return for each Gram matrix, (parts, n, n), the sum of the others.

    Added up in their order: what the total less one leaves of a column that only that one has is
    no zero.
    """
    own = np.arange(len(grams))
    return np.stack([grams[own != number].sum(axis=0) for number in own])


def keep_independent(
    base: np.ndarray, columns: np.ndarray, least: float = Effect.least_own
) -> tuple[np.ndarray, tuple[int, ...]]:
    """Drop the columns of which the base and the columns before them leave less than a share."""
    both = np.concatenate([base, columns], axis=1)
    gram = both.T @ both
    norms = np.sqrt(np.diagonal(gram))
    scale = np.maximum(norms, 1e-300)
    gram = gram / scale / scale[:, None]
    factor = np.zeros_like(gram)
    known: list[int] = []
    kept: list[int] = []
    for number in range(both.shape[1]):
        if norms[number] <= 1e-9 * np.sqrt(len(both)):
            continue
        size = len(known)
        row = np.empty(0)
        if size:
            row, _ = dtrtrs(factor[:size, :size], gram[known, number], lower=1)
        left = 1.0 - float(row @ row)
        if left < (1e-10 if number < base.shape[1] else least):
            continue
        factor[size, :size], factor[size, size] = row, np.sqrt(left)
        known.append(number)
        if number >= base.shape[1]:
            kept.append(number - base.shape[1])
    return columns[:, kept], tuple(kept)


def inverse_of(matrix: np.ndarray) -> np.ndarray:
    """Return the inverse of Gram matrices, (..., n, n), whose columns differ in size.

    A column that is zero in all rows has zeros there: nothing tells its coefficient.
    """
    scale = _sizes(np.diagonal(matrix, axis1=-2, axis2=-1))
    both = scale[..., :, None] * scale[..., None, :]
    return np.asarray(np.linalg.inv(matrix / both + 1e-10 * np.eye(matrix.shape[-1])) / both)


def _sizes(power: np.ndarray) -> np.ndarray:
    """Return what columns of these sums of squares are divided by; infinite where there is none."""
    return np.where(power > 0.0, np.sqrt(np.maximum(power, 1e-300)), np.inf)


def solve(gram: np.ndarray, lower: np.ndarray) -> np.ndarray:
    """Return the least-squares coefficients of a Gram matrix whose last row is the target.

    A coefficient that would leave its bound is held there (an active set that only grows).
    """
    return np.asarray(solve_each(gram[None], lower)[0])


def solve_each(grams: np.ndarray, lower: np.ndarray) -> np.ndarray:
    """As `solve`, of many Gram matrices, (parts, n + 1, n + 1); returns (parts, n).

    Most leave no bound, and those are solved together: one by one, most of the time goes into
    calling NumPy, not into arithmetic.
    """
    size = grams.shape[1] - 1
    scale = _sizes(np.diagonal(grams, axis1=1, axis2=2)[:, :size])
    every = grams[:, :size, :size] / (scale[:, :, None] * scale[:, None, :])
    every[:, range(size), range(size)] += 1e-10
    moments = grams[:, :size, size] / scale
    found = np.linalg.solve(every, moments[:, :, None])[:, :, 0] / scale
    free = np.ones(found.shape, dtype=bool)
    while (broken := free & (found < lower)).any():
        left = np.flatnonzero(broken.any(axis=1))
        beyond_by = np.where(broken, (found - lower) * np.where(broken, scale, 1.0), np.inf)
        free[left, beyond_by[left].argmin(axis=1)] = False
        found[left] = _held(every[left], moments[left], scale[left], lower, free[left])
    return np.asarray(found)


def _held(
    every: np.ndarray, moments: np.ndarray, scale: np.ndarray, lower: np.ndarray, free: np.ndarray
) -> np.ndarray:
    """Return the coefficients of fits some of which are held at their bounds, (k, n).

    Args:
        every: the scaled Gram matrices, (k, n, n).
        moments: of the scaled columns with the target, (k, n).
        scale: what the columns were divided by, (k, n).
        lower: the bounds, (n,).
        free: which coefficients are not held, (k, n).
    """
    fixed = np.where(free, 0.0, lower) * np.where(free, 1.0, scale)
    # Those that are held have rows and columns of the identity.
    both = np.where(free[:, :, None] & free[:, None, :], every, np.eye(len(lower)))
    given = np.where(free, moments - (every * fixed[:, None, :]).sum(axis=2), 0.0)
    solved = np.linalg.solve(both, given[:, :, None])[:, :, 0] / scale
    return np.where(free, solved, lower)


def misfit(gram: np.ndarray, coefficients: np.ndarray) -> float:
    """Return the sum of squares that `coefficients` leave of a Gram matrix's target."""
    size = len(coefficients)
    return float(
        gram[size, size]
        - 2 * coefficients @ gram[:size, size]
        + coefficients @ gram[:size, :size] @ coefficients
    )


def fits_without_each(grams: np.ndarray, lower: np.ndarray) -> list[tuple[np.ndarray, float]]:
    """Return the fits without each of the parts, (parts, n, n), and last that to all of them.

    Each has its coefficients and the sum of squares that it leaves.
    """
    total = grams.sum(axis=0)
    wanted = np.concatenate([total - grams, total[None]])
    fits = solve_each(wanted, lower)
    return [(fit, misfit(gram, fit)) for gram, fit in zip(wanted, fits, strict=True)]


def beyond(base: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Return what tells what columns, (r, k), leave of a signal, (r,)."""
    scale = np.linalg.norm(base, axis=0).clip(1e-300)
    directions, size, _ = np.linalg.svd(base / scale, full_matrices=False)
    told = directions[:, size > TOLD * size.max(initial=0.0)]
    return lambda signal: np.asarray(signal - told @ (told.T @ signal))
