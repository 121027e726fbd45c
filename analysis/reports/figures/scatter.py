"""An output against each factor, with means of bins (paper, figure 12)."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.reports.figures.shared import (
    AT_POINTER,
    COLOURS,
    GLOW,
    INK,
    WHOLE,
    Figure,
    axis,
    beside,
    figure,
    plain,
)
from analysis.reports.wording import with_unit

#: Equal intervals of a factor's values, as in the paper.
BINS = 10

#: Points drawn, the first ones; the means are of all.
DRAWN = 3000


def scatter(
    points: NDArray[np.float64],
    values: NDArray[np.float64],
    names: Sequence[str],
    output: str,
    unit: str = "",
    units: Sequence[str] = (),
) -> Figure:
    """Draw one panel per factor: every run, and the mean of each of ten bins.

    Args:
        points: factor values, shape (n, factors).
        values: of the output, shape (n,).
        units: of the factors; none if empty.
    """
    columns = min(3, len(names))
    panels = [
        against(points[:, f], values, name, output, unit, units[f] if units else "", first=not f)
        for f, name in enumerate(names)
    ]
    drawn = beside(panels, columns=columns, width=WHOLE * columns // 3)
    for number in range(1, len(names) + 1):
        if number % columns != 1 and columns > 1:
            own = drawn["layout"]["yaxis" + (str(number) if number > 1 else "")]
            own |= {"title": {"text": ""}, "showticklabels": False}
    return drawn


def against(
    x: NDArray[np.float64],
    values: NDArray[np.float64],
    name: str,
    output: str,
    unit: str,
    own: str,
    *,
    first: bool = True,
    told: Sequence[str] = (),
    failed: NDArray[np.float64] | None = None,
    of_failed: Sequence[str] = (),
) -> Figure:
    """Draw one panel of it (paper, figure 12).

    Args:
        x, values: the factor and the output of each run, shape (n,).
        name, own: of the factor, and its unit.
        output, unit: the same of the output.
        first: whether it has a vertical axis of its own.
        told: what the pointer is told of each run; nothing if empty.
        failed: the factor of runs without a value, which glow below the others.
        of_failed: what the pointer is told of them.
    """
    centres, means = bin_means(x, values)
    mark: dict[str, Any] = {"size": 3 if len(values) > 400 else 5, "opacity": 0.4}
    data = [
        {
            "type": "scatter",
            "mode": "markers",
            "name": "runs",
            "x": x[:DRAWN].tolist(),
            "y": values[:DRAWN].tolist(),
            "marker": {**mark, "color": INK},
            "meta": [name, output],
            "showlegend": False,
            **telling(told),
        },
        {
            "type": "scatter",
            "mode": "markers",
            "name": "means of bins",
            "x": centres.tolist(),
            "y": means.tolist(),
            "marker": {"size": 9, "color": COLOURS[1], "line": {"width": 1, "color": "#ffffff"}},
            "showlegend": False,
            "hoverinfo": "skip",
        },
    ]
    if failed is not None and failed.size:
        floor = float(values.min()) if values.size else 0.0
        data.append(glowing(failed.tolist(), [floor] * failed.size, of_failed))
    return figure(
        data,
        280,
        xaxis=axis(plain(with_unit(name, own)), nticks=6),
        yaxis=axis(plain(with_unit(output, unit)), **({} if first else {"matches": "y"})),
    )


def telling(told: Sequence[str]) -> dict[str, Any]:
    """Return what a trace of runs tells the pointer (paper, figure 12)."""
    if not told:
        return {"hoverinfo": "skip"}
    return {"hovertext": list(told[:DRAWN]), "hovertemplate": AT_POINTER}


def glowing(x: list[float], y: list[float], told: Sequence[str]) -> dict[str, Any]:
    """Return the trace of runs that failed (paper, section 3.3: what they depend on)."""
    look = {"size": 9, "color": GLOW, "symbol": "x", "line": {"width": 1, "color": "#ffffff"}}
    mark = {"name": "failed", "marker": look, "showlegend": False}
    return {"type": "scatter", "mode": "markers", "x": x, "y": y, **mark, **telling(told)}


def bin_means(
    x: NDArray[np.float64], y: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the centres of the bins that hold a value, and the mean of y in each."""
    if x.size == 0:
        return x, y
    edges = np.linspace(x.min(), x.max(), BINS + 1)
    place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, BINS - 1)
    count = np.bincount(place, minlength=BINS)
    total = np.bincount(place, weights=y, minlength=BINS)
    held = count > 0
    centres = 0.5 * (edges[:-1] + edges[1:])
    return centres[held], total[held] / count[held]
