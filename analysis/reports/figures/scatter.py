"""An output against each factor, with means of bins (paper, figure 12)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from analysis.reports.figures.style import new_figure, open_axes
from analysis.reports.wording import with_unit

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Equal intervals of a factor's values, as in the paper.
BINS = 10

#: Points drawn, the first ones; the means are of all.
DRAWN = 3000


def scatter_figure(
    points: NDArray[np.float64],
    values: NDArray[np.float64],
    names: Sequence[str],
    output: str,
    unit: str = "",
    units: Sequence[str] = (),
) -> Figure:
    """Draw one panel per factor: every run, and the mean of each of ten bins.

    Args:
        points: factor values, shape (n, factors).
        values: of the output, shape (n,).
        units: of the factors; none if empty.
    """
    across = min(3, len(names))
    down = -(-len(names) // across)
    figure = new_figure(3.7 * across, 2.9 * down + 0.3)
    panels = figure.subplots(down, across, sharey=True, squeeze=False).ravel()
    for f, (axes, name) in enumerate(zip(panels, names, strict=False)):
        axes.plot(
            points[:DRAWN, f],
            values[:DRAWN],
            ls="",
            marker="o",
            ms=2.2 if len(values) > 400 else 3.5,
            mew=0,
            color="#333333",
            alpha=0.4,
            rasterized=True,
        )
        centres, means = bin_means(points[:, f], values)
        axes.plot(centres, means, "o", ms=6.5, color="#D55E00", mec="white", mew=0.7)
        open_axes(axes, with_unit(name, units[f] if units else ""), fontsize=9)
        # Few enough that the last of one panel keeps clear of the first of the next.
        axes.locator_params(axis="x", nbins=5)
    for axes in panels[len(names) :]:
        axes.set_axis_off()
    figure.supylabel(with_unit(output, unit), fontsize=10)
    return figure


def bin_means(
    x: NDArray[np.float64], y: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the centres of the bins that hold a value, and the mean of y in each."""
    if x.size == 0:
        return x, y
    edges = np.linspace(x.min(), x.max(), BINS + 1)
    place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, BINS - 1)
    count = np.bincount(place, minlength=BINS)
    total = np.bincount(place, weights=y, minlength=BINS)
    held = count > 0
    centres = 0.5 * (edges[:-1] + edges[1:])
    return centres[held], total[held] / count[held]
