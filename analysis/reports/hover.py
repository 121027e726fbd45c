"""What a reader of a report sees at the pointer: values and row numbers, as JSON for the page.

A panel is {"box": [left, top, right, bottom], shares of the figure's width and height,
            "x": [left, right], "y": [bottom, top], values at its edges, "log": x is logarithmic}
with either "marks": [[x, y, text], ...] or "runs": [column of x, column of y], columns of the
section's table of runs (`runs_table`), which all panels of runs share: a run that is pointed at in
one shows in all. A figure's panels have their places once it has been drawn.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import TYPE_CHECKING, Any

from analysis.reports.figures.scatter import DRAWN
from analysis.reports.paper import offset, panels_of, text_of
from analysis.sensitivity.table import Table

if TYPE_CHECKING:
    from matplotlib import figure as drawings
    from matplotlib.axes import Axes

Panel = dict[str, Any]


def runs_table(table: Table, output: str) -> dict[str, Any]:
    """Return the runs that the panels show: {"columns": [name], "runs": [[number]]}.

    Columns are row, position, the factors and the output; numbers have four digits.
    """
    o = table.plan.outputs.index(output)
    lines = table.sampled(output)[:DRAWN]
    return {
        "columns": ["row", "position", *table.plan.factors, output],
        "runs": [
            [
                int(table.rows[i]),
                int(table.positions[i]),
                *(_short(x) for x in table.points[i]),
                _short(table.values[i, o]),
            ]
            for i in lines
        ],
    }


def panels(figure: Mapping[str, Any], drawn: drawings.Figure) -> list[Panel]:
    """Return what is told in each panel of a figure that is drawn."""
    found = []
    for name, axes in panels_of(figure, drawn).items():
        data = [trace for trace in figure["data"] if trace.get("xaxis", "x") == "x" + name]
        runs = [trace["meta"] for trace in data if "meta" in trace]
        marks = [mark for trace in data for mark in _marks(trace, data, figure["layout"])]
        found.append(_panel(axes) | ({"runs": list(runs[0])} if runs else {"marks": marks}))
    return found


def _marks(
    trace: Mapping[str, Any], data: list[Mapping[str, Any]], layout: Mapping[str, Any]
) -> list[list[Any]]:
    above = offset(trace, data, layout) if trace.get("orientation") == "h" else 0.0
    return [
        [x, y + above, text_of(text)]
        for x, y, text in zip(trace["x"], trace["y"], trace.get("hovertext", ()), strict=False)
        if x is not None and y is not None
    ]


def _panel(axes: Axes) -> Panel:
    box = axes.get_position()
    return {
        "box": [round(float(v), 5) for v in (box.x0, 1.0 - box.y1, box.x1, 1.0 - box.y0)],
        "x": [float(v) for v in axes.get_xlim()],
        "y": [float(v) for v in axes.get_ylim()],
        "log": axes.get_xscale() == "log",
    }


def _short(value: float) -> float | None:
    """Return a number in four digits: enough to find a place on a screen."""
    return float(f"{value:.4g}") if isfinite(value) else None
