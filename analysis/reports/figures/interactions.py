"""Which factors act together, and how that came to be (Saltelli 2002; paper, figure 11)."""

from collections.abc import Mapping, Sequence
from typing import Any

from analysis.reports.figures.convergence import SHARE, curves, grown, worth_showing
from analysis.reports.figures.shared import (
    COLOURS,
    Figure,
    Snapshot,
    axis,
    bars_of,
    beside,
    factors_of,
    figure,
    looks,
    names_axis,
    plain,
    shades_of,
    titled,
    told,
)
from analysis.reports.wording import with_interval, words

#: Factors with a line of their own: the leading ones.
LEADING = 20
#: Pairs with a bar, and with a curve: the largest, as many as can be told apart.
BARS, CURVES = 15, 6


def interactions(snapshot: Snapshot, output: str) -> Figure:
    """Draw what each factor does in company, and beside it S of every factor and pair as colour.

    The first panel has ST - S, all interactions of a factor together, with its interval; the
    second has S of a factor on its diagonal and the share of a pair beside it.

    Raises:
        ValueError: the study has no such output, or does not look at pairs.
    """
    factors = factors_of(snapshot, output, "saltelli")
    said = snapshot["outputs"][output]
    if "second_order" not in said:
        raise ValueError("this figure shows studies of method saltelli_second_order")
    names = list(said["ranking"]["order"] or factors)[:LEADING]
    place = {name: i for i, name in enumerate(names)}
    grid: list[list[float | None]] = [[None] * len(names) for _ in names]
    for name, i in place.items():
        grid[i][i] = factors[name]["first_order"]["value"]
    for pair in said["second_order"]:
        one, other = (place.get(name) for name in pair["factors"])
        if one is not None and other is not None:
            grid[max(one, other)][min(one, other)] = pair["value"]
    height = max(390, 165 + 31 * len(names))
    known = [name for name in names if factors[name]["interaction"]["value"] is not None]
    found = [factors[name]["interaction"] for name in known]
    bars = bars_of(
        "interactions",
        [place[name] for name in known],
        found,
        COLOURS[1],
        [
            f"{plain(words(name))}: {told('interaction', one)}"
            for name, one in zip(known, found, strict=True)
        ],
        showlegend=False,
        customdata=known,
    )
    left = figure(
        [bars] if known else [],
        height,
        bargap=0.4,
        xaxis=axis("ST - S, a factor's interactions together", zeroline=True),
        yaxis=names_axis(names),
        empty="no variance yet",
        table={
            "head": ["factor", "other", "share of the variance"],
            "rows": [
                [names[i], names[j], grid[i][j]] for i in range(len(names)) for j in range(i + 1)
            ],
        },
    )
    shares = [value for line in grid for value in line if value is not None]
    cells = shades_of(range(len(names)), range(len(names)), grid, "share of the variance") | {
        "zmin": 0.0,
        "zmax": max([*shares, 1e-9]),
        "text": [["" if v is None else f"{v:z.2f}" for v in line] for line in grid],
        "texttemplate": "%{text}",
    }
    labels = names_axis(names)
    right = figure(
        [cells] if shares else [],
        height,
        xaxis={**labels, "range": labels["range"][::-1], "tickangle": -45},
        yaxis=labels,
        empty="no variance yet",
    )
    together = said["sum_first_order"]["value"]
    rest = "" if together is None else f": {max(1.0 - together, 0.0):.0%} of the variance in all"
    title = f"Interactions on {plain(words(output))}{rest}"
    return titled(beside([left, right]), title, snapshot)


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
    within = worth_showing(list(lines.values()), SHARE)
    return curves(
        lines, looks(lines), "share of the variance", "second_order", legend=True, within=within
    )


def _name(pair: Mapping[str, Any]) -> str:
    return " × ".join(map(words, pair["factors"]))


def _size(pair: Mapping[str, Any]) -> float:
    return -1.0 if pair["value"] is None else abs(float(pair["value"]))
