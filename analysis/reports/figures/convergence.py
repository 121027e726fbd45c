"""Indices of growing parts of the sample (paper, figure 11)."""

from collections.abc import Mapping, Sequence
from math import inf
from typing import Any

from analysis.designs import family
from analysis.reports.figures.shared import (
    AT_POINTER,
    ENDS,
    INDICES,
    MOST_LINES,
    WHOLE,
    Figure,
    Snapshot,
    axis,
    band_of,
    beside,
    figure,
    looks,
    plain,
    ranked,
    rows_axis,
    titled,
)
from analysis.reports.wording import with_interval, with_unit, words
from analysis.sensitivity.estimators import SYMBOLS

Point = tuple[int, dict[str, float]]

#: Highest share worth showing, unless an index itself is higher.
SHARE = 1.25


def convergence(
    snapshot: Snapshot, output: str, unit: str = "", palette: Sequence[str] = ()
) -> Figure:
    """Draw the indices of the first 8, 16, ... rows and of all rows, with their intervals.

    Of the most influential factors only, as many as there are colours.

    Args:
        unit: of the output, for the axes of elementary effects.
        palette: factors in the order of their colours; default: the study's.

    Raises:
        ValueError: the study has no such output.
    """
    kind, names = family(snapshot["method"]), ranked(snapshot, output)
    own = looks(snapshot["outputs"][output]["factors"], palette)
    lines = {
        index: {name: series(snapshot, output, name, index) for name in names[:MOST_LINES]}
        for index in INDICES[kind]
    }
    # Shares are compared with each other.
    shares = kind != "morris"
    every = [points for of in lines.values() for points in of.values()]
    panels = [
        curves(
            {plain(words(name)): points for name, points in of.items()},
            {plain(words(name)): own[name] for name in of},
            label if shares else with_unit(label, plain(unit)),
            index,
            legend=not place,
            within=worth_showing(every, SHARE) if shares else worth_showing([*of.values()]),
            customdata={plain(words(name)): name for name in of},
        )
        for place, (index, label) in enumerate(INDICES[kind].items())
        for of in [lines[index]]
    ]
    drawn = beside(panels, width=WHOLE)
    drawn["table"] = {
        "head": ["index", "factor", "rows", *ENDS],
        "rows": [
            [index, name, row, *(point[end] for end in ENDS)]
            for index, of in lines.items()
            for name, points in of.items()
            for row, point in points
        ],
    }
    title = f"Convergence of the indices of {plain(words(output))}"
    return titled(drawn, title, snapshot, what="bands span")


def curves(
    lines: Mapping[str, Sequence[Point]],
    own: Mapping[str, Mapping[str, Any]],
    label: str,
    index: str,
    *,
    legend: bool,
    within: list[float] | None,
    customdata: Mapping[str, str] | None = None,
) -> Figure:
    """Draw an index of growing parts of the sample as lines within bands (paper, figure 11).

    Args:
        lines: by name, the index of each part; those without a point are left out.
        own: by name, colour and mark.
        label: of the index.
        index: its name, for what the pointer is told.
        legend: whether names are beside the lines.
        within: the part of the axis that is shown.
        customdata: by name, what a line stands for.
    """
    data: list[dict[str, Any]] = []
    for name, points in lines.items():
        if not points:
            continue
        rows, look = [row for row, _ in points], own[name]
        low, high = ([point[end] for _, point in points] for end in ("low", "high"))
        data += [
            band_of(rows, low, high, look["color"], 0.14) | {"legendgroup": name},
            {
                "type": "scatter",
                "legendgroup": name,
                "mode": "lines+markers",
                "name": name,
                "x": rows,
                "y": [point["value"] for _, point in points],
                **({"customdata": [customdata[name]] * len(rows)} if customdata else {}),
                "line": {"color": look["color"], "width": 1.8},
                "marker": {"size": 5, **look},
                "showlegend": legend,
                "hovertext": [
                    f"{name}, {row:,} rows: {SYMBOLS.get(index, 'share')} "
                    + " ".join(with_interval(point["value"], point["low"], point["high"])).strip()
                    for row, point in points
                ],
                "hovertemplate": AT_POINTER,
            },
        ]
    last = max((row for points in lines.values() for row, _ in points), default=16)
    first = min((row for points in lines.values() for row, _ in points), default=8)
    return figure(
        data,
        390,
        xaxis=rows_axis(first, last),
        yaxis=axis(label, zeroline=True, **({"range": within} if within else {})),
        empty="fewer than 8 rows yet",
    )


def worth_showing(lines: Sequence[Sequence[Point]], most: float = inf) -> list[float] | None:
    """Return what of an axis is worth showing (paper, figure 11): the values, the last intervals.

    Intervals of the first rows would make all lines one; ends of the last ones beyond `most`, or
    as far below 0, are not shown either, unless an index is there itself.
    """
    points = [(row, point) for line in lines for row, point in line]
    if not points:
        return None
    last = max(row for row, _ in points)
    ends = [point for row, point in points if row == last]
    values = [point["value"] for _, point in points]
    low = min(0.0, *values, max(min(point["low"] for point in ends), -most))
    high = max(*values, min(max(point["high"] for point in ends), most))
    margin = 0.08 * (high - low)
    return [low - margin, high + margin] if margin else None


def series(snapshot: Snapshot, output: str, factor: str, index: str) -> list[Point]:
    """Return an index of growing parts and of all rows that are complete, where it is defined."""
    entry = snapshot["outputs"][output]
    # A snapshot that an earlier version left may not say it.
    if not entry.get("convergence", {}).get("rows"):
        return []
    curve, now = entry["convergence"]["factors"][factor][index], entry["factors"][factor][index]
    return grown(entry["convergence"]["rows"], curve, now, snapshot["rows_complete"])


def grown(
    rows: Sequence[int], curve: Mapping[str, Any], now: Mapping[str, Any], complete: int
) -> list[Point]:
    """Return an index of each part and of all complete rows (paper, figure 11), where defined."""
    points = [(row, {end: curve[end][place] for end in ENDS}) for place, row in enumerate(rows)]
    if points and complete > points[-1][0]:
        points.append((complete, {end: now[end] for end in ENDS}))
    return [(row, point) for row, point in points if None not in point.values()]
