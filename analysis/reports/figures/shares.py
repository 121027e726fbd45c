"""First- and total-order indices of a variance-based study (paper, figure 10)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from analysis.designs import family
from analysis.reports.figures import style
from analysis.reports.figures.plane import draw_threshold
from analysis.reports.wording import words
from analysis.sensitivity.judgement.ranking import RANKED_BY

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: By family of methods: colour of the bars of an index, and how far above its factor they are.
BARS = {
    "saltelli": {"first_order": ("#0072B2", 0.2), "total_order": ("#9CC9E8", -0.2)},
    "shapley": {
        "full_first_order": ("#9CC9E8", 0.26),
        "shapley": ("#0072B2", 0.0),
        "independent_total_order": ("#E69F00", -0.26),
    },
}


def variance_figure(snapshot: style.Snapshot, output: str, unit: str = "") -> Figure:
    """Draw first- and total-order indices of a variance-based study with their intervals.

    Arguments and errors as `screening_figure`, for a study of shares; the unit is that of
    the output's mean and standard deviation in the title.
    """
    kind = "shapley" if family(snapshot["method"]) == "shapley" else "saltelli"
    factors = style.factors_of(snapshot, output, kind)
    figure = style.new_figure(6.4, 1.6 + 0.55 * len(factors))
    axes = figure.subplots()
    draw_shares(axes, factors, kind)
    draw_threshold(axes, snapshot["outputs"][output])
    spread = style.spread_in_words(snapshot["outputs"][output], unit)
    axes.set_title(f"Shares of the variance of {words(output)}\n{spread}", fontsize=11)
    style.caption(figure, snapshot)
    return figure


def draw_shares(axes: Axes, factors: Mapping[str, Any], kind: str = "saltelli") -> None:
    """Draw the shares of every factor, those of a family of methods, as bars with intervals."""
    order = sorted(factors, key=lambda name: factors[name][RANKED_BY[kind]]["value"] or 0.0)
    drawn = False
    for index, (colour, offset) in BARS[kind].items():
        bars = [(place + offset, factors[name][index]) for place, name in enumerate(order)]
        label = style.INDICES[kind][index]
        drawn |= style.draw_bars(
            axes, bars, height=0.72 / len(BARS[kind]), color=colour, label=label
        )
    axes.axvline(0.0, color=style.INK, lw=0.8, zorder=3)
    axes.set_yticks(range(len(order)), [words(name) for name in order])
    style.open_axes(axes, "share of the variance")
    if drawn:
        axes.set_xlim(min(axes.get_xlim()[0], 0.0), max(axes.get_xlim()[1], 1.0))
        axes.legend(frameon=False, fontsize=9, loc="lower right")
    else:
        style.say(axes, "no variance yet")
