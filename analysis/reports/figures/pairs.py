"""An output as colour over pairs of factors (paper, figure 13)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from analysis.reports.figures.scatter import DRAWN
from analysis.reports.figures.style import new_figure, say
from analysis.reports.wording import with_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Factors paired with each other: the most influential ones, as in the paper.
LEADING = 3


def leading_pairs(order: Sequence[str]) -> list[tuple[str, str]]:
    """Return the pairs of the leading factors, panel by panel; a lone factor with itself."""
    return list(combinations(order[:LEADING], 2)) or [(order[0], order[0])]


def pairs_figure(
    points: NDArray[np.float64],
    values: NDArray[np.float64],
    names: Sequence[str],
    order: Sequence[str],
    output: str,
    unit: str = "",
    units: Sequence[str] = (),
) -> Figure:
    """Draw one panel for each pair of the leading factors; a pattern hints at an interaction.

    Args:
        points, values, names, output, unit, units: as in `scatter_figure`.
        order: the factors, the most influential first.
    """
    pairs = [(list(names).index(a), list(names).index(b)) for a, b in leading_pairs(order)]
    figure = new_figure(4.1 * len(pairs) + 0.9, 3.7)
    panels = figure.subplots(1, len(pairs), squeeze=False)[0]
    # Colours span the middle of the values: one extreme run must not make all others alike.
    low, high = np.quantile(values, [0.02, 0.98]) if values.size else (0.0, 1.0)
    marks = None
    for axes, (a, b) in zip(panels, pairs, strict=True):
        marks = axes.scatter(
            points[:DRAWN, a],
            points[:DRAWN, b],
            c=values[:DRAWN],
            s=13,
            cmap="viridis",
            vmin=low,
            vmax=high,
            linewidths=0,
            rasterized=True,
        )
        for set_label, f in ((axes.set_xlabel, a), (axes.set_ylabel, b)):
            set_label(with_unit(names[f], units[f] if units else ""), fontsize=9)
        if not values.size:
            say(axes, "no values yet")
    assert marks is not None
    figure.colorbar(marks, ax=list(panels), label=with_unit(output, unit), extend="both")
    return figure
