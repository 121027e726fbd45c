"""What the interactive figures share."""

from collections.abc import Mapping, Sequence
from math import ceil, log2, log10
from typing import Any

from analysis.designs import family
from analysis.reports.figures.style import COLOURS
from analysis.reports.wording import visible, with_interval
from analysis.sensitivity.judgement.ranking import RANKED_BY

Figure = dict[str, Any]
Interval = Mapping[str, float | None]

#: Lines in one figure: more than there are colours could not be told apart.
MOST_LINES = len(COLOURS)


def ranked(snapshot: Mapping[str, Any], output: str) -> list[str]:
    """Return the factors, the most influential first."""
    factors, by = snapshot["outputs"][output]["factors"], RANKED_BY[family(snapshot["method"])]
    return sorted(factors, key=lambda name: -(factors[name][by]["value"] or 0.0))


def colour(snapshot: Mapping[str, Any], output: str, factor: str) -> str:
    """Return a factor's colour: the same in all figures of the study and in its report."""
    place = list(snapshot["outputs"][output]["factors"]).index(factor)
    return COLOURS[place % len(COLOURS)]


def faded(colour: str, share: float) -> str:
    """Return a colour through which one sees."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},{share})"


def told(symbol: str, index: Interval) -> str:
    """Return what the pointer is told of an index."""
    if index["value"] is None:
        return ""
    number, interval = with_interval(index["value"], index["low"], index["high"])
    return f"{symbol} {number} {interval}".strip()


def plain(text: str) -> str:
    """Return a text that plotly shows as it is: it reads some tags and all entities."""
    return visible(text).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def reach(indices: Sequence[Interval]) -> dict[str, Any]:
    """Return error bars; an interval may leave its estimate outside."""
    above, below = [], []
    for index in indices:
        value, low, high = index["value"], index["low"], index["high"]
        known = value is not None and low is not None and high is not None
        above.append(max(high - value, 0.0) if known else 0.0)  # type: ignore[operator]
        below.append(max(value - low, 0.0) if known else 0.0)  # type: ignore[operator]
    return {
        "type": "data",
        "symmetric": False,
        "array": above,
        "arrayminus": below,
        "thickness": 1.4,
        "width": 4,
    }


def rows_axis(first: int, last: int) -> dict[str, Any]:
    """Return an axis of rows, with ticks at powers of two, eight at most."""
    octaves = ceil(log2(max(last / first, 2.0)) / 8)
    return {
        "title": {"text": "rows of the design"},
        "type": "log",
        # On an axis of powers of ten.
        "dtick": octaves * log10(2.0),
        "tickformat": ",d",
        "automargin": True,
    }


def layout(height: int, **more: Any) -> dict[str, Any]:
    """Return how a figure is laid out."""
    return {
        "height": height,
        "margin": {"l": 10, "r": 14, "t": 10, "b": 44},
        "legend": {"orientation": "h", "yanchor": "bottom", "y": 1.0, "x": 0.0},
        "hoverlabel": {"align": "left"},
        **more,
    }
