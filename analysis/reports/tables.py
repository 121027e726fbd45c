"""Tables of a report, from a study's snapshot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, Any

from analysis.designs import WITH_INDICES, family
from analysis.reports.figures.shared import spread_in_words
from analysis.reports.wording import words
from analysis.sensitivity.estimators import SYMBOLS
from analysis.sensitivity.judgement.ranking import RANKED_BY

if TYPE_CHECKING:
    from analysis.sensitivity.surrogate import Answer

#: By family of methods, the indices that have a column.
_COLUMNS = {
    "morris": ("mu", "mu_star", "sigma"),
    "saltelli": ("first_order", "total_order"),
    "shapley": ("shapley", "full_first_order", "independent_total_order"),
}

_MARTINEZ = "Martinez 2011: correlations, intervals by Fisher's transformation (Baudin et al. 2016)"
_UNCENTRED = (
    "Products without centring (Saltelli et al. 2008, equations 4.21 and 4.23): all factors share "
    "an error of the size of mean / standard deviation"
)


@dataclass(frozen=True, kw_only=True)
class Grid:
    """A table; `analysis.reports.html.cell` says what a cell may be."""

    head: Sequence[str]
    rows: Sequence[Sequence[object]]
    #: The last line, set apart.
    foot: Sequence[object] = ()
    title: str = ""
    #: A sentence below it.
    note: str = ""


def indices(snapshot: Mapping[str, Any], output: str, unit: str) -> Grid:
    """Return the indices of an output, the leading factor first; of a sample its spread."""
    entry = snapshot["outputs"][output]
    if snapshot["method"] not in WITH_INDICES:
        mean, sd = (
            None if entry[name] is None else f"{entry[name]:.4g}" for name in ("mean", "sd")
        )
        title = words(output) + (f", {unit}" if unit else "")
        return Grid(
            title=title,
            head=["mean", "standard deviation", "n"],
            rows=[[mean, sd, f"{entry['n']:,}"]],
        )
    title, note = words(output), _level(snapshot)
    if entry["mean"] is not None and entry["sd"] is not None:
        title += f": {spread_in_words(entry, unit)}"
    if snapshot["method"] == "morris":
        note += f"; {unit or 'effects'} per whole range of the factor"
    return _indices(snapshot, entry, title, note)


def curve(snapshot: Mapping[str, Any], name: str) -> list[Grid | str]:
    """Return the generalised indices of a curve, and those of pairs if the method has them."""
    whole = snapshot["curves"][name]["whole"]
    found: list[Grid | str] = []
    if family(snapshot["method"]) == "morris":
        ranked = sorted(
            whole["factors"].items(), key=lambda item: -(item[1]["mu_star"]["value"] or 0.0)
        )
        found.append(
            Grid(
                title=words(name),
                head=["factor", SYMBOLS["mu_star"], "n"],
                rows=[[words(f), of["mu_star"], f"{of['n']:,}"] for f, of in ranked],
                note=f"Root mean square over the curve; {_level(snapshot)}",
            )
        )
    else:
        note = f"Generalised indices of the whole curve (Lamboni et al. 2011); {_level(snapshot)}"
        found.append(_indices(snapshot, whole, words(name), note))
    if "second_order" in whole:
        found.append(_pairs(whole["second_order"], words(name)))
    return found


def pairs(snapshot: Mapping[str, Any], output: str) -> Grid:
    """Return the second-order indices of an output, the largest first."""
    return _pairs(snapshot["outputs"][output]["second_order"], words(output))


def _pairs(found: Sequence[Mapping[str, Any]], title: str) -> Grid:
    return Grid(
        title=title,
        head=["pair", "S of the pair", "n"],
        rows=[
            [" × ".join(map(words, pair["factors"])), pair, f"{pair['n']:,}"]
            for pair in sorted(found, key=lambda pair: -(pair["value"] or 0.0))
        ],
        note="Share of the variance that two factors have together beyond what each has alone "
        "(Saltelli 2002).",
    )


def per_unit(
    snapshot: Mapping[str, Any], output: str, unit: str, factors: Mapping[str, str]
) -> Grid:
    """Return mu, mu* and sigma of an output in the other of their two scalings.

    Args:
        factors: units of the factors, in the order of the lines.
    """
    columns, rows = _COLUMNS["morris"], []
    for name, own in factors.items():
        found = snapshot["outputs"][output]["factors"][name]["per_unit"]
        rows.append(
            [
                words(name),
                *(found[index] if found else None for index in columns),
                f"{unit or 'output'} per {own or 'unit'}",
                f"{found['scale']['width']:.3g} ({found['scale']['by']})" if found else None,
            ]
        )
    return Grid(
        title=words(output),
        head=["factor", *(SYMBOLS[index] for index in columns), "unit", "width"],
        rows=rows,
        note="Equation 22 with the step in the factor's own unit: what one unit of it does. "
        "Factors are compared by the table above, whose effects are those of their whole ranges: "
        "these divided by the width of the factor's distribution, which is its range or, where it "
        "is not uniform, the distance of its 5 % and 95 % quantiles over 0.9.",
    )


def compared(
    snapshot: Mapping[str, Any], output: str, uncentred: Mapping[str, Sequence[float]]
) -> list[Grid | str]:
    """Return S and ST by Martinez 2011 and without centring (Saltelli et al. 2008).

    `uncentred`: both by factor (`analysis.sensitivity.estimators.other_formulas`).
    """
    factors, columns = snapshot["outputs"][output]["factors"], _COLUMNS["saltelli"]
    found = {
        _MARTINEZ: {name: [f["martinez"][i] for i in columns] for name, f in factors.items()},
        _UNCENTRED: {
            name: [
                {"value": share if isfinite(share) else None, "low": None, "high": None}
                for share in both
            ]
            for name, both in uncentred.items()
        },
    }
    return [
        Grid(
            title=description,
            head=["factor", *(SYMBOLS[index] for index in columns)],
            rows=[[words(name), *both] for name, both in lines.items()],
        )
        for description, lines in found.items()
    ]


def surrogate(snapshot: Mapping[str, Any], found: Answer) -> list[Grid | str]:
    """Return the indices of fitted functions beside the sampled ones, and what they are worth."""
    fits = found.fits()
    sampled = snapshot["outputs"][found.output]["factors"]
    columns = _COLUMNS["saltelli"] if family(snapshot["method"]) == "saltelli" else ()
    grid = Grid(
        head=[
            "factor",
            *(f"{name}: S, ST" for name in fits),
            *(f"{SYMBOLS[index]} sampled" for index in columns),
        ],
        rows=[
            [
                words(name),
                *(f"{f.first_order[name]:.3f}, {f.total_order[name]:.3f}" for f in fits.values()),
                *(sampled[name][index] for index in columns),
            ]
            for name in sorted(sampled, key=lambda name: -found.fit.total_order[name])
        ],
        foot=[
            "held-out rows",
            *(f"{max(fit.held_out, 0.0):.1%} explained" for fit in fits.values()),
            *("" for _ in columns),
        ],
    )
    return [grid, found.sentence]


def failures(snapshot: Mapping[str, Any]) -> list[Grid | str]:
    """Return how many runs failed of what, and which factors make them fail."""
    failure = snapshot["failure"]
    causes = [
        [words(cause), f"{count:,}", f"{count / failure['runs']:.2%}"]
        for cause, count in sorted(snapshot["evaluations"].items(), key=lambda item: -item[1])
        if cause != "ok"
    ]
    title = "Indices of failing (1 where a run failed, 0 elsewhere)"
    return [
        failure["sentence"],
        Grid(head=["cause", "runs", "share"], rows=causes),
        _indices(snapshot, failure, title, _level(snapshot)),
    ]


def sampled(factors: Sequence[Mapping[str, Any]], units: Mapping[str, str]) -> Grid:
    """Return what a study's factors are sampled from.

    Args:
        factors: {"name", "distribution"}, as `GET /v1/studies/{id}` describes them.
        units: of factors by name.
    """
    return Grid(
        head=["sampled factor", "distribution", "unit"],
        rows=[
            [factor["name"], distribution(factor["distribution"]), units.get(factor["name"], "")]
            for factor in factors
        ],
    )


def distribution(described: Mapping[str, Any]) -> str:
    """Return a distribution, as `Distribution.to_json` describes it, in words."""
    parameters = ", ".join(
        f"{name} {' '.join(f'{n:g}' for n in (value if isinstance(value, list) else [value]))}"
        for name, value in described.items()
        if name != "kind"
    )
    return f"{words(described['kind'])}: {parameters}"


def _indices(snapshot: Mapping[str, Any], entry: Mapping[str, Any], title: str, note: str) -> Grid:
    kind = family(snapshot["method"])
    columns, by = _COLUMNS[kind], RANKED_BY[kind]
    ranked = sorted(entry["factors"].items(), key=lambda item: -(item[1][by]["value"] or 0.0))
    sums = [entry["sum_first_order"], entry["sum_total_order"]] if kind == "saltelli" else []
    return Grid(
        title=title,
        head=["factor", *(SYMBOLS[index] for index in columns), "n"],
        rows=[
            [words(name), *(found[index] for index in columns), f"{found['n']:,}"]
            for name, found in ranked
        ],
        foot=["sum", *sums, ""] if sums else [],
        note=note,
    )


def _level(snapshot: Mapping[str, Any]) -> str:
    return f"{100 * snapshot['level']:.0f} % intervals"
