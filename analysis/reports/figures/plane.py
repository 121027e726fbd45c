"""The mu*-sigma plane of a screening (paper, figure 8)."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.reports.figures.shared import (
    AT_POINTER,
    FAINT,
    INDICES,
    WHOLE,
    Figure,
    Snapshot,
    across,
    axis,
    beside,
    factors_of,
    figure,
    looks,
    plain,
    ranked,
    reach,
    titled,
    told_of,
)
from analysis.reports.wording import words
from analysis.sensitivity.judgement.screening import SHARE_OF_LARGEST

#: How long a letter and how high a line of a label is, in parts of the drawing's sides.
LETTER = 0.02
LINE = 0.05


def plane(
    snapshot: Snapshot,
    output: str,
    unit: str = "",
    clouds: NDArray[np.float64] | None = None,
    palette: Sequence[str] = (),
) -> Figure:
    """Draw mu* and sigma of every factor with their intervals.

    Args:
        unit: of the output, for the axes.
        clouds: mu* and sigma of every bootstrap replicate, shape (2, replicates, factors); drawn
            beside the intervals, as on the right of the paper's figure 8.
        palette: factors in the order of their colours; default: the study's.

    Raises:
        ValueError: the study is no screening, or has no such output.
    """
    factors = factors_of(snapshot, output, "morris")
    own = looks(factors, palette)
    order = [
        name
        for name in ranked(snapshot, output)
        if None not in (factors[name]["mu_star"]["value"], factors[name]["sigma"]["value"])
    ]
    largest = max((factors[name]["mu_star"]["value"] for name in order), default=0.0)
    # The others lie together at the origin.
    labels = _labels(
        {
            name: (factors[name]["mu_star"]["value"], factors[name]["sigma"]["value"])
            for name in order
            if factors[name]["mu_star"]["value"] > SHARE_OF_LARGEST * largest
        }
    )
    data: list[dict[str, Any]] = [
        {
            "type": "scatter",
            "mode": "markers+text",
            "name": plain(words(name)),
            "legendgroup": name,
            "x": [found["mu_star"]["value"]],
            "y": [found["sigma"]["value"]],
            "text": [plain(words(name)) if name in labels else ""],
            "textposition": labels.get(name, "top right"),
            "cliponaxis": False,
            "customdata": [name],
            "error_x": reach([found["mu_star"]]) | {"color": own[name]["color"]},
            "error_y": reach([found["sigma"]]) | {"color": own[name]["color"]},
            "marker": {"size": 9, **own[name]},
            "hovertext": [told_of(name, found, "morris")],
            "hovertemplate": AT_POINTER,
        }
        for name in order
        for found in [factors[name]]
    ]
    if largest > 0.0:
        # A monotonic effect without interactions lies well below this line.
        line = {"dash": "dot", "width": 1, "color": FAINT}
        ends = {"x": [0.0, largest], "y": [0.0, largest], "line": line, "hoverinfo": "skip"}
        data.append({"type": "scatter", "mode": "lines", "name": "σ = μ*", **ends})
    suffix = f" ({plain(unit)} per whole range)" if unit else " (per whole range)"
    x, y = (label + suffix for label in INDICES["morris"].values())
    said = snapshot["outputs"].get(output, {})
    threshold = said.get("screening", {}).get("threshold")
    drawn = figure(
        data,
        400,
        xaxis=axis(x, rangemode="tozero"),
        yaxis=axis(y, rangemode="tozero"),
        shapes=[across(threshold)] if threshold else [],
        empty="no elementary effects yet",
        table={
            "head": ["factor", "mu_star", "sigma"],
            "rows": [
                [name, factors[name]["mu_star"]["value"], factors[name]["sigma"]["value"]]
                for name in order
            ],
        },
    )
    if clouds is not None:
        right = _clouds(list(factors), clouds, own, drawn["layout"])
        drawn = beside([drawn, right], width=WHOLE)
    title = f"Elementary effects on {plain(words(output))}"
    return titled(drawn, title, snapshot)


def _labels(points: Mapping[str, tuple[float, float]]) -> dict[str, str]:
    """Return on which side of its point a factor's name stands, where one is free.

    Names that would lie upon others' are left to the legend. (A point has four places, taken in
    turn: Christensen, Marks and Shieber 1995, An empirical study of algorithms for point-feature
    label placement.)

    Args:
        points: mu* and sigma by factor, those first whose names matter most.
    """
    right, top = (max((at[i] for at in points.values()), default=0.0) or 1.0 for i in (0, 1))
    taken: list[tuple[float, float, float, float]] = []
    found: dict[str, str] = {}
    for name, (mu_star, sigma) in points.items():
        x, y, long = mu_star / right, sigma / top, LETTER * len(words(name))
        sides = ("left", "right") if x > 0.5 else ("right", "left")
        for place in (f"{height} {side}" for height in ("top", "bottom") for side in sides):
            left = x - long if place.endswith("left") else x
            low = y if place.startswith("top") else y - LINE
            box = left, left + long, low, low + LINE
            if not any(
                box[0] < other[1] and other[0] < box[1] and box[2] < other[3] and other[2] < box[3]
                for other in taken
            ):
                taken.append(box)
                found[name] = place
                break
    return found


def _clouds(
    names: list[str],
    clouds: NDArray[np.float64],
    own: dict[str, dict[str, Any]],
    layout: dict[str, Any],
) -> Figure:
    mu_star, sigma = clouds
    data = [
        {
            "type": "scatter",
            "mode": "markers",
            "name": plain(words(names[f])),
            "legendgroup": names[f],
            "showlegend": False,
            "x": [float(x) for x in mu_star[known, f]],
            "y": [float(y) for y in sigma[known, f]],
            "marker": {"size": 4, "opacity": 0.6, **own[names[f]]},
            "hoverinfo": "skip",
        }
        # The least influential on top, where the cluster at the origin would hide it.
        for f in np.argsort(-np.nanmean(np.nan_to_num(mu_star), axis=0))
        for known in [np.isfinite(mu_star[:, f]) & np.isfinite(sigma[:, f])]
    ]
    label = f"{layout['xaxis']['title']['text']}<br>{len(mu_star)} bootstrap replicates"
    # Clouds lie where the intervals are.
    x, y = axis(label, rangemode="tozero", matches="x"), {**layout["yaxis"], "matches": "y"}
    return figure(data, layout["height"], xaxis=x, yaxis=y)
