"""A whole campaign in one picture: its screening, its variance shares, its failures by cause.

Both phases of the paper, section 3, whose figures 8 and 10 these panels are.
"""

from analysis.reports.figures.plane import plane
from analysis.reports.figures.shared import (
    FAINT,
    Figure,
    Snapshot,
    axis,
    beside,
    factors_of,
    figure,
    names_axis,
    plain,
    spread_in_words,
    titled,
)
from analysis.reports.figures.shares import bars
from analysis.reports.wording import words

_PHASES = (FAINT, "#D55E00")


def campaign(phase1: Snapshot, phase2: Snapshot, output: str, unit: str = "") -> Figure:
    """Draw a campaign: its screening, its variance shares, and its failures by cause.

    The snapshots are of methods morris and saltelli.

    Raises:
        ValueError: they are of others, or have no such output.
    """
    factors_of(phase1, output, "morris")
    factors_of(phase2, output, "saltelli")
    runs = sum(sum(phase["evaluations"].values()) for phase in (phase1, phase2))
    failed = runs - sum(phase["evaluations"].get("ok", 0) for phase in (phase1, phase2))
    panels = [plane(phase1, output, unit), bars(phase2, output, unit)]
    if failed:
        panels.append(_failures(phase1, phase2))
    said = ("Phase 1: elementary effects", "Phase 2: shares of the variance", "Runs that failed")
    for panel, title in zip(panels, said, strict=False):
        text = panel["layout"]["xaxis"]["title"]["text"]
        panel["layout"]["xaxis"]["title"] = {"text": f"{text}<br>{title}"}
        panel["layout"]["height"] = 450
    drawn = beside(panels, width=1380 if failed else WIDTH)
    spread = plain(spread_in_words(phase2["outputs"][output], unit))
    title = f"Sensitivity of {plain(words(output))} (phase 2: {spread})"
    titled(drawn, title, phase1, phase2)
    if not failed:
        drawn["layout"]["meta"]["caption"] += f"; none of {runs:,} evaluations failed"
    return drawn


#: Pixels, without failures.
WIDTH = 1010


def _failures(phase1: Snapshot, phase2: Snapshot) -> Figure:
    counts = [
        {cause: n for cause, n in phase["evaluations"].items() if cause != "ok"}
        for phase in (phase1, phase2)
    ]
    causes = sorted(
        {*counts[0], *counts[1]}, key=lambda cause: -sum(count.get(cause, 0) for count in counts)
    )
    data = [
        {
            "type": "bar",
            "orientation": "h",
            "name": f"phase {number}: {sum(count.values()):,} of "
            f"{sum(phase['evaluations'].values()):,}",
            "x": [count.get(cause, 0) for cause in causes],
            "y": list(range(len(causes))),
            "marker": {"color": _PHASES[number - 1]},
            "hoverinfo": "skip",
        }
        for number, (count, phase) in enumerate(zip(counts, (phase1, phase2), strict=True), 1)
    ]
    rows = [[cause, *(count.get(cause, 0) for count in counts)] for cause in causes]
    return figure(
        data,
        450,
        barmode="group",
        xaxis=axis("evaluations", rangemode="tozero"),
        yaxis=names_axis(causes),
        table={"head": ["cause", "phase 1", "phase 2"], "rows": rows},
    )
