"""Where in the space of the factors runs fail."""

from collections.abc import Mapping, Sequence
from typing import Any

from analysis.reports.figures.shared import AT_POINTER, FAINT, GLOW, Figure, axis, figure, plain
from analysis.reports.wording import words


def failures(
    fine: Sequence[Mapping[str, float]],
    failed: Mapping[str, Sequence[Mapping[str, float]]],
    x: str,
    y: str,
    of: Mapping[str, int],
) -> Figure | None:
    """Draw two factors of runs that went well and, glowing, of those that failed.

    Args:
        fine: factors of some runs that went well.
        failed: factors of failed ones, by cause.
        x: the factor of the horizontal axis.
        y: that of the vertical one.
        of: how many runs there are of each cause, and "ok".
    """
    if not any(failed.values()):
        return None
    data: list[dict[str, Any]] = [
        {
            "type": "scatter",
            "mode": "markers",
            "name": f"ok, {len(fine):,} of {of['ok']:,}",
            "x": [run[x] for run in fine],
            "y": [run[y] for run in fine],
            "marker": {"size": 5, "color": FAINT, "opacity": 0.45},
            "hoverinfo": "skip",
        }
    ]
    say = {"hovertemplate": AT_POINTER}
    symbols = ("circle", "diamond", "square", "triangle-up", "x", "star")
    for place, (cause, runs) in enumerate(failed.items()):
        where = {"type": "scatter", "mode": "markers", "legendgroup": cause}
        at = {"x": [run[x] for run in runs], "y": [run[y] for run in runs]}
        halo = {"size": 20, "color": GLOW, "opacity": 0.16}
        core = {"size": 8, "color": GLOW, "symbol": symbols[place % len(symbols)]}
        core["line"] = {"width": 1, "color": "#ffffff"}
        data.append({**where, **at, "marker": halo, "hoverinfo": "skip", "showlegend": False})
        name = f"{plain(words(cause))}, {len(runs):,} of {of[cause]:,}"
        told = [
            "<br>".join((plain(words(cause)), *(f"{plain(words(n))} {run[n]:.4g}" for n in (x, y))))
            for run in runs
        ]
        data.append({**where, **at, "name": name, "marker": core, "hovertext": told, **say})
    head = list(dict.fromkeys((x, y)))
    return figure(
        data,
        440,
        xaxis=axis(plain(words(x))),
        yaxis=axis(plain(words(y))),
        table={
            "head": ["cause", *head],
            "rows": [
                [cause, *(run[name] for name in head)]
                for cause, runs in failed.items()
                for run in runs
            ],
        },
    )
