"""Whether outputs of a Morris design stand one line off the points that they are of.

Shifted by a line, the first or the last step of every trajectory is one between two that have
nothing in common, whatever factor it seems to move (Morris 1991, Factorial sampling plans for
preliminary computational experiments, moves factors in random order).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, rankdata

from analysis.designs.radial import legs
from analysis.given.rows.layout import Layout

Array = NDArray[np.float64]

#: How likely it is said of an output that stands beside its points.
_BY_CHANCE = 1e-3


def one_line_off(output: str, design: Layout | None, x: Array, y: Array) -> list[str]:
    """Say so if first or last steps of trajectories move an output more than others do.

    More than other steps of the same factor, by ranks, with thrown signs (Hoeffding 1963). Where
    every trajectory moves factors in one order, and of radial rows, nothing can be told.

    Args:
        output: its name.
        design: of the table, if it is one.
        x: shape (rows, factors).
        y: shape (rows,), nan where there is none.
    """
    if design is None or design.method != "morris":
        return []
    (before, after), _ = legs(x[design.places])
    row = np.arange(len(before))[:, None]
    outputs = y[design.places]
    change = np.abs(outputs[row, after] - outputs[row, before])
    place = np.maximum(before, after)
    first, last = place == 1, place == x.shape[1]
    rank = np.zeros_like(change)
    for f, column in enumerate(change.T):
        there = ~np.isnan(column)
        rank[there, f] = rankdata(column[there]) - (there.sum() + 1.0) / 2.0
    for said, chosen in (("below", first), ("above", last)):
        seen = rank[chosen]
        size = float(np.sqrt(np.sum(seen**2)))
        if size > 0.0 and seen.sum() / size > norm.isf(_BY_CHANCE / 2.0):
            which = "first" if said == "below" else "last"
            return [
                f"Do not trust what the design tells of {output}: the {which} step of its rows "
                "moves it more than the same factors' other steps do, as where outputs stand one "
                f"line {said} the points that they are of."
            ]
    return []
