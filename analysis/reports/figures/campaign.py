"""A whole campaign in one picture: its screening, its variance shares, its failures by cause.

Both phases of the paper, section 3, whose figures 8 and 10 these panels are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from analysis.reports.figures import style
from analysis.reports.figures.plane import draw_plane
from analysis.reports.figures.shares import draw_shares
from analysis.reports.wording import words

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PHASES = ("#8C8C8C", "#D55E00")


def campaign_figure(
    phase1: style.Snapshot, phase2: style.Snapshot, output: str, unit: str = ""
) -> Figure:
    """Draw a campaign: its screening, its variance shares, and its failures by cause.

    The snapshots are of methods morris and saltelli.
    """
    screened = style.factors_of(phase1, output, "morris")
    ranked = style.factors_of(phase2, output, "saltelli")
    runs = sum(sum(phase["evaluations"].values()) for phase in (phase1, phase2))
    failed = runs - sum(phase["evaluations"].get("ok", 0) for phase in (phase1, phase2))
    figure = style.new_figure(15.0 if failed else 11.0, 4.9)
    plane, shares, *failures = figure.subplots(
        1, 3 if failed else 2, width_ratios=(1.15, 1.1, 0.8)[: 3 if failed else 2]
    )
    draw_plane(plane, screened, unit)
    plane.set_title("Phase 1: elementary effects", fontsize=11)
    draw_shares(shares, ranked)
    shares.set_title("Phase 2: shares of the variance", fontsize=11)
    for axes in failures:
        _draw_failures(axes, phase1, phase2)
    spread = style.spread_in_words(phase2["outputs"][output], unit)
    figure.suptitle(f"Sensitivity of {words(output)} (phase 2: {spread})", fontsize=13)
    none = "" if failed else f"; none of {runs:,} evaluations failed"
    style.caption(figure, phase1, phase2, after=none)
    return figure


def _draw_failures(axes: Axes, phase1: style.Snapshot, phase2: style.Snapshot) -> None:
    axes.set_title("Evaluations that failed", fontsize=11)
    counts = [
        {cause: n for cause, n in phase["evaluations"].items() if cause != "ok"}
        for phase in (phase1, phase2)
    ]
    causes = sorted(
        {*counts[0], *counts[1]}, key=lambda cause: sum(count.get(cause, 0) for count in counts)
    )
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
    axes.set_yticks(range(len(causes)), [words(cause) for cause in causes])
    axes.set_ylim(-0.8, max(len(causes), 3) - 0.2)
    axes.set_xlim(0, 1.18 * max(left))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    style.open_axes(axes, "evaluations")
    axes.legend(frameon=False, fontsize=9, loc="lower right")
