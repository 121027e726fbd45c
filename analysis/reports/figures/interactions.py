"""Which factors act together: second-order indices of all pairs as a heat map (Saltelli 2002)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analysis.reports.figures import style
from analysis.reports.wording import words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Factors with a line of their own: the leading ones.
LEADING = 20


def interactions_figure(snapshot: style.Snapshot, output: str) -> Figure:
    """Draw S of every factor and pair as colour, and beside it what each does in company.

    The first picture has S of a factor on its diagonal and the share of a pair beside it; the
    second has ST - S, all interactions of a factor together, with its interval.

    Raises:
        ValueError: the study has no such output, or does not look at pairs.
    """
    factors = style.factors_of(snapshot, output, "saltelli")
    said = snapshot["outputs"][output]
    if "second_order" not in said:
        raise ValueError("this figure shows studies of method saltelli_second_order")
    names = list(said["ranking"]["order"] or factors)[:LEADING]
    place = {name: i for i, name in enumerate(names)}
    grid = np.full((len(names), len(names)), np.nan)
    for name, i in place.items():
        grid[i, i] = _number(factors[name]["first_order"]["value"])
    for pair in said["second_order"]:
        one, other = (place.get(name) for name in pair["factors"])
        if one is not None and other is not None:
            grid[max(one, other), min(one, other)] = _number(pair["value"])
    figure = style.new_figure(11.0, max(4.2, 1.8 + 0.34 * len(names)))
    left, right = figure.subplots(1, 2)
    labels = [words(name) for name in names]
    image = left.imshow(grid, cmap="cividis", vmin=0.0, aspect="auto")
    left.set_xticks(range(len(names)), labels, fontsize=8, rotation=45, ha="right")
    left.set_yticks(range(len(names)), labels, fontsize=8)
    figure.colorbar(image, ax=left, label="share of the variance")
    for (line, column), share in np.ndenumerate(grid):
        if np.isfinite(share):
            color = "white" if share < 0.6 * np.nanmax(grid) else style.INK
            middle = {"ha": "center", "va": "center", "fontsize": 7, "color": color}
            left.text(column, line, f"{share:.2f}", **middle)
    bars = [(float(i), factors[name]["interaction"]) for name, i in place.items()]
    if not style.draw_bars(right, bars, height=0.6, color=style.COLOURS[1]):
        style.say(right, "no variance yet")
    right.set_yticks(range(len(names)), labels, fontsize=8)
    right.invert_yaxis()
    right.axvline(0.0, color=style.INK, lw=0.8)
    style.open_axes(right, "ST - S, a factor's interactions together")
    together = said["sum_first_order"]["value"]
    rest = "" if together is None else f": {max(1.0 - together, 0.0):.0%} of the variance in all"
    figure.suptitle(f"Interactions on {words(output)}{rest}", fontsize=11)
    style.caption(figure, snapshot)
    return figure


def _number(value: float | None) -> float:
    return np.nan if value is None else value
