"""Indices along a curve, with bands that hold all of it, and its principal components.

Lamboni et al. 2011, figures 2 to 4; bands as in `analysis.sensitivity.curves.bands`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.designs import family
from analysis.reports.figures import style
from analysis.reports.wording import with_unit, words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Factors with a line: the leading ones, as many as can be told apart.
LINES = 5
#: By family of methods, the index that is drawn and what it is.
_DRAWN = {"morris": ("mu_star", "mean magnitude μ*"), "saltelli": ("total_order", "ST")}


def curve_figure(
    snapshot: style.Snapshot, curve: str, unit: str, palette: list[str] | None = None
) -> Figure:
    """Draw the index over the axis for the leading factors, and all as a heat map.

    Args:
        unit: of the curve.
        palette: factors in the order of their colours.

    Raises:
        ValueError: the study has no such curve.
    """
    said = _said(snapshot, curve)
    name, what = _DRAWN[family(snapshot["method"])]
    names = list(said["factors"])
    order = said["ranking"]["order"] or names
    figure = style.new_figure(11.0, max(4.2, 1.8 + 0.28 * len(names)))
    left, right = figure.subplots(1, 2)
    axis, looks = said["axis"], dict(zip(names, style.looks(names, palette or names), strict=True))
    for factor in order[:LINES]:
        line, look = said["factors"][factor][name], looks[factor]["color"]
        value, low, high = (_numbers(line[end]) for end in ("value", "band_low", "band_high"))
        left.plot(axis, value, color=look, lw=1.6, label=words(factor))
        left.fill_between(axis, low, high, color=look, alpha=0.18, lw=0.0)
    if snapshot["method"] != "morris":
        left.set_ylim(-0.05, min(1.3, left.get_ylim()[1]))
    left.set_ylabel(what if name != "mu_star" else with_unit(what, unit))
    left.legend(frameon=False, fontsize=8, loc="best")
    grid = np.array([_numbers(said["factors"][factor][name]["value"]) for factor in order])
    image = right.pcolormesh(axis, range(len(order)), grid, cmap="cividis", shading="nearest")
    right.set_yticks(range(len(order)), [words(factor) for factor in order], fontsize=8)
    right.invert_yaxis()
    figure.colorbar(image, ax=right, label=what)
    for axes in (left, right):
        axes.set_xlabel(with_unit(words(said["over"]), said["axis_unit"]))
    figure.suptitle(f"What moves {words(curve)}, and where", fontsize=11)
    style.caption(figure, snapshot, what="bands hold a whole line as often as")
    return figure


def components_figure(snapshot: style.Snapshot, curve: str, unit: str) -> Figure:
    """Draw the mean curve, what each principal component adds to it, and whose the score is.

    Raises:
        ValueError: the study has no such curve.
    """
    said = _said(snapshot, curve)
    found = said["components"]
    figure = style.new_figure(11.0, 4.2)
    left, right = figure.subplots(1, 2)
    mean, axis = _numbers(said["mean"]), said["axis"]
    left.plot(axis, mean, color=style.INK, lw=1.6, label="mean")
    for c, one in enumerate(found):
        shape, look = _numbers(one["shape"]), style.COLOURS[c]
        label = f"component {c + 1}, {one['share']['value']:.0%} of the variance"
        left.plot(axis, mean + shape, color=look, lw=1.1, label=label)
        left.plot(axis, mean - shape, color=look, lw=1.1, ls="--")
    left.set_xlabel(with_unit(words(said["over"]), said["axis_unit"]))
    left.set_ylabel(with_unit(words(curve), unit))
    left.legend(frameon=False, fontsize=8, loc="best")
    _draw_scores(right, snapshot, said)
    figure.suptitle(f"Principal components of {words(curve)}", fontsize=11)
    style.caption(figure, snapshot)
    return figure


def _draw_scores(axes: Axes, snapshot: style.Snapshot, said: Any) -> None:
    """Draw the index of every leading factor in the score of each component."""
    name = {"morris": "sigma", "saltelli": "total_order"}[family(snapshot["method"])]
    what = {"sigma": "σ of the score's effects", "total_order": "ST of the score"}[name]
    order = (said["ranking"]["order"] or list(said["factors"]))[: 2 * LINES]
    height = 0.8 / max(len(said["components"]), 1)
    for c, one in enumerate(said["components"]):
        bars = [
            (place + (c + 0.5) * height - 0.4, one["factors"][factor][name])
            for place, factor in enumerate(order)
        ]
        style.draw_bars(axes, bars, height=0.9 * height, color=style.COLOURS[c])
    axes.set_yticks(range(len(order)), [words(factor) for factor in order], fontsize=8)
    axes.invert_yaxis()
    style.open_axes(axes, what)
    if not said["components"]:
        style.say(axes, "no variance yet")


def _said(snapshot: style.Snapshot, curve: str) -> Any:
    curves = snapshot.get("curves", {})
    if curve not in curves:
        raise ValueError(f"the study has no curve {curve!r}: it has {', '.join(curves) or 'none'}")
    return curves[curve]


def _numbers(values: list[float | None]) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array([np.nan if value is None else value for value in values])
