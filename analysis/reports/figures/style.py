"""What all figures share: colours, layout, words. matplotlib is imported when one is drawn."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from analysis.designs import family

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Snapshot = Mapping[str, Any]

#: Okabe and Ito's colours, which colour-blind readers can tell apart.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#B8A800")
MARKERS = "osD^v<>p"
FAINT = "#8C8C8C"
INK = "#222222"


def styles(factors: Iterable[str], palette: Sequence[str]) -> list[int]:
    """Return each factor's place in the palette; one that is not in it takes its own place.

    Args:
        factors: those of one figure.
        palette: all factors of several figures, so that each has one colour in all of them.
    """
    return [palette.index(name) if name in palette else place for place, name in enumerate(factors)]


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of this size in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=150, layout="constrained")


def factors_of(snapshot: Snapshot, output: str, method: str) -> Mapping[str, Any]:
    """Return an output's factors; ValueError if the family is another or the output unknown."""
    if family(snapshot["method"]) != method:
        raise ValueError(f"this figure shows studies of method {method}, not {snapshot['method']}")
    if output not in snapshot["outputs"]:
        known = ", ".join(snapshot["outputs"])
        raise ValueError(f"the study has no output {output!r}: it has {known}")
    factors: Mapping[str, Any] = snapshot["outputs"][output]["factors"]
    return factors


def caption(
    figure: Figure, *snapshots: Snapshot, what: str = "error bars span", after: str = ""
) -> None:
    """Say below a figure from how many rows it is and what its bars or bands are."""
    rows = " and ".join(f"{s['rows_used']:,} of {s['rows']:,}" for s in snapshots)
    level = 100 * snapshots[0]["level"]
    figure.supxlabel(
        f"{rows} rows used; {what} {level:.0f} % intervals{after}",
        fontsize=8,
        color=FAINT,
    )


def spread_in_words(output: Mapping[str, Any], unit: str) -> str:
    """Return an output's mean and standard deviation."""
    if output["mean"] is None or output["sd"] is None:
        return "no values yet"
    suffix = f" {unit}" if unit else ""
    return f"mean {output['mean']:.3g}{suffix}, standard deviation {output['sd']:.3g}{suffix}"


def reach(interval: Mapping[str, float | None]) -> list[list[float]] | None:
    """Return the lengths of error bars; a percentile interval may leave its estimate outside."""
    value, low, high = interval["value"], interval["low"], interval["high"]
    if value is None or low is None or high is None:
        return None
    return [[max(value - low, 0.0)], [max(high - value, 0.0)]]


def top_of(interval: Mapping[str, float | None]) -> float:
    """Return the upper end of what is drawn of an index."""
    return max(interval["value"] or 0.0, interval["high"] or 0.0)


def say(axes: Axes, text: str) -> None:
    """Write a sentence where there is nothing to draw."""
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=FAINT)


def words(name: str) -> str:
    """Return a name as a reader would write it."""
    return name.replace("_", " ")
