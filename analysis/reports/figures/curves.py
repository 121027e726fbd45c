"""Indices along a curve, with bands that hold all of it, and its principal components.

Lamboni et al. 2011, figures 2 to 4; bands as in `analysis.sensitivity.curves.bands`.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from analysis.designs import family
from analysis.reports.figures.shared import (
    COLOURS,
    INK,
    Figure,
    Snapshot,
    axis,
    band_of,
    bars_of,
    beside,
    figure,
    looks,
    names_axis,
    plain,
    shades_of,
    titled,
)
from analysis.reports.wording import with_interval, with_unit, words

#: Factors with a line: the leading ones, as many as can be told apart.
LINES = 5
#: By family of methods, the index that is drawn and what it is.
_DRAWN = {"morris": ("mu_star", "mean magnitude μ*"), "saltelli": ("total_order", "ST")}
_OF_SCORES = {
    "morris": ("sigma", "σ of the score's effects"),
    "saltelli": ("total_order", "ST of the score"),
}


def curve(
    snapshot: Snapshot, name: str, unit: str = "", palette: Sequence[str] | None = None
) -> Figure:
    """Draw the index over the axis for the leading factors, and all as a heat map.

    Args:
        unit: of the curve.
        palette: factors in the order of their colours.

    Raises:
        ValueError: the study has no such curve.
    """
    said = _said(snapshot, name)
    index, what = _DRAWN[family(snapshot["method"])]
    names = list(said["factors"])
    order = said["ranking"]["order"] or names
    own = looks(names, palette or names)
    lines = {factor: said["factors"][factor][index] for factor in order[:LINES]}
    data: list[dict[str, Any]] = []
    for factor, line in lines.items():
        data += _banded(said["axis"], line, plain(words(factor)), own[factor]["color"])
    label = what if index != "mu_star" else with_unit(what, plain(unit))
    over = axis(plain(with_unit(words(said["over"]), said["axis_unit"])))
    height = max(390, 165 + 26 * len(names))
    left = figure(
        data,
        height,
        xaxis=over,
        yaxis=axis(label, **_within(lines, shares=index != "mu_star")),
        table={
            "head": ["factor", words(said["over"]), index, "low", "high"],
            "rows": [
                [factor, at, *(line[end][i] for end in ("value", "band_low", "band_high"))]
                for factor, line in lines.items()
                for i, at in enumerate(said["axis"])
            ],
        },
    )
    shades = [said["factors"][factor][index]["value"] for factor in order]
    known = any(value is not None for line in shades for value in line)
    right = figure(
        [shades_of(said["axis"], range(len(order)), shades, label)] if known else [],
        height,
        xaxis=over,
        yaxis=names_axis(order),
        empty="no variance yet",
    )
    title = f"What moves {plain(words(name))}, and where"
    return titled(
        beside([left, right]), title, snapshot, what="bands hold a whole line as often as"
    )


def _banded(
    at: Sequence[float], line: Mapping[str, Any], name: str, colour: str
) -> list[dict[str, Any]]:
    """Return a line within its band, where both are known."""
    points = [
        (x, *found)
        for x, *found in zip(at, line["value"], line["band_low"], line["band_high"], strict=True)
        if None not in found
    ]
    if not points:
        return []
    x, value, low, high = (list(column) for column in zip(*points, strict=True))
    line_of = {"type": "scatter", "mode": "lines", "legendgroup": name, "hoverinfo": "skip"}
    return [
        band_of(x, low, high, colour, 0.18) | {"legendgroup": name},
        {**line_of, "name": name, "x": x, "y": value, "line": {"color": colour, "width": 1.8}},
    ]


def _within(lines: Mapping[str, Mapping[str, Any]], *, shares: bool) -> dict[str, Any]:
    """Return what of an axis of shares is shown: bands may reach far beyond."""
    top = max(
        (v for line in lines.values() for v in line["band_high"] if v is not None), default=None
    )
    return {"range": [-0.05, min(1.3, 1.05 * top)]} if shares and top else {}


def components(snapshot: Snapshot, name: str, unit: str = "") -> Figure:
    """Draw the mean curve, what each principal component adds to it, and whose the score is.

    Raises:
        ValueError: the study has no such curve.
    """
    said = _said(snapshot, name)
    at, mean = list(said["axis"]), said["mean"]
    group = {"type": "scatter", "mode": "lines", "x": at, "hoverinfo": "skip"}
    data: list[dict[str, Any]] = [
        {**group, "name": "mean", "y": list(mean), "line": {"width": 1.8, "color": INK}}
    ]
    for c, one in enumerate(said["components"]):
        label = f"component {c + 1}, {one['share']['value']:.0%} of the variance"
        for sign, dash in ((1.0, "solid"), (-1.0, "dash")):
            data.append(
                {
                    **group,
                    "name": label,
                    "legendgroup": label,
                    "showlegend": sign > 0.0,
                    "y": [
                        None if None in (m, s) else m + sign * s
                        for m, s in zip(mean, one["shape"], strict=True)
                    ],
                    "line": {"width": 1.3, "color": COLOURS[c], "dash": dash},
                }
            )
    left = figure(
        data,
        400,
        xaxis=axis(plain(with_unit(words(said["over"]), said["axis_unit"]))),
        yaxis=axis(plain(with_unit(words(name), unit))),
        table={
            "head": [words(said["over"]), "mean", *(t["name"] for t in data[1::2])],
            "rows": [
                [x, mean[i], *(one["shape"][i] for one in said["components"])]
                for i, x in enumerate(at)
            ],
        },
    )
    drawn = beside([left, _scores(snapshot, said)])
    return titled(drawn, f"Principal components of {plain(words(name))}", snapshot)


def _scores(snapshot: Snapshot, said: Mapping[str, Any]) -> Figure:
    """Draw the index of every leading factor in the score of each component."""
    index, what = _OF_SCORES[family(snapshot["method"])]
    order = (said["ranking"]["order"] or list(said["factors"]))[: 2 * LINES]
    data = []
    for c, one in enumerate(said["components"]):
        found = [one["factors"][factor][index] for factor in order]
        name = f"component {c + 1}"
        told = [
            f"{plain(words(factor))}, {name}: "
            + ("" if f["value"] is None else " ".join(with_interval(**f)).strip())
            for factor, f in zip(order, found, strict=True)
        ]
        places = range(len(order))
        data.append(bars_of(name, places, found, COLOURS[c], told, showlegend=False))
    return figure(
        data,
        400,
        barmode="group",
        bargap=0.2,
        xaxis=axis(what, zeroline=True),
        yaxis=names_axis(order),
        empty="no variance yet",
    )


def _said(snapshot: Snapshot, curve: str) -> Any:
    found = snapshot.get("curves", {})
    if curve not in found:
        raise ValueError(f"the study has no curve {curve!r}: it has {', '.join(found) or 'none'}")
    return found[curve]
