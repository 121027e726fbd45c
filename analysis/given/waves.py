"""Whether an output changes with a factor more often than first-order shares follow.

Rows whose values of a factor are next to each other have outputs that are alike as far as that
factor makes them, however often it does (Gamboa, Gremaud, Klein and Lagnoux 2022, Global
sensitivity analysis: a novel generation of mighty estimators based on rank statistics, Bernoulli
28). So do rows that share a code without order, of more values than have means of their own.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from analysis.given.hdmr import ROWS_EACH, pieces, splines
from analysis.given.left_over import by_themselves
from analysis.given.measures import FEW_VALUES, HARMONICS, class_means, standard
from analysis.sensitivity.judgement.screening import SHARE_OF_VARIANCE

Array = NDArray[np.float64]

#: How likely one factor or more is named of an output that harmonics follow.
_BY_CHANCE = 1e-3
#: Rows that are looked at, at most: what matters shows in them, and wide tables take their time.
_MOST_ROWS = 2000


def missed(output: str, y: Array, factors: Sequence[str], x: Array) -> list[str]:
    """Say of which factors both harmonics and splines miss a share that matters.

    By the correlation of neighbouring rows in what they leave, beyond chance (Bonferroni).

    Args:
        output, factors: names.
        y: shape (rows,).
        x: shape (rows, factors), drawn independently, in no order.
    """
    x, y = x[:_MOST_ROWS], y[:_MOST_ROWS]
    if np.ptp(y) == 0.0:
        return []
    y = standard(y)
    # What other factors do is noise beside what is looked for.
    function = by_themselves(x, y)
    rest = y - function.sum(axis=1)
    u = (np.arange(len(y)) + 0.5) / len(y)
    # Of rows in the order of a factor these are what `rbd_fast` fits, which goes there and back.
    waves = np.cos(np.pi * np.outer(u, np.arange(HARMONICS + 1)))
    cut = pieces(len(y), x.shape[1])
    least = float(norm.isf(_BY_CHANCE / x.shape[1])) / np.sqrt(len(y))
    said = []
    for name, column, own in zip(factors, x.T, function.T, strict=True):
        classes = np.unique(column, return_inverse=True)[1]
        if classes.max() < FEW_VALUES:
            continue
        order = np.argsort(column, kind="stable")
        alone = (rest + own)[order]
        # Each measure follows with its own functions: what the better one leaves.
        left = min(
            (_left(alone, functions) for functions in (waves, splines(column[order], cut))),
            key=lambda one: float(one @ one),
        )
        squares = float(left @ left)
        alike = float(left[1:] @ left[:-1]) / max(squares, float(np.finfo(float).tiny))
        share = alike * squares / float(np.sum((y - y.mean()) ** 2))
        if alike > least and share > SHARE_OF_VARIANCE:
            said.append(_sentence(output, y, name, classes, share))
    return said


def _left(y: Array, functions: Array) -> Array:
    """Return what functions, shape (rows, functions), leave of an output."""
    fitted = np.linalg.qr(functions)[0]
    return np.asarray(y - fitted @ (fitted.T @ y))


def _sentence(output: str, y: Array, name: str, classes: NDArray[np.intp], share: float) -> str:
    values = int(classes.max()) + 1
    codes = ""
    if values * ROWS_EACH <= len(y):
        codes = (
            f" If its {values} values are codes, whose order means nothing, their means explain "
            f"{class_means(classes, y):.2f}."
        )
    return (
        f"{output} has more waves or jumps with {name} than rbd_fast and hdmr follow: the share of "
        f"it that they tell is too small, by {share:.2f} or more.{codes}"
    )
