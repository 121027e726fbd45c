"""What all figures share: colours, order, words, and how panels stand beside each other.

A figure is plain data as plotly.js reads it, {"data", "layout", "table"}: pages draw it with
plotly.js, `analysis.reports.paper` draws the same for reports and files. "table" is {"head",
"rows"}: what the figure shows as numbers. Ink, grid and font are the page's own.
"""

from collections.abc import Iterable, Mapping, Sequence
from math import ceil, log2, log10
from typing import Any

from analysis.designs import family
from analysis.reports.wording import visible, with_interval, words
from analysis.sensitivity.estimators import SYMBOLS
from analysis.sensitivity.judgement.ranking import RANKED_BY
from analysis.sensitivity.records import output_of

Figure = dict[str, Any]
Snapshot = Mapping[str, Any]
Interval = Mapping[str, float | None]

#: Okabe and Ito's colours, which colour-blind readers can tell apart, and marks beside them.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#B8A800")
MARKS = ("circle", "square", "diamond", "triangle-up", "triangle-down", "star", "cross", "pentagon")
FAINT = "#8C8C8C"
#: What a page shows in its own ink, also where it is dark.
INK = "#000000"
#: Of what failed.
GLOW = "#ff5a1f"
LIGHT = "#9CC9E8"

#: Lines in one figure: more than there are colours could not be told apart.
MOST_LINES = len(COLOURS)

#: By family of methods: the indices that are drawn, and what their axes say.
INDICES = {
    "morris": {"mu_star": "mean magnitude μ*", "sigma": "standard deviation σ"},
    "saltelli": {"first_order": "first order S", "total_order": "total order ST"},
    "shapley": {
        "full_first_order": "full first order",
        "shapley": "Shapley effect",
        "independent_total_order": "independent total order",
    },
}
ENDS = ("value", "low", "high")
#: Of a trace whose "hovertext" is all that the pointer is told.
AT_POINTER = "%{hovertext}<extra></extra>"

#: Pixels of a figure of one panel, and of one across a page.
ONE, WHOLE = 590, 1010


def factors_of(snapshot: Snapshot, output: str, method: str = "") -> Mapping[str, Any]:
    """Return an output's factors; ValueError if the family is another or the output unknown."""
    if method and family(snapshot["method"]) != method:
        raise ValueError(f"this figure shows studies of method {method}, not {snapshot['method']}")
    # On a page curves stand among the outputs, with all that an output has.
    said = snapshot["outputs"].get(output) or output_of(snapshot, output)
    factors: Mapping[str, Any] = said["factors"]
    return factors


def ranked(snapshot: Snapshot, output: str) -> list[str]:
    """Return the factors, the most influential first."""
    factors, by = factors_of(snapshot, output), RANKED_BY[family(snapshot["method"])]
    return sorted(factors, key=lambda name: -(factors[name][by]["value"] or 0.0))


def looks(names: Iterable[str], palette: Sequence[str] = ()) -> dict[str, dict[str, Any]]:
    """Return the colour and the mark of each factor, as a trace's "marker".

    Args:
        names: of an output's factors.
        palette: all factors of several figures, so that each has one colour in all of them; one
            that is not in it takes its own place.
    """
    places = {name: palette.index(name) if name in palette else i for i, name in enumerate(names)}
    return {
        name: {"color": COLOURS[place % len(COLOURS)], "symbol": MARKS[place % len(MARKS)]}
        for name, place in places.items()
    }


def faded(colour: str, share: float) -> str:
    """Return a colour through which one sees."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return f"rgba({red},{green},{blue},{share})"


def plain(text: str) -> str:
    """Return a text that plotly shows as it is: it reads some tags and all entities."""
    return visible(text).replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def told(index: str, found: Interval) -> str:
    """Return what the pointer is told of an index, "" if it has no value."""
    if found["value"] is None:
        return ""
    number, interval = with_interval(found["value"], found["low"], found["high"])
    return f"{SYMBOLS.get(index, '')} {number} {interval}".strip()


def told_of(name: str, entry: Mapping[str, Any], kind: str) -> str:
    """Return what the pointer is told of a factor: its name, its indices, from how many rows."""
    lines = [line for index in INDICES[kind] if (line := told(index, entry[index]))]
    # Of a curve as a whole nobody counts rows.
    rows = [f"n {entry['n']:,}"] if "n" in entry else []
    return f"{plain(words(name))}: " + "<br>".join([*lines, *rows])


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


def bars_of(
    name: str,
    places: Sequence[int],
    found: Sequence[Interval],
    colour: str,
    told: Sequence[str],
    **more: Any,
) -> dict[str, Any]:
    """Return a trace of bars to the right with their intervals.

    Args:
        name: of the trace.
        places: of the bars on the vertical axis.
        found: what they show.
        colour: of all.
        told: what the pointer is told of each.
        more: what else the trace says.
    """
    return {
        "type": "bar",
        "orientation": "h",
        "name": name,
        "x": [one["value"] for one in found],
        "y": list(places),
        "error_x": reach(found),
        "marker": {"color": colour},
        "hovertext": list(told),
        "hovertemplate": AT_POINTER,
        **more,
    }


def band_of(
    x: Sequence[float], low: Sequence[float], high: Sequence[float], colour: str, share: float
) -> dict[str, Any]:
    """Return the trace of a band from `low` to `high`, through which one sees."""
    return {
        "type": "scatter",
        "mode": "lines",
        "line": {"width": 0, "color": colour},
        "x": [*x, *x[::-1]],
        "y": [*low, *high[::-1]],
        "fill": "toself",
        "fillcolor": faded(colour, share),
        "showlegend": False,
        "hoverinfo": "skip",
    }


def shades_of(
    x: Sequence[float], y: Sequence[float], z: Sequence[Sequence[float | None]], what: str
) -> dict[str, Any]:
    """Return the trace of a heat map with a scale beside it; `what`: the shades say."""
    return {
        "type": "heatmap",
        "x": list(x),
        "y": list(y),
        "z": list(z),
        "colorscale": "Cividis",
        "colorbar": {"title": {"text": what, "side": "right"}, "thickness": 12},
        "hoverinfo": "skip",
    }


def names_axis(names: Sequence[str], **more: Any) -> dict[str, Any]:
    """Return a vertical axis with a name at each whole number, the first on top."""
    return {
        "tickvals": list(range(len(names))),
        "ticktext": [plain(words(name)) for name in names],
        # No room is left for numbers that nothing has.
        "range": [len(names) - 0.5, -0.5],
        "automargin": True,
        "ticksuffix": "  ",
        "zeroline": False,
        **more,
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


def axis(text: str, **more: Any) -> dict[str, Any]:
    """Return an axis that says what it is of."""
    return {"title": {"text": text}, "automargin": True, **more}


def across(value: float, **line: Any) -> dict[str, Any]:
    """Return an upright line through a panel."""
    place = {"x0": value, "x1": value, "y0": 0, "y1": 1, "xref": "x", "yref": "y domain"}
    return {"type": "line", **place, "line": {"width": 1, "dash": "dash"} | line}


def sentence(text: str) -> dict[str, Any]:
    """Return what stands in a panel that has nothing to show."""
    where = {"x": 0.5, "y": 0.5, "xref": "x domain", "yref": "y domain", "showarrow": False}
    return {**where, "text": text, "font": {"color": FAINT}}


def figure(
    data: Sequence[dict[str, Any]],
    height: int,
    *,
    table: Mapping[str, Any] | None = None,
    width: int = ONE,
    empty: str = "",
    **layout: Any,
) -> Figure:
    """Return a figure of one panel; `empty`: the sentence in it as long as there is no data."""
    if empty:
        layout["annotations"] = [] if data else [sentence(empty)]
    return {
        "data": list(data),
        "layout": {
            "width": width,
            "height": height,
            "margin": {"l": 10, "r": 14, "t": 10, "b": 44},
            "legend": {"orientation": "h", "yanchor": "bottom", "y": 1.02, "x": 0.0},
            "hoverlabel": {"align": "left"},
            **layout,
        },
        "table": table or {"head": [], "rows": []},
    }


def beside(panels: Sequence[Figure], *, columns: int = 0, width: int = WHOLE) -> Figure:
    """Return one figure of several panels, row by row; its table is that of the first.

    Args:
        columns: panels in a row; 0: all.
        width: of all, in pixels.
    """
    columns = columns or len(panels)
    rows = -(-len(panels) // columns)
    data: list[dict[str, Any]] = []
    axes: dict[str, Any] = {}
    shapes, notes = [], []
    for number, panel in enumerate(panels, 1):
        end = "" if number == 1 else str(number)
        layout = panel["layout"]
        data += [{**one, "xaxis": f"x{end}", "yaxis": f"y{end}"} for one in panel["data"]]
        for name in ("xaxis", "yaxis"):
            axes[name + end] = layout.get(name, {})
        shapes += [_moved(shape, end) for shape in layout.get("shapes", ())]
        notes += [_moved(note, end) for note in layout.get("annotations", ())]
    first = panels[0]["layout"]
    height = max(panel["layout"]["height"] for panel in panels)
    own = ("xaxis", "yaxis", "shapes", "annotations", "width", "height")
    return {
        "data": data,
        "layout": {
            **{name: value for name, value in first.items() if name not in own},
            "width": width,
            "height": rows * height,
            "grid": {"rows": rows, "columns": columns, "pattern": "independent", "xgap": 0.22},
            **axes,
            "shapes": shapes,
            "annotations": notes,
        },
        "table": panels[0]["table"],
    }


def _moved(what: dict[str, Any], end: str) -> dict[str, Any]:
    """Return a shape or a note of one panel as that of another."""
    refs = {name: what[name].replace(what[name][0], what[name][0] + end, 1) for name in _REFS}
    return {**what, **refs}


_REFS = ("xref", "yref")


def titled(
    found: Figure, title: str, *snapshots: Snapshot, what: str = "error bars span"
) -> Figure:
    """Say above a figure what it is and below it from how many rows.

    Pages have headings of their own, and show neither.

    Args:
        snapshots: what it is drawn from.
        what: the bars or bands that span intervals.
    """
    meta = {}
    if snapshots:
        rows = " and ".join(f"{s['rows_used']:,} of {s['rows']:,}" for s in snapshots)
        level = 100 * snapshots[0]["level"]
        meta["caption"] = f"{rows} rows used; {what} {level:.0f} % intervals"
    found["layout"] |= {"title": {"text": title}, "meta": meta}
    return found


def spread_in_words(output: Mapping[str, Any], unit: str) -> str:
    """Return an output's mean and standard deviation."""
    if output["mean"] is None or output["sd"] is None:
        return "no values yet"
    suffix = f" {unit}" if unit else ""
    return f"mean {output['mean']:.3g}{suffix}, standard deviation {output['sd']:.3g}{suffix}"
