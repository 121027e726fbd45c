"""Whether an output changes with a factor more often than first-order shares follow.

Rows whose values of a factor are next to each other have outputs that are alike as far as that
factor makes them, however often it does (Gamboa, Gremaud, Klein and Lagnoux 2022, Global
sensitivity analysis: a novel generation of mighty estimators based on rank statistics, Bernoulli
28). So do rows that share a code without order, of more values than have means of their own.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from analysis.given.doubts.left_over import alike, by_themselves
from analysis.given.measures.hdmr import ROWS_EACH, pieces, splines
from analysis.given.measures.jumps import jumps
from analysis.given.measures.measure import standard
from analysis.given.measures.rbd_fast import FEW_VALUES, class_means, harmonics
from analysis.sensitivity.judgement.screening import SHARE_OF_VARIANCE

Array = NDArray[np.float64]

#: Those that follow an output with functions of a factor.
_MEASURES = ("rbd_fast", "hdmr")
#: How likely one factor or more is named of an output that both follow.
_BY_CHANCE = 1e-3
#: Rows that are looked at, at most: what matters shows in them, and wide tables take their time.
_MOST_ROWS = 2000


def missed(output: str, y: Array, factors: Sequence[str], x: Array) -> dict[str, str]:
    """Return the remark on each factor of which measures miss a share that matters.

    Harmonics, splines or both do, by the correlation of neighbouring rows in what they leave,
    beyond chance (Bonferroni).

    Args:
        output, factors: names.
        y: shape (rows,).
        x: shape (rows, factors), drawn independently, in no order.
    """
    x, y = x[:_MOST_ROWS], y[:_MOST_ROWS]
    if np.ptp(y) == 0.0:
        return {}
    y = standard(y)
    # What other factors do is noise beside what is looked for.
    function = by_themselves(x, y)
    rest = y - function.sum(axis=1)
    cut = pieces(len(y), x.shape[1])
    least = float(norm.isf(_BY_CHANCE / len(_MEASURES) / x.shape[1]))
    row = np.arange(len(y))
    said = {}
    for name, column, own in zip(factors, x.T, function.T, strict=True):
        classes = np.unique(column, return_inverse=True)[1]
        if classes.max() < FEW_VALUES:
            continue
        order = np.argsort(column, kind="stable")
        alone = (rest + own)[order]
        # Each measure follows with its own functions, and looks for jumps in what it sees.
        fitted = (harmonics(len(y)), np.linalg.qr(splines(column[order], cut))[0])
        sees = (y[order], alone)
        misses = {}
        for measure, functions, seen in zip(_MEASURES, fitted, sees, strict=True):
            jumping = jumps(_left(seen, functions), functions, column[order], float(y @ y))[0]
            steps = row[:, None] >= np.array(jumping, dtype=np.intp)
            left = _left(alone, np.linalg.qr(np.concatenate([functions, steps], axis=1))[0])
            near = alike(left, row[1:], row[:-1])
            if near.errors > least and near.product > SHARE_OF_VARIANCE:
                misses[measure] = near.product
        if misses:
            said[name] = _sentence(output, y, name, classes, misses)
    return said


def _left(y: Array, functions: Array) -> Array:
    """Return what orthonormal functions, shape (rows, functions), leave of an output."""
    return np.asarray(y - functions @ (functions.T @ y))


def _sentence(
    output: str, y: Array, name: str, classes: NDArray[np.intp], misses: Mapping[str, float]
) -> str:
    values = int(classes.max()) + 1
    codes = ""
    if values * ROWS_EACH <= len(y):
        codes = (
            f" If its {values} values are codes, whose order means nothing, their means explain "
            f"{class_means(classes, y):.2f}."
        )
    follow, tell = ("follows", "it tells") if len(misses) == 1 else ("follow", "they tell")
    return (
        f"{output} has more waves or jumps with {name} than {' and '.join(misses)} {follow}: the "
        f"share of it that {tell} is too small, by {min(misses.values()):.2f} or more.{codes}"
    )
