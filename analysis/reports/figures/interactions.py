"""Which factors act together: second-order indices of all pairs as a heat map (Saltelli 2002)."""

from analysis.reports.figures.shared import (
    COLOURS,
    Figure,
    Snapshot,
    axis,
    bars_of,
    beside,
    factors_of,
    figure,
    names_axis,
    plain,
    shades_of,
    titled,
    told,
)
from analysis.reports.wording import words

#: Factors with a line of their own: the leading ones.
LEADING = 20


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
