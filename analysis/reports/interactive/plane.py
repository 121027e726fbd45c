"""The mu*-sigma plane of a screening (paper, figure 8)."""

from collections.abc import Mapping
from typing import Any

from analysis.designs import family
from analysis.reports.figures.style import INDICES
from analysis.reports.interactive.shared import Figure, colour, layout, plain, ranked, reach, told
from analysis.reports.wording import words
from analysis.sensitivity.estimators import SYMBOLS
from analysis.sensitivity.judgement.screening import SHARE_OF_LARGEST


def plane(snapshot: Mapping[str, Any], output: str, unit: str = "") -> Figure | None:
    """Draw mu* and sigma of every factor; None for another method, and before they have a value."""
    if family(snapshot["method"]) != "morris":
        return None
    factors = snapshot["outputs"][output]["factors"]
    order = [
        name
        for name in ranked(snapshot, output)
        if None not in (factors[name]["mu_star"]["value"], factors[name]["sigma"]["value"])
    ]
    if not order:
        return None
    right = max(factors[name]["mu_star"]["value"] for name in order)
    data: list[dict[str, Any]] = [
        {
            "type": "scatter",
            "mode": "markers+text",
            "name": words(name),
            "x": [found["mu_star"]["value"]],
            "y": [found["sigma"]["value"]],
            # The others lie together at the origin.
            "text": [words(name) if found["mu_star"]["value"] > SHARE_OF_LARGEST * right else ""],
            "textposition": "top left" if found["mu_star"]["value"] > 0.5 * right else "top right",
            "cliponaxis": False,
            "customdata": [name],
            "error_x": reach([found["mu_star"]]) | {"color": colour(snapshot, output, name)},
            "error_y": reach([found["sigma"]]) | {"color": colour(snapshot, output, name)},
            "marker": {"size": 10, "color": colour(snapshot, output, name)},
            "hovertext": [
                "<br>".join(told(SYMBOLS[index], found[index]) for index in INDICES["morris"])
            ],
            "hovertemplate": f"{words(name)}<br>%{{hovertext}}<extra></extra>",
            "showlegend": False,
        }
        for name in order
        for found in [factors[name]]
    ]
    data.append(
        {
            "type": "scatter",
            "mode": "lines",
            "name": "σ = μ*",
            "x": [0.0, right],
            "y": [0.0, right],
            "line": {"dash": "dot", "width": 1, "color": "#8C8C8C"},
            "hoverinfo": "skip",
        }
    )
    suffix = f" ({plain(unit)} per whole range)" if unit else " (per whole range)"
    x, y = (label + suffix for label in INDICES["morris"].values())
    return {
        "data": data,
        "layout": layout(
            380,
            xaxis={"title": {"text": x}, "rangemode": "tozero"},
            yaxis={"title": {"text": y}, "rangemode": "tozero", "automargin": True},
        ),
        "table": {
            "head": ["factor", "mu_star", "sigma"],
            "rows": [
                [name, factors[name]["mu_star"]["value"], factors[name]["sigma"]["value"]]
                for name in order
            ],
        },
    }
