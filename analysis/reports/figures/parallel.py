"""All factors of some runs at once, as lines between parallel axes (Inselberg 1985)."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from analysis.reports.figures.shared import WHOLE, Figure, figure, plain
from analysis.reports.wording import words

#: Runs that are drawn, and parts of equally many into which their outputs are sorted.
MOST_RUNS = 160
PARTS = 5
#: Of the parts, the least outputs first: from blue to red, seen on white and on black.
_COLOURS = ("#4575b4", "#74add1", "#8c8c8c", "#f46d43", "#d73027")


def parallel(
    points: NDArray[np.float64],
    values: NDArray[np.float64],
    names: Sequence[str],
    output: str,
) -> Figure:
    """Draw each run as a line through its factors and its output, coloured by the output.

    Each axis runs from the least to the largest value that is drawn (Inselberg 1985). A touch on
    a part's name takes its lines away, so that what makes the output large is seen.

    Args:
        points: factor values, shape (n, factors).
        values: of the output, shape (n,).
        names: of the factors.
    """
    every = np.column_stack([points, values])[:MOST_RUNS]
    labels = [*names, output]
    if len(every) < PARTS or np.ptp(every[:, -1]) == 0.0:
        return figure([], 400, empty="nothing varies yet", xaxis={}, yaxis={})
    low, high = every.min(axis=0), every.max(axis=0)
    inside = (every - low) / np.where(high > low, high - low, 1.0)
    parts = np.array_split(np.argsort(every[:, -1], kind="stable"), PARTS)
    places = [*range(len(labels)), None]
    data = [
        {
            "type": "scatter",
            "mode": "lines",
            "name": f"{every[part[0], -1]:.3g} to {every[part[-1], -1]:.3g}",
            "x": places * len(part),
            "y": [y for run in inside[part].tolist() for y in (*run, None)],
            "line": {"width": 1.4, "color": colour},
            "opacity": 0.6,
            "hoverinfo": "skip",
        }
        for part, colour in zip(parts, _COLOURS, strict=True)
    ]
    ends = [
        {
            "x": place,
            "y": y,
            "xref": "x",
            "yref": "y",
            "yanchor": anchor,
            "showarrow": False,
            "text": f"{value:.3g}",
        }
        for place in range(len(labels))
        for y, anchor, value in ((0.0, "top", low[place]), (1.0, "bottom", high[place]))
    ]
    return figure(
        data,
        420,
        width=WHOLE,
        xaxis={
            "tickvals": list(range(len(labels))),
            "ticktext": [plain(words(name)) for name in labels],
            "zeroline": False,
            "automargin": True,
        },
        yaxis={"visible": False, "range": [-0.09, 1.09]},
        annotations=ends,
        table={"head": labels, "rows": every.tolist()},
    )
