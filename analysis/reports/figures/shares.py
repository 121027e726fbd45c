"""Indices as bars with their intervals (paper, figures 8 and 10)."""

from collections.abc import Mapping, Sequence
from typing import Any

from analysis.designs import family
from analysis.reports.figures.shared import (
    COLOURS,
    ENDS,
    INDICES,
    LIGHT,
    Figure,
    Snapshot,
    across,
    axis,
    bars_of,
    factors_of,
    figure,
    names_axis,
    plain,
    ranked,
    spread_in_words,
    titled,
    told_of,
)
from analysis.reports.wording import with_unit, words

#: By index, the colour of its bars.
_COLOURS = {
    "mu_star": COLOURS[0],
    "sigma": LIGHT,
    "first_order": COLOURS[0],
    "total_order": LIGHT,
    "full_first_order": LIGHT,
    "shapley": COLOURS[0],
    "independent_total_order": COLOURS[4],
}


def bars(snapshot: Snapshot, output: str, unit: str = "") -> Figure:
    """Draw S and ST, or mu* and sigma, of every factor, the most influential on top.

    Args:
        unit: of the output, which that of elementary effects is.

    Raises:
        ValueError: the study has no such output.
    """
    kind, said = family(snapshot["method"]), snapshot["outputs"].get(output, {})
    factors, order = factors_of(snapshot, output), ranked(snapshot, output)
    data = [
        bars_of(
            label,
            range(len(order)),
            [factors[name][index] for name in order],
            _COLOURS[index],
            [told_of(name, factors[name], kind) for name in order],
            customdata=order,
        )
        for index, label in INDICES[kind].items()
        if any(factors[name][index]["value"] is not None for name in order)
    ]
    title = (
        "share of the variance"
        if kind != "morris"
        else with_unit("effect over the whole range", plain(unit))
    )
    threshold = said.get("screening", {}).get("threshold")
    drawn = figure(
        data,
        110 + 34 * len(order),
        barmode="group",
        bargap=0.3,
        xaxis=axis(title, rangemode="tozero", zeroline=True),
        yaxis=names_axis(order),
        shapes=[across(threshold)] if threshold else [],
        empty="no variance yet",
        table={
            "head": ["factor", *(f"{i} {end}" for i in INDICES[kind] for end in ENDS)],
            "rows": [
                [name, *(factors[name][i][end] for i in INDICES[kind] for end in ENDS)]
                for name in order
            ],
        },
    )
    return titled(drawn, _title(kind, said, output, unit), snapshot)


def _title(kind: str, said: Mapping[str, Any], output: str, unit: str) -> str:
    what = "Elementary effects on" if kind == "morris" else "Shares of the variance of"
    spread: Sequence[str] = ()
    if kind != "morris" and "mean" in said:
        spread = (plain(spread_in_words(said, unit)),)
    return "<br>".join((f"{what} {plain(words(output))}", *spread))
