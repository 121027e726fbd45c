"""What pairs of factors have together, and how it came to be (Saltelli 2002; paper, figure 11)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from analysis.reports.figures import style
from analysis.reports.figures.convergence import draw_curves
from analysis.reports.wording import words

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Pairs with a bar, and with a curve: the largest, as many as can be told apart.
BARS, CURVES = 15, 6


def largest_pairs(snapshot: style.Snapshot, output: str) -> list[Mapping[str, Any]]:
    """Return the pairs that have a bar, the largest share first; pairs without one come last."""
    pairs: Sequence[Mapping[str, Any]] = snapshot["outputs"][output]["second_order"]
    return sorted(pairs, key=lambda pair: -_size(pair))[:BARS]


def together_figure(snapshot: style.Snapshot, output: str) -> Figure:
    """Draw the indices of pairs (`saltelli_second_order`) with intervals, and their convergence."""
    style.factors_of(snapshot, output, "saltelli")
    pairs = largest_pairs(snapshot, output)
    figure = style.new_figure(11.0, max(4.2, 1.6 + 0.3 * len(pairs)))
    left, right = figure.subplots(1, 2)
    known = style.draw_bars(left, enumerate(pairs[::-1]), height=0.6, color=style.COLOURS[0])
    left.axvline(0.0, color=style.INK, lw=0.8, zorder=3)
    left.set_yticks(range(len(pairs)), [_name(pair) for pair in pairs[::-1]], fontsize=8)
    style.open_axes(left, "share of the variance, beyond what each has alone")
    if not known:
        style.say(left, "no variance yet")
    series = snapshot["outputs"][output]["convergence"]
    curves = {frozenset(curve["factors"]): curve for curve in series["second_order"]}
    chosen = {
        _name(pair): (curves[frozenset(pair["factors"])], pair)
        for pair in pairs[:CURVES]
        if frozenset(pair["factors"]) in curves
    }
    draw_curves(right, series["rows"], chosen, snapshot["rows_complete"])
    right.set_ylabel("share of the variance")
    handles, labels = right.get_legend_handles_labels()
    if handles:
        right.legend(handles, labels, frameon=False, fontsize=8, loc="best")
    figure.suptitle(f"What pairs of factors have together of {words(output)}", fontsize=11)
    style.caption(figure, snapshot, what="error bars and bands span")
    return figure


def _name(pair: Mapping[str, Any]) -> str:
    return " × ".join(map(words, pair["factors"]))


def _size(pair: Mapping[str, Any]) -> float:
    return -1.0 if pair["value"] is None else abs(float(pair["value"]))
