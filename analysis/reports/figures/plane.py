"""The mu*-sigma plane of a screening (paper, figure 8)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from analysis.reports.figures import style
from analysis.reports.wording import words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def screening_figure(
    snapshot: style.Snapshot,
    output: str,
    unit: str = "",
    clouds: NDArray[np.float64] | None = None,
    palette: Sequence[str] = (),
) -> Figure:
    """Draw the mu*-sigma plane of a screening with its confidence intervals.

    Args:
        unit: of the output, for the axes.
        clouds: mu* and sigma of every bootstrap replicate, shape (2, replicates, factors); drawn
            beside the intervals, as on the right of the paper's figure 8.
        palette: factors in the order of their colours; default: the study's.
    """
    factors = style.factors_of(snapshot, output, "morris")
    figure = style.new_figure(6.4 if clouds is None else 11.0, 4.6)
    left, *right = figure.subplots(1, 1 if clouds is None else 2, squeeze=False)[0]
    draw_plane(left, factors, unit, palette)
    draw_threshold(left, snapshot["outputs"][output])
    for axes in right:
        assert clouds is not None
        _draw_clouds(axes, list(factors), clouds, unit, palette)
        _join_limits(left, axes)
    figure.suptitle(f"Elementary effects on {words(output)}", fontsize=11)
    style.caption(figure, snapshot)
    return figure


def draw_threshold(axes: Axes, output: Mapping[str, Any]) -> None:
    """Draw what the index of a factor must exceed to matter (`screening`), if known."""
    if threshold := output.get("screening", {}).get("threshold"):
        axes.axvline(threshold, color=style.FAINT, lw=1, ls="--", zorder=1)


def _join_limits(left: Axes, right: Axes) -> None:
    """Give both panels the same limits, so that clouds lie where the intervals are."""
    for get, set_ in (("get_xlim", "set_xlim"), ("get_ylim", "set_ylim")):
        both = np.array([getattr(axes, get)() for axes in (left, right)])
        for axes in (left, right):
            getattr(axes, set_)(both[:, 0].min(), both[:, 1].max())


def _draw_clouds(
    axes: Axes, names: list[str], clouds: NDArray[np.float64], unit: str, palette: Sequence[str]
) -> None:
    mu_star, sigma = clouds
    own = style.looks(names, palette)
    for f in np.argsort(-np.nanmean(np.nan_to_num(mu_star), axis=0)):
        cloud: dict[str, Any] = {"s": 8, "alpha": 0.6, "linewidths": 0, "rasterized": True}
        axes.scatter(mu_star[:, f], sigma[:, f], label=words(names[f]), **own[f], **cloud)
    axes.set_title(f"{len(mu_star)} bootstrap replicates", fontsize=10)
    _label(axes, unit)


def _label(axes: Axes, unit: str) -> None:
    suffix = f" ({unit} per whole range)" if unit else " (per whole range)"
    style.open_axes(axes, *(label + suffix for label in style.INDICES["morris"].values()))


def draw_plane(
    axes: Axes, factors: Mapping[str, Any], unit: str, palette: Sequence[str] = ()
) -> None:
    """Draw mu* and sigma of every factor with their intervals."""
    known = {
        name: (look, indices["mu_star"], indices["sigma"])
        for look, (name, indices) in zip(
            style.looks(factors, palette), factors.items(), strict=True
        )
        if indices["mu_star"]["value"] is not None and indices["sigma"]["value"] is not None
    }
    marks = {}
    # The least influential on top, where the cluster at the origin would hide it.
    for name in sorted(known, key=lambda name: -float(known[name][1]["value"])):
        look, mu_star, sigma = known[name]
        marks[words(name)] = axes.errorbar(
            mu_star["value"],
            sigma["value"],
            xerr=style.reach(mu_star),
            yerr=style.reach(sigma),
            ls="",
            **look,
            markersize=6.5,
            markeredgecolor="white",
            markeredgewidth=0.6,
            capsize=2.5,
            elinewidth=1.2,
        )[0]
    right = 1.06 * max((style.top_of(mu_star) for _, mu_star, _ in known.values()), default=0.0)
    top = 1.1 * max((style.top_of(sigma) for _, _, sigma in known.values()), default=0.0)
    if known and right > 0.0:
        # A monotonic effect without interactions lies well below this line.
        marks["σ = μ*"] = axes.plot([0.0, right], [0.0, right], color=style.FAINT, lw=1, ls=":")[0]
        axes.set_xlim(-0.03 * right, right)
        top = max(top, 0.1 * right)
        axes.set_ylim(-0.03 * top, top)
        axes.legend(marks.values(), marks.keys(), frameon=False, fontsize=9, loc="best")
    else:
        style.say(axes, "no elementary effects yet")
    _label(axes, unit)
