"""Indices of growing parts of the sample (paper, figure 11)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from analysis.figures.style import (
    COLOURS,
    MARKERS,
    Snapshot,
    caption,
    factors_of,
    new_figure,
    say,
    words,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: By method, the indices drawn side by side and what their axes say.
_PANELS = {
    "morris": {"mu_star": "mean magnitude μ*", "sigma": "standard deviation σ"},
    "saltelli": {"first_order": "first order S", "total_order": "total order ST"},
}


def convergence_figure(snapshot: Snapshot, output: str, unit: str = "") -> Figure:
    """Draw the indices of the first 8, 16, ... rows and of all rows, with their intervals.

    Args:
        snapshot: of a study of either method.
        output: which of its outputs.
        unit: of the output, for the axes of elementary effects.

    Raises:
        ValueError: the snapshot has no such output.
    """
    factors = factors_of(snapshot, output, snapshot["method"])
    series = snapshot["outputs"][output]["convergence"]
    figure = new_figure(11.0, 4.2)
    panels = _PANELS[snapshot["method"]]
    for axes, (index, label) in zip(figure.subplots(1, len(panels)), panels.items(), strict=True):
        _draw(axes, series, factors, index, snapshot["rows_complete"])
        suffix = f" ({unit})" if unit and snapshot["method"] == "morris" else ""
        axes.set_ylabel(label + suffix)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside right upper", frameon=False, fontsize=9)
    figure.suptitle(f"Convergence of the indices of {words(output)}", fontsize=11)
    caption(figure, snapshot)
    return figure


def _draw(
    axes: Axes, series: Mapping[str, Any], factors: Mapping[str, Any], index: str, complete: int
) -> None:
    rows = list(series["rows"])
    last = [complete] if complete and complete not in rows else []
    for style, (name, entry) in enumerate(factors.items()):
        curve = {
            end: [*series["factors"][name][index][end], *([entry[index][end]] if last else [])]
            for end in ("value", "low", "high")
        }
        known = [
            place
            for place in range(len(rows) + len(last))
            if all(curve[end][place] is not None for end in curve)
        ]
        x = [(rows + last)[place] for place in known]
        value, low, high = ([curve[end][place] for place in known] for end in curve)
        colour = COLOURS[style % len(COLOURS)]
        axes.fill_between(x, low, high, color=colour, alpha=0.13, linewidth=0)
        axes.plot(
            x,
            value,
            color=colour,
            marker=MARKERS[style % len(MARKERS)],
            markersize=4,
            lw=1.4,
            label=words(name),
        )
    if not rows:
        say(axes, "fewer than 8 rows yet")
        return
    axes.axhline(0.0, color="#222222", lw=0.8)
    axes.set_xscale("log", base=2)
    axes.set_xticks(rows + last, [f"{row:,}" for row in rows + last], rotation=45, fontsize=8)
    axes.minorticks_off()
    axes.set_xlabel("rows of the design")
    axes.spines[["top", "right"]].set_visible(False)
