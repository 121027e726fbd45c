"""What all figures share: colours, layout, labels. matplotlib is imported when one is drawn."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from analysis.designs import family
from analysis.sensitivity.records import output_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Snapshot = Mapping[str, Any]

#: Okabe and Ito's colours, which colour-blind readers can tell apart.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#B8A800")
MARKERS = "osD^v<>p"
FAINT = "#8C8C8C"
INK = "#222222"

#: By family of methods: the indices that are drawn, and what their axes say.
INDICES = {
    "morris": {"mu_star": "mean magnitude μ*", "sigma": "standard deviation σ"},
    "saltelli": {"first_order": "first order S", "total_order": "total order ST"},
    "shapley": {
        "shapley": "Shapley effect",
        "full_first_order": "full first order",
        "independent_total_order": "independent total order",
    },
}


def looks(names: Iterable[str], palette: Sequence[str] = ()) -> list[dict[str, Any]]:
    """Return the colour and the marker of each factor, as keywords of matplotlib.

    Args:
        names: of the factors of one figure.
        palette: all factors of several figures, so that each has one colour in all of them; one
            that is not in it takes its own place.
    """
    places = [palette.index(name) if name in palette else i for i, name in enumerate(names)]
    return [
        {"color": COLOURS[place % len(COLOURS)], "marker": MARKERS[place % len(MARKERS)]}
        for place in places
    ]


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of this size in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=150, layout="constrained")


def factors_of(snapshot: Snapshot, output: str, method: str) -> Mapping[str, Any]:
    """Return an output's factors; ValueError if the family is another or the output unknown."""
    if family(snapshot["method"]) != method:
        raise ValueError(f"this figure shows studies of method {method}, not {snapshot['method']}")
    factors: Mapping[str, Any] = output_of(snapshot, output)["factors"]
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


def open_axes(axes: Axes, x: str = "", y: str = "", **font: float) -> None:
    """Label axes and leave the box around them open above and on the right."""
    if x:
        axes.set_xlabel(x, **font)  # type: ignore[arg-type]
    if y:
        axes.set_ylabel(y, **font)  # type: ignore[arg-type]
    axes.spines[["top", "right"]].set_visible(False)


def draw_bars(axes: Axes, bars: Iterable[tuple[float, Mapping[str, Any]]], **keywords: Any) -> bool:
    """Draw indices as bars at their places, with their intervals; False if none has a value."""
    known = [(place, index) for place, index in bars if index["value"] is not None]
    if known:
        places, values = [place for place, _ in known], [index["value"] for _, index in known]
        axes.barh(places, values, zorder=2, **keywords)
    for place, index in known:
        axes.errorbar(index["value"], place, xerr=reach(index), color=INK, capsize=3, lw=1.2)
    return bool(known)


def say(axes: Axes, text: str) -> None:
    """Write a sentence where there is nothing to draw."""
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", color=FAINT)
