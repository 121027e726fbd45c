"""An output as colour over pairs of factors (paper, figure 13)."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from analysis.reports.figures.scatter import DRAWN, glowing, telling
from analysis.reports.figures.shared import Figure, axis, beside, figure, plain, sentence
from analysis.reports.wording import with_unit

#: A name and its unit, or "".
Named = tuple[str, str]

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
    said = dict(zip(names, units or [""] * len(names), strict=True))
    place = {name: f for f, name in enumerate(names)}
    chosen = leading_pairs(order)
    panels = [
        pair(
            points[:, [place[a], place[b]]],
            values,
            ((a, said[a]), (b, said[b])),
            (output, unit),
            scale=number == len(chosen),
        )
        for number, (a, b) in enumerate(chosen, 1)
    ]
    return beside(panels, width=380 * len(chosen) + 80)


def pair(
    points: NDArray[np.float64],
    values: NDArray[np.float64],
    names: tuple[Named, Named],
    output: Named,
    *,
    scale: bool = True,
    told: Sequence[str] = (),
    failed: NDArray[np.float64] | None = None,
    of_failed: Sequence[str] = (),
) -> Figure:
    """Draw an output as colour over one pair of factors (paper, figure 13).

    Args:
        points: the two factors, shape (n, 2).
        values: of the output, shape (n,).
        names: of the factors, each with its unit.
        output: its name and unit.
        scale: whether the colours are explained beside it.
        told: what the pointer is told of each run; nothing if empty.
        failed: the factors of runs without a value, shape (m, 2), which glow.
        of_failed: what the pointer is told of them.
    """
    # Colours span the middle of the values: one extreme run must not make all others alike.
    low, high = np.quantile(values, [0.02, 0.98]).tolist() if values.size else (0.0, 1.0)
    bar = {"title": {"text": plain(with_unit(*output)), "side": "right"}, "thickness": 12}
    data = [
        {
            "type": "scatter",
            "mode": "markers",
            "name": "runs",
            "x": points[:DRAWN, 0].tolist(),
            "y": points[:DRAWN, 1].tolist(),
            "marker": {
                "size": 5,
                "colorscale": "Viridis",
                "cmin": low,
                "cmax": high,
                "color": values[:DRAWN].tolist(),
                "showscale": scale,
                "colorbar": bar,
            },
            "meta": [name for name, _ in names],
            "showlegend": False,
            **telling(told),
        }
    ]
    if failed is not None and len(failed):
        data.append(glowing(failed[:, 0].tolist(), failed[:, 1].tolist(), of_failed))
    return figure(
        data,
        345,
        xaxis=axis(plain(with_unit(*names[0])), nticks=6),
        yaxis=axis(plain(with_unit(*names[1]))),
        annotations=[] if values.size else [sentence("no values yet")],
    )
