"""How wide the intervals are, how wide they should be, and when they will be (Sarrazin 2016)."""

from collections.abc import Mapping
from math import log10
from typing import Any

from analysis.designs import family
from analysis.reports.figures.convergence import series
from analysis.reports.figures.shared import (
    AT_POINTER,
    FAINT,
    MOST_LINES,
    Figure,
    axis,
    figure,
    looks,
    plain,
    ranked,
    rows_axis,
)
from analysis.reports.wording import words
from analysis.sensitivity.judgement.stopping import WANTED, Advice

GOOD = "#009E73"


def precision(snapshot: Mapping[str, Any], output: str, advice: Advice | None) -> Figure | None:
    """Draw the widest half width of each factor's indices over the rows; None if none is known.

    Args:
        advice: how wide they should be, which is drawn as a band, and from when on they will be
            (`analysis.sensitivity.judgement.stopping.advise`).
    """
    if advice is None or not advice.target > 0.0:
        return None
    data: list[dict[str, Any]] = []
    table: list[tuple[str, int, float]] = []
    wanted = WANTED[family(snapshot["method"])]
    own = looks(snapshot["outputs"][output]["factors"])
    for name in ranked(snapshot, output)[:MOST_LINES]:
        widths: dict[int, float] = {}
        for index in wanted:
            for row, point in series(snapshot, output, name, index):
                half = 0.5 * (point["high"] - point["low"])
                widths[row] = max(half, widths.get(row, 0.0))
        if not widths:
            continue
        data.append(
            {
                "type": "scatter",
                "mode": "lines+markers",
                "name": plain(words(name)),
                "x": list(widths),
                "y": list(widths.values()),
                "customdata": [name] * len(widths),
                "line": {"color": own[name]["color"], "width": 1.6},
                "marker": {"size": 5, **own[name]},
                "hovertext": [
                    f"{plain(words(name))}, {row:,} rows: ±{half:.2g}"
                    for row, half in widths.items()
                ],
                "hovertemplate": AT_POINTER,
            }
        )
        table += [(name, row, half) for row, half in widths.items()]
    if not data:
        return None
    now, then = snapshot["rows_complete"], snapshot["rows_complete"] + advice.more_rows
    if advice.more_rows:
        data.append(
            {
                "type": "scatter",
                "mode": "lines+markers+text",
                "name": "expected",
                "x": [now, then],
                "y": [advice.half_width, advice.target],
                "line": {"dash": "dash", "width": 1.5, "color": FAINT},
                "marker": {"size": [0, 11], "symbol": "diamond", "color": GOOD},
                "text": ["", f"about {then:,} rows"],
                "textposition": "bottom left",
                "hovertemplate": "%{x:,} rows: ±%{y:.2g}<extra>expected</extra>",
            }
        )
    values = [advice.target, *(half for *_, half in table)]
    bottom, top = 0.6 * min(value for value in values if value > 0.0), 1.4 * max(values)
    where = {"xref": "x domain", "yref": "y", "x0": 0, "x1": 1, "y0": bottom, "y1": advice.target}
    return figure(
        data,
        390,
        xaxis=rows_axis(min(row for _, row, _ in table), then),
        yaxis=axis(
            "half width of the interval, ±",
            type="log",
            range=[log10(bottom), log10(top)],
            dtick="D2",
        ),
        shapes=[
            {"type": "rect", **where, "fillcolor": GOOD, "opacity": 0.16, "line": {"width": 0}}
        ],
        annotations=[
            {
                "xref": "x domain",
                "yref": "y",
                "x": 0.01,
                "y": log10(advice.target),
                "yanchor": "top",
                "xanchor": "left",
                "showarrow": False,
                "text": f"wanted: ±{advice.target:.2g}",
            }
        ],
        table={"head": ["factor", "rows", "half width"], "rows": table},
    )
