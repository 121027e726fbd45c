"""Piecewise-linear functions of a signal: a basis of hat functions."""

import numpy as np

KNOTS = 8
#: Least distance of knots, over the signal's range. Nearer ones are one value twice but for its
#: rounding, as of a joint that is held; what a saturated signal says in its last digits is farther.
APART = 1e-12


def hat_basis(signal: np.ndarray, knots: int = KNOTS) -> np.ndarray:
    """Return piecewise-linear bases with knots at the signal's quantiles, (n, <= knots)."""
    good = signal[np.isfinite(signal)]
    if len(good) == 0:
        return np.empty((len(signal), 0))
    at = np.unique(np.quantile(good, np.linspace(0.0, 1.0, knots)))
    at = at[np.diff(at, prepend=-np.inf) > APART * np.ptp(at)]
    if len(at) < 2:
        return np.empty((len(signal), 0))
    filled = np.nan_to_num(signal, nan=float(good.mean()))
    return np.column_stack([np.interp(filled, at, row) for row in np.eye(len(at))[1:]])
