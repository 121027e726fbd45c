"""What a reader of a report sees at the pointer: values and row numbers, as JSON for the page.

A panel is {"box": [left, top, right, bottom], shares of the figure's width and height,
            "x": [left, right], "y": [bottom, top], values at its edges, "log": x is logarithmic}
with either "marks": [[x, y, text], ...] or "runs": [column of x, column of y], columns of the
section's table of runs (`runs_table`), which all panels of runs share: a run that is pointed at in
one shows in all. A figure's panels have their places once it has been drawn.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any

from analysis.designs import family
from analysis.reports.figures.pairs import leading_pairs
from analysis.reports.figures.scatter import DRAWN
from analysis.reports.figures.shares import BARS
from analysis.reports.figures.style import INDICES
from analysis.reports.figures.together import largest_pairs
from analysis.reports.wording import with_interval, words
from analysis.sensitivity.estimators import SYMBOLS
from analysis.sensitivity.judgement.ranking import RANKED_BY
from analysis.sensitivity.table import Table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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


def plane(figure: Figure, snapshot: Mapping[str, Any], output: str) -> list[Panel]:
    """Return the panel of the intervals of a mu*-sigma plane."""
    factors = snapshot["outputs"][output]["factors"]
    marks = [
        [entry["mu_star"]["value"], entry["sigma"]["value"], _told(snapshot, name, entry)]
        for name, entry in factors.items()
        if None not in (entry["mu_star"]["value"], entry["sigma"]["value"])
    ]
    return [{**_panel(figure, figure.axes[0]), "marks": marks}]


def shares(figure: Figure, snapshot: Mapping[str, Any], output: str) -> list[Panel]:
    """Return the panel of the bars of a variance-based study."""
    factors, kind = snapshot["outputs"][output]["factors"], family(snapshot["method"])
    order = sorted(factors, key=lambda name: factors[name][RANKED_BY[kind]]["value"] or 0.0)
    marks = [
        [factors[name][index]["value"], place + offset, _told(snapshot, name, factors[name])]
        for place, name in enumerate(order)
        for index, (_, offset) in BARS[kind].items()
        if factors[name][index]["value"] is not None
    ]
    return [{**_panel(figure, figure.axes[0]), "marks": marks}]


def together(figure: Figure, snapshot: Mapping[str, Any], output: str) -> list[Panel]:
    """Return the panel of the bars of pairs."""
    drawn = largest_pairs(snapshot, output)[::-1]
    marks = [
        [
            pair["value"],
            place,
            f"{' and '.join(map(words, pair['factors']))}: "
            f"{_interval(pair['value'], pair['low'], pair['high'])}, n {pair['n']:,}",
        ]
        for place, pair in enumerate(drawn)
        if pair["value"] is not None
    ]
    return [{**_panel(figure, figure.axes[0]), "marks": marks}]


def convergence(figure: Figure, snapshot: Mapping[str, Any], output: str) -> list[Panel]:
    """Return the two panels of a figure of convergence."""
    entry = snapshot["outputs"][output]
    series, complete = entry["convergence"], snapshot["rows_complete"]
    panels = []
    for axes, index in zip(figure.axes, INDICES[family(snapshot["method"])], strict=True):
        marks = []
        for name, curves in series["factors"].items():
            ends = [curves[index][end] for end in ("value", "low", "high")]
            points = list(zip(series["rows"], *ends, strict=True))
            if complete not in series["rows"]:
                last = entry["factors"][name][index]
                points.append((complete, last["value"], last["low"], last["high"]))
            start = f"{words(name)}, "
            marks += [
                [rows, value, f"{start}{rows:,} rows: {SYMBOLS[index]} {_interval(value, *ends)}"]
                for rows, value, *ends in points
                if value is not None
            ]
        panels.append({**_panel(figure, axes), "marks": marks})
    return panels


def scatter(figure: Figure, factors: Sequence[str], output: str) -> list[Panel]:
    """Return the panels of the output against each factor."""
    drawn = zip(figure.axes, factors, strict=False)
    return [{**_panel(figure, axes), "runs": [name, output]} for axes, name in drawn]


def pairs(figure: Figure, order: Sequence[str]) -> list[Panel]:
    """Return the panels of pairs of factors; the last axes of that figure are its colours."""
    drawn = zip(figure.axes, leading_pairs(order), strict=False)
    return [{**_panel(figure, axes), "runs": list(pair)} for axes, pair in drawn]


def _panel(figure: Figure, axes: Axes) -> Panel:
    box = axes.get_position()
    return {
        "box": [round(float(v), 5) for v in (box.x0, 1.0 - box.y1, box.x1, 1.0 - box.y0)],
        "x": [float(v) for v in axes.get_xlim()],
        "y": [float(v) for v in axes.get_ylim()],
        "log": axes.get_xscale() == "log",
    }


def _told(snapshot: Mapping[str, Any], name: str, entry: Mapping[str, Any]) -> str:
    indices = ", ".join(
        f"{SYMBOLS[index]} {_interval(**entry[index])}"
        for index in INDICES[family(snapshot["method"])]
        if entry[index]["value"] is not None
    )
    return f"{words(name)}: {indices}, n {entry['n']:,}"


def _interval(value: float, low: float | None, high: float | None) -> str:
    return " ".join(with_interval(value, low, high)).rstrip()


def _short(value: float) -> float | None:
    """Return a number in four digits: enough to find a place on a screen."""
    return float(f"{value:.4g}") if isfinite(value) else None
