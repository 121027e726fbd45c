"""Indices as bars with their intervals (paper, figures 8 and 10)."""

from collections.abc import Mapping
from typing import Any

from analysis.designs import family
from analysis.reports.figures.shares import BARS
from analysis.reports.figures.style import COLOURS, INDICES
from analysis.reports.interactive.shared import Figure, layout, plain, ranked, reach, told
from analysis.reports.wording import with_unit, words
from analysis.sensitivity.estimators import SYMBOLS

#: By index, the colour of its bars.
_COLOURS = {name: colour for of in BARS.values() for name, (colour, _) in of.items()} | {
    "mu_star": COLOURS[0],
    "sigma": BARS["saltelli"]["total_order"][0],
}


def bars(snapshot: Mapping[str, Any], output: str, unit: str = "") -> Figure | None:
    """Draw S and ST, or mu* and sigma, of every factor; None before any has a value.

    Args:
        unit: of the output, which that of elementary effects is.
    """
    kind = family(snapshot["method"])
    factors, order = snapshot["outputs"][output]["factors"], ranked(snapshot, output)
    if all(factors[name][index]["value"] is None for name in order for index in INDICES[kind]):
        return None
    data = [
        {
            "type": "bar",
            "orientation": "h",
            "name": label,
            "x": [factors[name][index]["value"] for name in order],
            "y": [words(name) for name in order],
            "error_x": reach([factors[name][index] for name in order]),
            "marker": {"color": _COLOURS[index]},
            "customdata": order,
            "hovertext": [told(SYMBOLS[index], factors[name][index]) for name in order],
            "hovertemplate": "%{y}<br>%{hovertext}<extra></extra>",
        }
        for index, label in INDICES[kind].items()
    ]
    shares = kind != "morris"
    title = (
        "share of the variance" if shares else with_unit("effect over the whole range", plain(unit))
    )
    threshold = snapshot["outputs"][output].get("screening", {}).get("threshold")
    line = {"type": "line", "xref": "x", "yref": "paper", "y0": 0, "y1": 1}
    return {
        "data": data,
        "layout": layout(
            110 + 34 * len(order),
            barmode="group",
            bargap=0.3,
            xaxis={"title": {"text": title}, "rangemode": "tozero", "zeroline": True},
            yaxis={"automargin": True, "autorange": "reversed", "ticksuffix": "  "},
            shapes=[
                {**line, "x0": threshold, "x1": threshold, "line": {"width": 1, "dash": "dash"}}
            ]
            if threshold
            else [],
        ),
        "table": {
            "head": ["factor", *(f"{i} {end}" for i in INDICES[kind] for end in _ENDS)],
            "rows": [
                [name, *(factors[name][i][end] for i in INDICES[kind] for end in _ENDS)]
                for name in order
            ],
        },
    }


_ENDS = ("value", "low", "high")
