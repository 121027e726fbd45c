"""Distribution of an output over the factors' distributions (paper, figure 9)."""

import numpy as np
from numpy.typing import NDArray

from analysis.reports.figures.shared import (
    AT_POINTER,
    COLOURS,
    FAINT,
    LIGHT,
    Figure,
    axis,
    figure,
    plain,
    titled,
)
from analysis.reports.wording import with_unit

#: Least standard deviation that has bins, in steps between two numbers of that size.
FINEST = 1000.0


def distribution(values: NDArray[np.float64], output: str, unit: str = "") -> Figure:
    """Draw a histogram, a kernel density estimate, and the normal density of the same moments.

    The kernel is Gaussian with Scott's bandwidth (`scipy.stats.gaussian_kde`). How normal the
    output looks says how far its variance stands for its uncertainty (paper, section 3.2).

    Args:
        values: finite, shape (n,).
    """
    # A coordinator that shows a study's tables draws nothing, and this takes a second to import.
    from scipy.stats import gaussian_kde, norm, skew

    per_unit = f"1/({unit})" if unit else ""
    x_axis = axis(plain(with_unit(output, unit)))
    y_axis = axis(plain(with_unit("probability density", per_unit)), rangemode="tozero")
    mean, sd = 0.0, 0.0
    if values.size > 1:
        mean, sd = float(np.mean(values)), float(np.std(values, ddof=1))
    # What differs in the last digits of a number, or whose square is none, has no bins.
    if not sd > FINEST * np.spacing(np.abs(values).max(initial=0.0)):
        return figure([], 390, width=640, empty="nothing varies yet", xaxis=x_axis, yaxis=y_axis)
    low, high = np.quantile(values, [0.0, 1.0]) + np.array([-0.4, 0.4]) * sd
    x = np.linspace(low, high, 200)
    bins = min(max(int(np.sqrt(values.size)), 8), 60)
    heights, edges = np.histogram(values, bins=bins, density=True)
    centres, width = 0.5 * (edges[1:] + edges[:-1]), float(edges[1] - edges[0])
    line = {"type": "scatter", "mode": "lines", "hoverinfo": "skip", "x": x.tolist()}
    kernel = {"width": 2.0, "color": COLOURS[0]}
    normal = {"width": 1.2, "color": FAINT, "dash": "dash"}
    top = float(max(heights.max(), norm.pdf(mean, mean, sd)))
    data = [
        {
            "type": "bar",
            "name": "runs",
            "showlegend": False,
            "x": centres.tolist(),
            "y": heights.tolist(),
            "width": width,
            "marker": {"color": LIGHT},
            "hovertext": [
                f"{round(share * width * values.size):,} runs from {low:.3g} to {high:.3g}"
                for share, low, high in zip(heights, edges, edges[1:], strict=False)
            ],
            "hovertemplate": AT_POINTER,
        },
        {**line, "name": "kernel density", "y": gaussian_kde(values)(x).tolist(), "line": kernel},
        {
            **line,
            "name": "normal, same moments",
            "y": norm.pdf(x, mean, sd).tolist(),
            "line": normal,
        },
        {
            **line,
            "name": f"mean {mean:.3g}",
            "x": [mean, mean],
            "y": [0.0, top],
            "line": {"width": 1.5, "color": COLOURS[1]},
        },
    ]
    rows = list(zip(edges[:-1].tolist(), edges[1:].tolist(), heights.tolist(), strict=True))
    table = {"head": ["from", "to", "density"], "rows": rows}
    drawn = figure(data, 390, width=640, xaxis=x_axis, yaxis=y_axis, bargap=0.04, table=table)
    return titled(
        drawn,
        plain(
            f"{values.size:,} runs: mean {mean:.3g}{' ' + unit if unit else ''}, standard "
            f"deviation {sd:.3g}, skewness {float(skew(values)):.2g}"
        ),
    )
