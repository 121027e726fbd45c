"""What pairs of factors have together, and how it came to be (Saltelli 2002; paper, figure 11)."""

from collections.abc import Mapping, Sequence
from typing import Any

from analysis.reports.figures.convergence import SHARE, curves, grown, worth_showing
from analysis.reports.figures.shared import (
    COLOURS,
    MARKS,
    Figure,
    Snapshot,
    axis,
    bars_of,
    beside,
    factors_of,
    figure,
    names_axis,
    plain,
    titled,
)
from analysis.reports.wording import with_interval, words

#: Pairs with a bar, and with a curve: the largest, as many as can be told apart.
BARS, CURVES = 15, 6


def largest_pairs(snapshot: Snapshot, output: str) -> list[Mapping[str, Any]]:
    """Return the pairs that have a bar, the largest share first; pairs without one come last."""
    pairs: Sequence[Mapping[str, Any]] = snapshot["outputs"][output]["second_order"]
    return sorted(pairs, key=lambda pair: -_size(pair))[:BARS]


def together(snapshot: Snapshot, output: str) -> Figure:
    """Draw the indices of pairs (`saltelli_second_order`) with intervals, and their convergence.

    Raises:
        ValueError: the study has no such output, or does not look at pairs.
    """
    factors_of(snapshot, output, "saltelli")
    found = largest_pairs(snapshot, output)
    known = [(place, pair) for place, pair in enumerate(found) if pair["value"] is not None]
    data = [
        bars_of(
            "pairs",
            [place for place, _ in known],
            [pair for _, pair in known],
            COLOURS[0],
            [
                f"{' and '.join(plain(words(name)) for name in pair['factors'])}: "
                + " ".join(with_interval(pair["value"], pair["low"], pair["high"])).strip()
                + f", n {pair['n']:,}"
                for _, pair in known
            ],
            showlegend=False,
        )
    ]
    bars = figure(
        data if known else [],
        max(390, 150 + 28 * len(found)),
        bargap=0.4,
        xaxis=axis("share of the variance, beyond what each has alone", zeroline=True),
        yaxis=names_axis([_name(pair) for pair in found]),
        empty="no variance yet",
        table={
            "head": ["factor", "other", "value", "low", "high"],
            "rows": [
                [*pair["factors"], pair["value"], pair["low"], pair["high"]] for pair in found
            ],
        },
    )
    drawn = beside([bars, _growth(snapshot, output, found)])
    title = f"What pairs of factors have together of {plain(words(output))}"
    return titled(drawn, title, snapshot, what="error bars and bands span")


def _growth(snapshot: Snapshot, output: str, found: Sequence[Mapping[str, Any]]) -> Figure:
    parts = snapshot["outputs"][output]["convergence"]
    by_pair = {frozenset(curve["factors"]): curve for curve in parts["second_order"]}
    lines = {
        plain(_name(pair)): grown(
            parts["rows"], by_pair[frozenset(pair["factors"])], pair, snapshot["rows_complete"]
        )
        for pair in found[:CURVES]
        if frozenset(pair["factors"]) in by_pair
    }
    own = {
        name: {"color": COLOURS[place], "symbol": MARKS[place]} for place, name in enumerate(lines)
    }
    within = worth_showing(list(lines.values()), SHARE)
    return curves(lines, own, "share of the variance", "second_order", legend=True, within=within)


def _name(pair: Mapping[str, Any]) -> str:
    return " × ".join(map(words, pair["factors"]))


def _size(pair: Mapping[str, Any]) -> float:
    return -1.0 if pair["value"] is None else abs(float(pair["value"]))
