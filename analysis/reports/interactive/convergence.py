"""Indices of growing parts of the sample (paper, figure 11)."""

from collections.abc import Mapping
from typing import Any

from analysis.designs import family
from analysis.reports.figures.style import INDICES
from analysis.reports.interactive.shared import (
    MOST_LINES,
    Figure,
    colour,
    faded,
    layout,
    plain,
    ranked,
    rows_axis,
    told,
)
from analysis.reports.wording import with_unit, words
from analysis.sensitivity.estimators import SYMBOLS
from analysis.sensitivity.judgement.ranking import RANKED_BY

_ENDS = ("value", "low", "high")


def convergence(snapshot: Mapping[str, Any], output: str, unit: str = "") -> Figure | None:
    """Draw the ranking index of the first 8, 16, ... rows and of all; None before there are 8.

    Of the most influential factors only, as many as there are colours.
    """
    entry, kind = snapshot["outputs"][output], family(snapshot["method"])
    index = RANKED_BY[kind]
    # A snapshot that an earlier version left may not say it.
    if not entry.get("convergence", {}).get("rows"):
        return None
    data: list[dict[str, Any]] = []
    table = []
    for name in ranked(snapshot, output)[:MOST_LINES]:
        points = series(snapshot, output, name, index)
        if not points:
            continue
        own = colour(snapshot, output, name)
        rows = [row for row, _ in points]
        group = {"legendgroup": name, "x": rows, "type": "scatter", "hoverinfo": "skip"}
        edge = {**group, "mode": "lines", "line": {"width": 0}, "showlegend": False}
        data += [
            {**edge, "y": [point["low"] for _, point in points]},
            {
                **edge,
                "y": [point["high"] for _, point in points],
                "fill": "tonexty",
                "fillcolor": faded(own, 0.14),
            },
            {
                **group,
                "mode": "lines+markers",
                "name": words(name),
                "y": [point["value"] for _, point in points],
                "customdata": [name] * len(points),
                "line": {"color": own, "width": 1.8},
                "marker": {"color": own, "size": 6},
                "hoverinfo": "all",
                "hovertext": [told(SYMBOLS[index], point) for _, point in points],
                "hovertemplate": f"{words(name)}, %{{x:,}} rows<br>%{{hovertext}}<extra></extra>",
            },
        ]
        table += [[name, row, *(point[end] for end in _ENDS)] for row, point in points]
    label = INDICES[kind].get(index, index)
    return {
        "data": data,
        "layout": layout(
            380,
            xaxis=rows_axis(entry["convergence"]["rows"][0], snapshot["rows_complete"]),
            yaxis={
                "title": {"text": label if kind != "morris" else with_unit(label, plain(unit))},
                "automargin": True,
                "range": _range(table),
            },
        ),
        "table": {"head": ["factor", "rows", *(f"{index} {end}" for end in _ENDS)], "rows": table},
    }


def _range(table: list[list[Any]]) -> list[float] | None:
    """Return what of the axis is worth showing: intervals of the first rows would make it all."""
    if not table:
        return None
    last = max(row for _, row, *_ in table)
    ends = [(low, high) for _, row, _, low, high in table if row == last]
    values = [value for _, _, value, _, _ in table]
    low = min(0.0, *values, *(low for low, _ in ends))
    high = max(*values, *(high for _, high in ends))
    margin = 0.08 * (high - low)
    return [low - margin, high + margin]


def series(
    snapshot: Mapping[str, Any], output: str, factor: str, index: str
) -> list[tuple[int, dict[str, float]]]:
    """Return an index of growing parts and of all rows that are complete, where it is defined."""
    entry = snapshot["outputs"][output]
    if "convergence" not in entry:
        return []
    curve = entry["convergence"]["factors"][factor][index]
    points = [
        (row, {end: curve[end][place] for end in _ENDS})
        for place, row in enumerate(entry["convergence"]["rows"])
    ]
    complete = snapshot["rows_complete"]
    if points and complete > points[-1][0]:
        points.append((complete, entry["factors"][factor][index]))
    return [(row, point) for row, point in points if None not in [point[e] for e in _ENDS]]
