"""Indices of two studies beside each other (paper, figures 8 and 10, of each)."""

from collections.abc import Sequence
from typing import Any

from analysis.designs import family
from analysis.reports.figures.shared import (
    COLOURS,
    ENDS,
    INDICES,
    Figure,
    Snapshot,
    axis,
    bars_of,
    beside,
    factors_of,
    figure,
    names_axis,
    plain,
    ranked,
    titled,
    told_of,
)
from analysis.reports.wording import words

#: Of the first study and of the second.
PAIR = (COLOURS[0], COLOURS[4])
_UNKNOWN = {"value": None, "low": None, "high": None}


def comparison(snapshots: tuple[Snapshot, Snapshot], names: tuple[str, str], output: str) -> Figure:
    """Draw each index of an output in two studies, factor by factor.

    Args:
        snapshots: of two studies whose methods have the same indices.
        names: what the studies are called.
        output: one that both have.

    Raises:
        ValueError: their indices are not of one kind, or one has no such output.
    """
    kinds = [family(snapshot["method"]) for snapshot in snapshots]
    if kinds[0] != kinds[1]:
        raise ValueError(f"indices of {kinds[0]} and of {kinds[1]} are not of one kind")
    found = [factors_of(snapshot, output) for snapshot in snapshots]
    order = list(dict.fromkeys(ranked(snapshots[0], output) + ranked(snapshots[1], output)))
    panels = []
    for place, (index, label) in enumerate(INDICES[kinds[0]].items()):
        data: list[dict[str, Any]] = []
        for factors, name, colour in zip(found, names, PAIR, strict=True):
            own = [factors[factor][index] if factor in factors else _UNKNOWN for factor in order]
            told = [
                f"{plain(name)}<br>{told_of(factor, factors[factor], kinds[0])}"
                if factor in factors
                else ""
                for factor in order
            ]
            legend = {"legendgroup": colour, "showlegend": not place}
            data.append(bars_of(plain(name), range(len(order)), own, colour, told, **legend))
        known = any(x is not None for trace in data for x in trace["x"])
        panels.append(
            figure(
                data if known else [],
                130 + 34 * len(order),
                barmode="group",
                bargap=0.3,
                xaxis=axis(label, rangemode="tozero", zeroline=True),
                yaxis=names_axis(order),
                empty="no variance yet",
            )
        )
    drawn = beside(panels)
    drawn["table"] = _table(found, order, list(INDICES[kinds[0]]))
    return titled(drawn, f"{plain(words(output))} in two studies", *snapshots)


def _table(
    found: Sequence[Snapshot], order: Sequence[str], indices: Sequence[str]
) -> dict[str, list[object]]:
    head = ["factor", *(f"{i} {end} ({n})" for i in indices for n in (1, 2) for end in ENDS)]
    rows: list[object] = [
        [
            factor,
            *(
                factors.get(factor, {}).get(index, _UNKNOWN)[end]
                for index in indices
                for factors in found
                for end in ENDS
            ),
        ]
        for factor in order
    ]
    return {"head": list(head), "rows": rows}
