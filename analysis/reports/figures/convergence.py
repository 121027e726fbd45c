"""Indices of growing parts of the sample (paper, figure 11)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.designs import family
from analysis.reports.figures import style
from analysis.reports.wording import with_unit, words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Highest share worth showing, unless an index itself is higher: intervals of the first rows are
#: wide, and would make all lines one.
_SHARE = 1.25


def convergence_figure(
    snapshot: style.Snapshot, output: str, unit: str = "", palette: Sequence[str] = ()
) -> Figure:
    """Draw the indices of the first 8, 16, ... rows and of all rows, with their intervals.

    Args:
        unit: of the output, for the axes of elementary effects.
        palette: factors in the order of their colours; default: the study's.
    """
    factors = style.factors_of(snapshot, output, family(snapshot["method"]))
    series = snapshot["outputs"][output]["convergence"]
    figure = style.new_figure(11.0, 4.2)
    panels = style.INDICES[family(snapshot["method"])]
    shares = family(snapshot["method"]) != "morris"
    own = style.looks(factors, palette)
    drawn = figure.subplots(1, len(panels), sharey=shares)
    for axes, (index, label) in zip(drawn, panels.items(), strict=True):
        curves = {
            words(name): (series["factors"][name][index], entry[index])
            for name, entry in factors.items()
        }
        draw_curves(axes, series["rows"], curves, snapshot["rows_complete"], own)
        axes.set_ylabel(label if shares else with_unit(label, unit))
        axes.tick_params(labelleft=True)
    if shares:
        _limit(drawn)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside right upper", frameon=False, fontsize=9)
    figure.suptitle(f"Convergence of the indices of {words(output)}", fontsize=11)
    style.caption(figure, snapshot, what="bands span")
    return figure


def _limit(drawn: Sequence[Axes]) -> None:
    """Cut bands off that reach beyond every index and every share."""
    curves = [line for axes in drawn for line in _curves(axes)]
    if curves:
        highest = max(_SHARE, *(1.1 * float(np.max(line.get_ydata())) for line in curves))
        low = max(min(axes.dataLim.y0 for axes in drawn), -0.5)
        high = min(max(axes.dataLim.y1 for axes in drawn), highest)
        margin = 0.04 * (high - low)
        drawn[0].set_ylim(low - margin, high + margin)


def _curves(axes: Axes) -> list[Any]:
    """Return the lines of indices, without the one at 0 and those without a point."""
    return [
        line for line in axes.lines if np.size(line.get_xdata()) and line.get_marker() != "None"
    ]


def draw_curves(
    axes: Axes,
    parts: Sequence[int],
    curves: Mapping[str, tuple[Mapping[str, Any], Mapping[str, Any]]],
    complete: int,
    own: Sequence[Mapping[str, Any]] = (),
) -> None:
    """Draw indices of growing parts of the sample as lines within bands.

    Args:
        parts: rows of every part.
        curves: by label, an index of every part and of all rows.
        complete: how many rows are complete.
        own: colour and marker of each (`looks`); default: those of the palette in turn.
    """
    rows = list(parts)
    last = [complete] if complete and complete not in rows else []
    for look, (label, (series, now)) in zip(
        own or style.looks(curves), curves.items(), strict=True
    ):
        curve = {
            end: [*series[end], *([now[end]] if last else [])] for end in ("value", "low", "high")
        }
        known = [
            place
            for place in range(len(rows) + len(last))
            if all(curve[end][place] is not None for end in curve)
        ]
        x = [(rows + last)[place] for place in known]
        value, low, high = ([curve[end][place] for place in known] for end in curve)
        axes.fill_between(x, low, high, color=look["color"], alpha=0.13, linewidth=0)
        axes.plot(x, value, **look, markersize=4, lw=1.4, label=label)
    if not rows:
        style.say(axes, "fewer than 8 rows yet")
        return
    axes.axhline(0.0, color=style.INK, lw=0.8)
    axes.set_xscale("log", base=2)
    crowded = len(rows) > 7
    axes.set_xticks(
        rows + last,
        [f"{row:,}" for row in rows + last],
        rotation=45 if crowded else 0,
        fontsize=8 if crowded else 9,
    )
    axes.minorticks_off()
    style.open_axes(axes, "rows of the design")
