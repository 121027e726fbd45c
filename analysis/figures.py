"""Figures of snapshots: screening plane, variance shares, whole campaign (paper, figures 8 to 10).

matplotlib is imported when a figure is drawn, so that a coordinator without it can run.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Snapshot = Mapping[str, Any]

#: Okabe and Ito's colours, which colour-blind readers can tell apart.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#B8A800")
_MARKERS = "osD^v<>p"
_FIRST, _TOTAL = "#0072B2", "#9CC9E8"
_PHASES = ("#8C8C8C", "#D55E00")
_FAINT = "#8C8C8C"


def screening_figure(snapshot: Snapshot, output: str, path: Path, unit: str = "") -> None:
    """Draw the mu*-sigma plane of a screening with its confidence intervals.

    Args:
        snapshot: of a study of method morris.
        output: which of its outputs.
        path: of the picture; the ending decides the format.
        unit: of the output, for the axes.

    Raises:
        ValueError: the snapshot is of another method, or has no such output.
    """
    factors = _factors(snapshot, output, "morris")
    figure = _figure(6.4, 4.6)
    axes = figure.subplots()
    _draw_plane(axes, factors, unit)
    axes.set_title(f"Elementary effects on {_words(output)}", fontsize=11)
    _caption(figure, snapshot)
    figure.savefig(path)


def variance_figure(snapshot: Snapshot, output: str, path: Path, unit: str = "") -> None:
    """Draw first- and total-order indices of a variance-based study with their intervals.

    Arguments and errors as `screening_figure`, for a study of method saltelli; the unit is that of
    the output's mean and standard deviation in the title.
    """
    factors = _factors(snapshot, output, "saltelli")
    figure = _figure(6.4, 1.6 + 0.55 * len(factors))
    axes = figure.subplots()
    _draw_shares(axes, factors)
    spread = _spread(snapshot["outputs"][output], unit)
    axes.set_title(f"Shares of the variance of {_words(output)}\n{spread}", fontsize=11)
    _caption(figure, snapshot)
    figure.savefig(path)


def campaign_figure(
    phase1: Snapshot, phase2: Snapshot, output: str, path: Path, unit: str = ""
) -> None:
    """Draw a campaign: its screening, its variance shares, and its failures by cause.

    Args:
        phase1: snapshot of method morris.
        phase2: snapshot of method saltelli.
        output, path, unit: as in `screening_figure`.

    Raises:
        ValueError: a snapshot is of another method, or has no such output.
    """
    screened = _factors(phase1, output, "morris")
    ranked = _factors(phase2, output, "saltelli")
    figure = _figure(15.0, 4.9)
    plane, shares, failures = figure.subplots(1, 3, width_ratios=(1.15, 1.1, 0.8))
    _draw_plane(plane, screened, unit)
    plane.set_title("Phase 1: elementary effects", fontsize=11)
    _draw_shares(shares, ranked)
    shares.set_title("Phase 2: shares of the variance", fontsize=11)
    _draw_failures(failures, phase1, phase2)
    spread = _spread(phase2["outputs"][output], unit)
    figure.suptitle(f"Sensitivity of {_words(output)} (phase 2: {spread})", fontsize=13)
    _caption(figure, phase1, phase2)
    figure.savefig(path)


def _draw_plane(axes: Axes, factors: Mapping[str, Any], unit: str) -> None:
    known = {
        name: (style, indices["mu_star"], indices["sigma"])
        for style, (name, indices) in enumerate(factors.items())
        if indices["mu_star"]["value"] is not None and indices["sigma"]["value"] is not None
    }
    marks = {}
    # The least influential on top, where the cluster at the origin would hide it.
    for name in sorted(known, key=lambda name: -float(known[name][1]["value"])):
        style, mu_star, sigma = known[name]
        marks[_words(name)] = axes.errorbar(
            mu_star["value"],
            sigma["value"],
            xerr=_reach(mu_star),
            yerr=_reach(sigma),
            fmt=_MARKERS[style % len(_MARKERS)],
            color=_COLOURS[style % len(_COLOURS)],
            markersize=6.5,
            markeredgecolor="white",
            markeredgewidth=0.6,
            capsize=2.5,
            elinewidth=1.2,
        )[0]
    right = 1.06 * max((_top(mu_star) for _, mu_star, _ in known.values()), default=0.0)
    top = 1.1 * max((_top(sigma) for _, _, sigma in known.values()), default=0.0)
    if known and right > 0.0:
        # A monotonic effect without interactions lies well below this line.
        marks["σ = μ*"] = axes.plot([0.0, right], [0.0, right], color=_FAINT, lw=1, ls=":")[0]
        axes.set_xlim(-0.03 * right, right)
        top = max(top, 0.1 * right)
        axes.set_ylim(-0.03 * top, top)
        axes.legend(marks.values(), marks.keys(), frameon=False, fontsize=9, loc="best")
    else:
        _say(axes, "no elementary effects yet")
    suffix = f" ({unit})" if unit else ""
    axes.set_xlabel(f"mean magnitude μ*{suffix}")
    axes.set_ylabel(f"standard deviation σ{suffix}")
    axes.spines[["top", "right"]].set_visible(False)


def _draw_shares(axes: Axes, factors: Mapping[str, Any]) -> None:
    order = sorted(factors, key=lambda name: factors[name]["total_order"]["value"] or 0.0)
    kinds = (
        ("first_order", "first order S", _FIRST, 0.2),
        ("total_order", "total order ST", _TOTAL, -0.2),
    )
    drawn = False
    for index, label, colour, offset in kinds:
        known = [
            (place, factors[name][index])
            for place, name in enumerate(order)
            if factors[name][index]["value"] is not None
        ]
        if not known:
            continue
        drawn = True
        places = [place + offset for place, _ in known]
        values = [share["value"] for _, share in known]
        axes.barh(places, values, height=0.36, color=colour, label=label, zorder=2)
        for place, (_, share) in zip(places, known, strict=True):
            axes.errorbar(
                share["value"], place, xerr=_reach(share), color="#222222", capsize=3, lw=1.2
            )
    axes.axvline(0.0, color="#222222", lw=0.8, zorder=3)
    axes.set_yticks(range(len(order)), [_words(name) for name in order])
    axes.set_xlabel("share of the variance")
    axes.spines[["top", "right"]].set_visible(False)
    if drawn:
        axes.set_xlim(min(axes.get_xlim()[0], 0.0), max(axes.get_xlim()[1], 1.0))
        axes.legend(frameon=False, fontsize=9, loc="lower right")
    else:
        _say(axes, "no variance yet")


def _draw_failures(axes: Axes, phase1: Snapshot, phase2: Snapshot) -> None:
    axes.set_title("Evaluations that failed", fontsize=11)
    counts = [
        {cause: n for cause, n in phase["evaluations"].items() if cause != "ok"}
        for phase in (phase1, phase2)
    ]
    causes = sorted(
        {*counts[0], *counts[1]}, key=lambda cause: sum(count.get(cause, 0) for count in counts)
    )
    if not causes:
        total = sum(sum(phase["evaluations"].values()) for phase in (phase1, phase2))
        _say(axes, f"none of {total:,}")
        axes.set_axis_off()
        return
    from matplotlib.ticker import MaxNLocator

    left = [0] * len(causes)
    for count, phase, name, colour in zip(
        counts, (phase1, phase2), ("phase 1", "phase 2"), _PHASES, strict=True
    ):
        values = [count.get(cause, 0) for cause in causes]
        total = sum(phase["evaluations"].values())
        label = f"{name}: {sum(values):,} of {total:,}"
        axes.barh(range(len(causes)), values, left=left, height=0.5, color=colour, label=label)
        left = [a + b for a, b in zip(left, values, strict=True)]
    for place, total in enumerate(left):
        axes.annotate(f"{total:,}", (total, place), (4, 0), textcoords="offset points", va="center")
    axes.set_yticks(range(len(causes)), [_words(cause) for cause in causes])
    axes.set_ylim(-0.8, max(len(causes), 3) - 0.2)
    axes.set_xlim(0, 1.18 * max(left))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel("evaluations")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=9, loc="lower right")


def _figure(width: float, height: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=150, layout="constrained")


def _factors(snapshot: Snapshot, output: str, method: str) -> Mapping[str, Any]:
    if snapshot["method"] != method:
        raise ValueError(f"this figure shows studies of method {method}, not {snapshot['method']}")
    if output not in snapshot["outputs"]:
        known = ", ".join(snapshot["outputs"])
        raise ValueError(f"the study has no output {output!r}: it has {known}")
    factors: Mapping[str, Any] = snapshot["outputs"][output]["factors"]
    return factors


def _caption(figure: Figure, *snapshots: Snapshot) -> None:
    rows = " and ".join(f"{s['rows_used']:,} of {s['rows']:,}" for s in snapshots)
    level = 100 * snapshots[0]["level"]
    figure.supxlabel(
        f"{rows} rows used; error bars span {level:.0f} % intervals (bootstrap)",
        fontsize=8,
        color=_FAINT,
    )


def _spread(output: Mapping[str, Any], unit: str) -> str:
    if output["mean"] is None or output["sd"] is None:
        return "no values yet"
    suffix = f" {unit}" if unit else ""
    return f"mean {output['mean']:.3g}{suffix}, standard deviation {output['sd']:.3g}{suffix}"


def _reach(interval: Mapping[str, float | None]) -> list[list[float]] | None:
    """Return the lengths of error bars; a percentile interval may leave its estimate outside."""
    value, low, high = interval["value"], interval["low"], interval["high"]
    if value is None or low is None or high is None:
        return None
    return [[max(value - low, 0.0)], [max(high - value, 0.0)]]


def _top(interval: Mapping[str, float | None]) -> float:
    return max(interval["value"] or 0.0, interval["high"] or 0.0)


def _say(axes: Axes, text: str) -> None:
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=_FAINT)


def _words(name: str) -> str:
    return name.replace("_", " ")
