"""Where an output jumps with a factor, so that neither splines nor harmonics follow it.

A jump that is beyond chance is found within a few rows of where it is, and so much sooner than
anything else is told of it that what is fitted beside it is as if its place had been known (Chan
1993, Consistency and limiting distribution of the least squares estimator of a threshold
autoregressive model, Annals of Statistics 21). Several are found one after the other (Bai 1997,
Estimating multiple breaks one at a time, Econometric Theory 13).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr

Array = NDArray[np.float64]

#: How likely a jump is found in one factor where there is none.
_BY_CHANCE = 1e-3
#: Jumps of a factor, at most, as many as harmonics of `rbd_fast`: what more of them would follow is
#: waves, or codes without order, and none is one.
_MOST = 10
#: Share of the variance from which a jump counts: all together then lack no second digit.
_LEAST = 1e-4
#: Of a step, what functions leave of it that is rounding.
_ROUNDING = 1e-9


def jumps(left: Array, basis: Array, column: Array, whole: float) -> tuple[list[int], Array]:
    """Return where an output jumps beyond what functions follow, and what the jumps leave.

    The split that explains most is a jump if its step differs from 0 whatever the noise of each row
    is: by Student's t with errors foretold without the row (MacKinnon and White 1985, HC3), at its
    part of the level among all splits (Bonferroni). Degrees of freedom are as many as rows that
    it rests on (Satterthwaite 1946).

    Args:
        left: what the functions leave of an output, in the order of the factor, shape (rows,).
        basis: functions, the mean among them, shape (rows, functions), orthonormal.
        column: the factor, in order, shape (rows,).
        whole: sum of squares of the output.

    Returns:
        How many rows are before each jump, and shape (rows,).
    """
    found: list[int] = []
    rest = left
    between = np.flatnonzero(column[1:] > column[:-1])
    before = np.arange(1.0, len(left))[between]
    # Of each split's step what functions do not follow, squared.
    size = before - np.sum(np.cumsum(basis, axis=0)[between] ** 2, axis=1)
    degrees = len(left) - basis.shape[1] - 1
    steps: list[Array] = []
    while len(found) < min(degrees, len(between)):
        gain = np.cumsum(rest)[between] ** 2 / np.maximum(size, _ROUNDING)
        gain[size <= _ROUNDING * len(left)] = 0.0
        best = int(np.argmax(gain))
        if gain[best] < _LEAST * whole:
            break
        step = (np.arange(len(left)) <= between[best]).astype(np.float64)
        step -= basis @ (basis.T @ step)
        for one in steps:
            step -= one * (one @ step)
        step /= np.sqrt(step @ step)
        height = float(step @ rest)
        without = rest - height * step
        if 2.0 * len(between) * _by_chance(step, height, without) > _BY_CHANCE:
            break
        if len(found) == _MOST:
            return [], left
        rest = without
        steps.append(step)
        size = size - np.cumsum(step)[between] ** 2
        found.append(int(between[best]) + 1)
    return found, rest


def _by_chance(step: Array, height: float, without: Array) -> float:
    """Return how likely a step is so high by chance, on one side (MacKinnon and White 1985).

    Args:
        step: normed, shape (rows,).
        height: what it explains.
        without: what is left then, shape (rows,).
    """
    error = np.sqrt(np.sum((step * without / np.maximum(1.0 - step**2, _ROUNDING)) ** 2))
    return float(stdtr(1.0 / np.sum(step**4), -abs(height) / max(error, np.finfo(float).tiny)))
