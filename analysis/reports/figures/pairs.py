"""An output as colour over pairs of factors (paper, figure 13)."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from analysis.reports.figures.scatter import DRAWN
from analysis.reports.figures.shared import Figure, axis, beside, figure, plain, sentence
from analysis.reports.wording import with_unit

#: Factors paired with each other: the most influential ones, as in the paper.
LEADING = 3


def leading_pairs(order: Sequence[str]) -> list[tuple[str, str]]:
    """Return the pairs of the leading factors, panel by panel; a lone factor with itself."""
    return list(combinations(order[:LEADING], 2)) or [(order[0], order[0])]


def pairs(
    points: NDArray[np.float64],
    values: NDArray[np.float64],
    names: Sequence[str],
    order: Sequence[str],
    output: str,
    unit: str = "",
    units: Sequence[str] = (),
) -> Figure:
    """Draw one panel for each pair of the leading factors; a pattern hints at an interaction.

    Args:
        points, values, names, output, unit, units: as in `scatter`.
        order: the factors, the most influential first.
    """
    # Colours span the middle of the values: one extreme run must not make all others alike.
    low, high = np.quantile(values, [0.02, 0.98]).tolist() if values.size else (0.0, 1.0)
    said = dict(zip(names, units or [""] * len(names), strict=True))
    place = {name: f for f, name in enumerate(names)}
    colours = {"colorscale": "Viridis", "cmin": low, "cmax": high, "color": values[:DRAWN].tolist()}
    bar = {"title": {"text": plain(with_unit(output, unit)), "side": "right"}, "thickness": 12}
    chosen = leading_pairs(order)
    panels = [
        figure(
            [
                {
                    "type": "scatter",
                    "mode": "markers",
                    "x": points[:DRAWN, place[a]].tolist(),
                    "y": points[:DRAWN, place[b]].tolist(),
                    "marker": {
                        "size": 5,
                        **colours,
                        "showscale": number == len(chosen),
                        "colorbar": bar,
                    },
                    "meta": [a, b],
                    "showlegend": False,
                    "hoverinfo": "skip",
                }
            ],
            345,
            xaxis=axis(plain(with_unit(a, said[a])), nticks=6),
            yaxis=axis(plain(with_unit(b, said[b]))),
            annotations=[] if values.size else [sentence("no values yet")],
        )
        for number, (a, b) in enumerate(chosen, 1)
    ]
    return beside(panels, width=380 * len(chosen) + 80)
