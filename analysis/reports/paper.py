"""Draws figures (`analysis.reports.figures`) with matplotlib, for reports and files.

It knows what those figures are made of, and no more of plotly.js's language: lines, marks, bands,
bars and maps, in panels side by side. A trace of another type is refused. matplotlib is imported
when one is drawn, so that a coordinator without it can run.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from html import unescape
from typing import TYPE_CHECKING, Any

from analysis.reports.figures.shared import FAINT

if TYPE_CHECKING:
    from matplotlib import figure as drawings
    from matplotlib.axes import Axes

INK = "#222222"
#: Widest that a figure is shown, so that the letters of all have one size.
PIXELS_PER_INCH = 92
_MARKS = {
    "circle": "o",
    "square": "s",
    "diamond": "D",
    "triangle-up": "^",
    "triangle-down": "v",
    "star": "*",
    "cross": "P",
    "pentagon": "p",
    "x": "x",
}
_DASHES = {"solid": "-", "dash": "--", "dot": ":"}
#: Marks of more than so many runs are drawn as pixels: as shapes they would fill megabytes.
_MANY = 200


def on_paper(figure: Mapping[str, Any]) -> drawings.Figure:
    """Return a figure as matplotlib draws it.

    Raises:
        ValueError: it has a trace that this module does not know.
    """
    from matplotlib.figure import Figure

    layout = figure["layout"]
    grid = layout.get("grid", {"rows": 1, "columns": 1})
    size = (layout["width"] / PIXELS_PER_INCH, layout["height"] / PIXELS_PER_INCH)
    drawn = Figure(figsize=size, dpi=150, layout="constrained")
    every = list(drawn.subplots(grid["rows"], grid["columns"], squeeze=False).ravel())
    panels = _by_name(figure, every)
    for name, axes in panels.items():
        _scale(axes, layout, name, panels)
    colours: list[tuple[Axes, Any, str]] = []
    for name, axes in panels.items():
        own = [trace for trace in figure["data"] if trace.get("xaxis", "x") == "x" + name]
        for trace in own:
            colours += _draw(axes, trace, own, layout)
        _mark(axes, layout, name)
    for name, axes in panels.items():
        _finish(axes, layout, name)
    for axes in every[len(panels) :]:
        axes.set_axis_off()
    if colours:
        _, mapped, label = colours[-1]
        beside = [axes for axes, *_ in colours]
        drawn.colorbar(mapped, ax=beside, label=_text(label), aspect=30)
    _name_traces(drawn, list(panels.values()))
    if "title" in layout:
        drawn.suptitle(_text(layout["title"]["text"]), fontsize=11)
    if said := layout.get("meta", {}).get("caption"):
        drawn.supxlabel(said, fontsize=8, color=FAINT)
    return drawn


def panels_of(figure: Mapping[str, Any], drawn: drawings.Figure) -> dict[str, Axes]:
    """Return the panels of a figure that `on_paper` has drawn, by the end of their axes' names."""
    return _by_name(figure, drawn.axes)


def offset(trace: Mapping[str, Any], data: Sequence[Mapping[str, Any]], layout: Any) -> float:
    """Return how far above its place the bars of one trace among those of its panel are."""
    bars = [t for t in data if t["type"] == "bar" and t.get("xaxis") == trace.get("xaxis")]
    place = next(i for i, other in enumerate(bars) if other is trace)
    return (place - 0.5 * (len(bars) - 1)) * _thickness(bars, layout)


def text_of(text: str) -> str:
    """Return a text of a figure as it is read: without tags and entities."""
    return unescape(text.replace("<br>", "\n"))


def _by_name(figure: Mapping[str, Any], axes: Sequence[Axes]) -> dict[str, Axes]:
    names = [key.removeprefix("xaxis") for key in figure["layout"] if key.startswith("xaxis")]
    return dict(zip(names, axes, strict=False))


def _text(text: str) -> str:
    # A dollar would begin a formula.
    return text_of(text).replace("$", r"\$")


def _thickness(bars: Sequence[Any], layout: Mapping[str, Any]) -> float:
    return float((1.0 - layout.get("bargap", 0.2)) / max(len(bars), 1))


def _colour(colour: str) -> Any:
    found = re.fullmatch(r"rgba\((\d+),(\d+),(\d+),([\d.]+)\)", colour)
    if found is None:
        return colour
    *rgb, share = found.groups()
    return (*(int(part) / 255 for part in rgb), float(share))


def _scale(axes: Axes, layout: Mapping[str, Any], name: str, panels: Mapping[str, Axes]) -> None:
    """Set what must be known before anything is drawn."""
    for way, share in (("x", axes.sharex), ("y", axes.sharey)):
        own = layout.get(f"{way}axis{name}", {})
        if "matches" in own:
            share(panels[own["matches"][1:]])
        if own.get("type") == "log":
            step = own.get("dtick")
            base = 10.0 ** float(step) if isinstance(step, float) else 10.0
            getattr(axes, f"set_{way}scale")("log", base=base)


def _draw(
    axes: Axes, trace: Mapping[str, Any], data: Sequence[Mapping[str, Any]], layout: Any
) -> list[tuple[Axes, Any, str]]:
    """Draw one trace; return what of it needs a scale of colours."""
    if trace["type"] == "bar":
        _draw_bars(axes, trace, data, layout)
    elif trace["type"] == "heatmap":
        return [_draw_map(axes, trace)]
    elif trace["type"] == "scatter":
        return _draw_points(axes, trace)
    else:
        raise ValueError(f"no {trace['type']} is drawn on paper")
    return []


def _numbers(values: Sequence[float | None]) -> list[float]:
    return [float("nan") if value is None else value for value in values]


def _draw_points(axes: Axes, trace: Mapping[str, Any]) -> list[tuple[Axes, Any, str]]:
    x, y, mode = _numbers(trace["x"]), _numbers(trace["y"]), trace["mode"]
    line, mark = trace.get("line", {}), trace.get("marker", {})
    label = _text(trace["name"]) if trace.get("showlegend", True) and "name" in trace else None
    if "fill" in trace:
        axes.fill(x, y, color=_colour(trace["fillcolor"]), lw=0)
        return []
    if isinstance(mark.get("color"), list):
        found = axes.scatter(
            x,
            y,
            c=mark["color"],
            s=0.5 * mark["size"] ** 2,
            cmap=mark["colorscale"].lower(),
            vmin=mark["cmin"],
            vmax=mark["cmax"],
            linewidths=0,
            rasterized=True,
        )
        return [(axes, found, mark["colorbar"]["title"]["text"])]
    style: dict[str, Any] = {"ls": "", "color": line.get("color", mark.get("color", INK))}
    if "lines" in mode:
        style |= {"ls": _DASHES[line.get("dash", "solid")], "lw": 0.85 * line.get("width", 1.5)}
    if "markers" in mode:
        style |= {
            "marker": _MARKS[mark.get("symbol", "circle")],
            "ms": 0.7 * mark["size"],
            "mec": mark.get("line", {}).get("color", "none"),
            "mew": 0.7,
            "mfc": mark["color"],
            "alpha": mark.get("opacity"),
            "rasterized": len(x) > _MANY,
        }
    axes.plot(x, y, label=label, **style)
    for way in ("x", "y"):
        if f"error_{way}" in trace:
            _draw_errors(axes, x, y, trace[f"error_{way}"], way)
    left = "left" in trace.get("textposition", "top right")
    aside, ha = ((-6, 5), "right") if left else ((6, 5), "left")
    for at, up, text in zip(x, y, trace.get("text", ()), strict=False):
        if text:
            axes.annotate(
                _text(text), (at, up), aside, textcoords="offset points", fontsize=8, ha=ha
            )
    return []


def _draw_errors(
    axes: Axes, x: Sequence[float], y: Sequence[float], bars: Mapping[str, Any], way: str
) -> None:
    reach: dict[str, Any] = {f"{way}err": [bars["arrayminus"], bars["array"]]}
    look = {"color": bars.get("color", INK), "lw": 1.2, "capsize": 2.5, "ls": "", "zorder": 3}
    axes.errorbar(x, y, **reach, **look)


def _draw_bars(
    axes: Axes, trace: Mapping[str, Any], data: Sequence[Mapping[str, Any]], layout: Any
) -> None:
    label = _text(trace["name"]) if trace.get("showlegend", True) else None
    look = {"color": trace["marker"]["color"], "label": label, "zorder": 2}
    if trace.get("orientation") != "h":
        gap = 1.0 - layout.get("bargap", 0.2)
        axes.bar(trace["x"], trace["y"], width=gap * trace["width"], **look)
        return
    places = [place + offset(trace, data, layout) for place in trace["y"]]
    x = _numbers(trace["x"])
    bars = [bar for bar in data if bar["type"] == "bar"]
    axes.barh(places, x, height=0.95 * _thickness(bars, layout), **look)
    if "error_x" in trace:
        _draw_errors(axes, x, places, trace["error_x"], "x")


def _draw_map(axes: Axes, trace: Mapping[str, Any]) -> tuple[Axes, Any, str]:
    import numpy as np

    z = np.array([_numbers(line) for line in trace["z"]])
    look = {"cmap": trace["colorscale"].lower(), "shading": "nearest", "rasterized": True}
    limits: dict[str, Any] = {"vmin": trace.get("zmin"), "vmax": trace.get("zmax")}
    found = axes.pcolormesh(trace["x"], trace["y"], z, **look, **limits)
    top = np.nanmax(z)
    for i, line in enumerate(trace.get("text", ())):
        for j, text in enumerate(line):
            colour = "white" if z[i, j] < 0.6 * top else INK
            middle: dict[str, Any] = {
                "ha": "center",
                "va": "center",
                "fontsize": 7,
                "color": colour,
            }
            axes.text(trace["x"][j], trace["y"][i], _text(text), **middle)
    return axes, found, trace["colorbar"]["title"]["text"]


def _mark(axes: Axes, layout: Mapping[str, Any], name: str) -> None:
    """Draw lines, areas and sentences of a panel."""
    for shape in layout.get("shapes", ()):
        if shape["xref"].split()[0] != "x" + name:
            continue
        line = {"color": FAINT, "lw": shape["line"]["width"], "zorder": 1}
        if shape["type"] == "line":
            axes.axvline(shape["x0"], ls=_DASHES[shape["line"].get("dash", "solid")], **line)
        else:
            look = {"color": shape["fillcolor"], "alpha": shape["opacity"], "lw": 0}
            axes.axhspan(shape["y0"], shape["y1"], **look)
    for note in layout.get("annotations", ()):
        if note["xref"].split()[0] != "x" + name:
            continue
        inside = "domain" in note["yref"]
        at = note["y"] if inside or layout[f"yaxis{name}"].get("type") != "log" else 10 ** note["y"]
        place = axes.transAxes if inside else axes.get_yaxis_transform()
        middle = note.get("xanchor", "center")
        up = note.get("yanchor", "center")
        colour = note.get("font", {}).get("color", INK)
        axes.text(
            note["x"], at, _text(note["text"]), transform=place, ha=middle, va=up, color=colour
        )


def _finish(axes: Axes, layout: Mapping[str, Any], name: str) -> None:
    """Set the ends, ticks and names of a panel's axes."""
    for way in ("x", "y"):
        own = layout.get(f"{way}axis{name}", {})
        limits, set_limits = getattr(axes, f"get_{way}lim"), getattr(axes, f"set_{way}lim")
        if "range" in own:
            ends = [10**end if own.get("type") == "log" else end for end in own["range"]]
            set_limits(*ends)
        elif own.get("rangemode") == "tozero" and axes.has_data():
            low, high = limits()
            set_limits(min(low, -0.03 * high), max(high, 0.0))
        if own.get("zeroline"):
            (axes.axvline if way == "x" else axes.axhline)(0.0, color=INK, lw=0.8, zorder=3)
        if "ticktext" in own:
            turned = {"rotation": 45, "ha": "right"} if own.get("tickangle") else {}
            texts = [_text(text) for text in own["ticktext"]]
            small = 8 if len(texts) > 8 else 9
            getattr(axes, f"set_{way}ticks")(own["tickvals"], texts, fontsize=small, **turned)
        elif own.get("tickformat") == ",d":
            _count(axes, way, own)
        elif "nticks" in own:
            axes.locator_params(axis=way, nbins=own["nticks"] - 1)
        axes.tick_params(
            axis=way,
            **{f"label{'bottom' if way == 'x' else 'left'}": (own.get("showticklabels", True))},
        )
        getattr(axes, f"set_{way}label")(_text(own.get("title", {}).get("text", "")), fontsize=10)
    axes.spines[["top", "right"]].set_visible(False)


def _count(axes: Axes, way: str, own: Mapping[str, Any]) -> None:
    """Put ticks at whole powers of the axis's step, and write them as counts."""
    from math import ceil, floor, log10

    from matplotlib.ticker import FixedLocator, FuncFormatter

    low, high = getattr(axes, f"get_{way}lim")()
    steps = range(ceil(log10(low) / own["dtick"] - 1e-9), floor(log10(high) / own["dtick"]) + 1)
    ticks = getattr(axes, f"{way}axis")
    ticks.set_major_locator(FixedLocator([10.0 ** (own["dtick"] * step) for step in steps]))
    ticks.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.0f}"))
    axes.minorticks_off()


def _name_traces(drawn: drawings.Figure, panels: Sequence[Axes]) -> None:
    """Put a legend where its lines are: inside a panel, or beside panels that share one."""
    found = [(axes, *axes.get_legend_handles_labels()) for axes in panels]
    named = [one for one in found if one[1]]
    crowded = any(len(labels) > 5 for *_, labels in named) and len(panels) > 1
    for axes, handles, labels in named:
        unique = dict(zip(labels, handles, strict=True))
        if crowded and len(named) == 1:
            outside: dict[str, Any] = {
                "loc": "outside right upper",
                "frameon": False,
                "fontsize": 9,
            }
            drawn.legend(unique.values(), unique.keys(), **outside)
        else:
            axes.legend(unique.values(), unique.keys(), frameon=False, fontsize=8.5, loc="best")
