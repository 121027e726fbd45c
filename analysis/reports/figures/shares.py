"""First- and total-order indices of a variance-based study (paper, figure 10)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from analysis.reports.figures.plane import draw_threshold
from analysis.reports.figures.style import (
    INK,
    Snapshot,
    caption,
    factors_of,
    new_figure,
    reach,
    say,
    spread_in_words,
    words,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_FIRST, _TOTAL = "#0072B2", "#9CC9E8"


def variance_figure(snapshot: Snapshot, output: str, unit: str = "") -> Figure:
    """Draw first- and total-order indices of a variance-based study with their intervals.

    Arguments and errors as `screening_figure`, for a study of method saltelli; the unit is that of
    the output's mean and standard deviation in the title.
    """
    factors = factors_of(snapshot, output, "saltelli")
    figure = new_figure(6.4, 1.6 + 0.55 * len(factors))
    axes = figure.subplots()
    draw_shares(axes, factors)
    draw_threshold(axes, snapshot["outputs"][output])
    spread = spread_in_words(snapshot["outputs"][output], unit)
    axes.set_title(f"Shares of the variance of {words(output)}\n{spread}", fontsize=11)
    caption(figure, snapshot)
    return figure


def draw_shares(axes: Axes, factors: Mapping[str, Any]) -> None:
    """Draw S and ST of every factor as bars with their intervals."""
    order = sorted(factors, key=lambda name: factors[name]["total_order"]["value"] or 0.0)
    kinds = (
        ("first_order", "first order S", _FIRST, 0.2),
        ("total_order", "total order ST", _TOTAL, -0.2),
    )
    drawn = False
    for index, label, colour, offset in kinds:
        known = [
            (place, factors[name][index])
            for place, name in enumerate(order)
            if factors[name][index]["value"] is not None
        ]
        if not known:
            continue
        drawn = True
        places = [place + offset for place, _ in known]
        values = [share["value"] for _, share in known]
        axes.barh(places, values, height=0.36, color=colour, label=label, zorder=2)
        for place, (_, share) in zip(places, known, strict=True):
            axes.errorbar(share["value"], place, xerr=reach(share), color=INK, capsize=3, lw=1.2)
    axes.axvline(0.0, color=INK, lw=0.8, zorder=3)
    axes.set_yticks(range(len(order)), [words(name) for name in order])
    axes.set_xlabel("share of the variance")
    axes.spines[["top", "right"]].set_visible(False)
    if drawn:
        axes.set_xlim(min(axes.get_xlim()[0], 0.0), max(axes.get_xlim()[1], 1.0))
        axes.legend(frameon=False, fontsize=9, loc="lower right")
    else:
        say(axes, "no variance yet")
