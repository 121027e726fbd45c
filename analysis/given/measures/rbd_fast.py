"""First-order indices of a given sample by random balance designs (Tarantola et al. 2006).

SALib gives the same numbers (`tests/unit/analysis/given` compares them) of outputs without jumps.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from analysis.given.measures.jumps import jumps

Array = NDArray[np.float64]

#: Harmonics of RBD-FAST: SALib's own.
HARMONICS = 10
#: A factor of no more values has as many means as harmonics have coefficients, or fewer.
FEW_VALUES = 2 * HARMONICS + 1


def rbd_fast(x: Array, y: Array) -> Array:
    """Return first-order indices by random balance designs, with the bias taken off.

    Tarantola, Gatelli and Mara 2006; for any sample Plischke 2010; bias Tissot and Prieur 2012.
    Harmonics do not follow steps: of factors of few values `class_means`, and where the output
    jumps beyond chance, what the jumps add to the harmonics.
    """
    return rbd_fast_at(x, steps=True)(y)


def rbd_fast_at(x: Array, *, steps: bool = False) -> Callable[[Array], Array]:
    """Return `rbd_fast` of any output of these factors (Tarantola et al. 2006).

    Args:
        x: shape (rows, factors).
        steps: look for jumps, which an output that is permuted has not.
    """
    from SALib.analyze.rbd_fast import permute_outputs, unskew_S1
    from scipy.signal import periodogram

    classes = [np.unique(column, return_inverse=True)[1] for column in x.T]
    few = np.array([one.max() < FEW_VALUES for one in classes])
    stepped = [one for one, is_few in zip(classes, few, strict=True) if is_few]
    order = [permute_outputs(column, np.arange(len(x))) for column in x.T[~few]]

    def of_output(y: Array) -> Array:
        found = np.empty(len(few))
        found[few] = [class_means(one, y) for one in stepped]
        if order:
            # All factors at once: SALib's periodogram of each alone takes its time to begin.
            _, power = periodogram(y[np.stack(order)])
            raw = power[:, 1 : HARMONICS + 1].sum(axis=1) / power[:, 1:].sum(axis=1)
            found[~few] = unskew_S1(raw, HARMONICS, len(y))
            if steps:
                columns = x.T[~few]
                found[~few] = [
                    _with_steps(*one, y) for one in zip(found[~few], columns, strict=True)
                ]
        return found

    return of_output


def _with_steps(share: float, column: Array, y: Array) -> float:
    """Return a share by harmonics with what jumps add to it (`analysis.given.measures.jumps`)."""
    order = np.argsort(column)
    basis = harmonics(len(y))
    centred = (y - y.mean())[order]
    whole = float(centred @ centred)
    found, left = jumps(centred - basis @ (basis.T @ centred), basis, column[order], whole)
    if not found:
        return share
    # Each coefficient takes its part of what is left (Tissot and Prieur 2012).
    free = len(y) - 2 * HARMONICS - len(found)
    return 1.0 - float(left @ left) / whole * len(y) / free


@cache
def harmonics(rows: int) -> Array:
    """Return what `rbd_fast` fits to rows in the order of a factor, which goes there and back.

    (Tarantola et al. 2006; Plischke 2010.) Shape (rows, functions), orthonormal, the mean first.
    """
    row = np.arange(rows)
    place = np.where(row % 2 == 0, row // 2, rows - 1 - row // 2)
    angle = 2.0 * np.pi / rows * np.outer(place, np.arange(1, HARMONICS + 1))
    found = [np.ones((rows, 1)), 2.0**0.5 * np.cos(angle), 2.0**0.5 * np.sin(angle)]
    return np.asarray(np.concatenate(found, axis=1) * rows**-0.5)


def class_means(classes: NDArray[np.intp], y: Array) -> float:
    """Return the correlation ratio of an output, less what chance adds to it (Kelley 1935).

    The share of the variance that lies between the means of the classes, less what each mean errs
    by its own class's variance, as far as that has one, so that noise may differ (Welch 1938).

    Args:
        classes: the number of each row's class, from 0 on, shape (rows,).
        y: shape (rows,).
    """
    rows = np.bincount(classes)
    about = y - y.mean()
    mean = np.bincount(classes, about) / rows
    squares = np.bincount(classes, (about - mean[classes]) ** 2)
    pooled = squares.sum() / max(len(y) - len(rows), 1)
    within = np.where(rows > 1, squares / np.maximum(rows - 1, 1), pooled)
    between = rows @ mean**2 - within @ (1.0 - rows / len(y))
    return float(between / (about @ about))
