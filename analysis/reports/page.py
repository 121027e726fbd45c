"""The report as HTML: one file without a reference to anything outside it.

Figures are SVG images in the page itself, with clouds of points as pixels inside them, so a page
stays near 1 MB whatever the size of the study, and prints well. `page.js` shows values at the
pointer and sorts tables; without it nothing is missing. The page's own policy lets a browser run
that script, and load nothing.
"""

from __future__ import annotations

import base64
import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib.metadata import version
from importlib.resources import files
from math import isfinite
from typing import TYPE_CHECKING, Any

from analysis.designs import family
from analysis.reports.digits import with_interval

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from analysis.sensitivity.comparison import Compared
    from analysis.sensitivity.estimators import Estimate
    from analysis.sensitivity.surrogate import Answer

#: Columns of the tables of indices, with their symbols in the paper.
_COLUMNS = {
    "morris": {"mu": "μ", "mu_star": "μ*", "sigma": "σ"},
    "saltelli": {"first_order": "S", "total_order": "ST"},
}
_RANKED_BY = {"morris": "mu_star", "saltelli": "total_order"}

#: Widest that a figure is shown, so that the letters of all have one size.
_PIXELS_PER_INCH = 92

_STYLE = """
:root { color-scheme: light; --ink: #1c2430; --faint: #5f6b7a; --line: #dfe4ea; --blue: #0072b2; }
* { box-sizing: border-box; }
body { margin: 0; background: #f4f6f8; color: var(--ink);
  font: 16px/1.55 system-ui, "Segoe UI", Roboto, "DejaVu Sans", Arial, sans-serif; }
main { max-width: 1060px; margin: 0 auto; padding: 2.2rem 1.2rem 4rem; }
h1 { font-size: 1.75rem; line-height: 1.25; margin: 0 0 .4rem; }
h2 { font-size: 1.3rem; margin: 2.6rem 0 .8rem; padding-top: 1.2rem;
  border-top: 2px solid var(--blue); }
h3 { font-size: 1.05rem; margin: 0 0 .3rem; }
.lead { color: var(--faint); margin: 0 0 1rem; }
.card { background: #fff; border: 1px solid var(--line); border-radius: 8px; padding: 1.1rem 1.2rem;
  margin: 0 0 1.1rem; break-inside: avoid; overflow-x: auto; }
.warning { border-left: 5px solid #d55e00; background: #fff4ec; }
figure { margin: 0; }
.plot { position: relative; margin: 0 auto; } .plot img { width: 100%; display: block; }
.ring { position: absolute; width: 15px; height: 15px; margin: -7.5px 0 0 -7.5px;
  border: 2.5px solid #d55e00; border-radius: 50%; pointer-events: none; }
#tip { position: absolute; z-index: 9; max-width: 24rem; padding: .4rem .6rem; font-size: .82rem;
  white-space: pre-line; background: var(--ink); color: #fff; border-radius: 5px;
  pointer-events: none; }
#tip[hidden] { display: none; }
thead th { cursor: pointer; }
th[aria-sort="descending"]::after { content: " ▾"; }
th[aria-sort="ascending"]::after { content: " ▴"; }
tfoot td { font-style: italic; }
figcaption { color: var(--faint); font-size: .88rem; margin-top: .5rem; }
table { border-collapse: collapse; width: 100%; font-size: .92rem;
  font-variant-numeric: tabular-nums; }
th, td { text-align: right; padding: .32rem .6rem; border-bottom: 1px solid var(--line); }
th:first-child, td:first-child { text-align: left; }
th { color: var(--faint); font-weight: 600; }
td small { color: var(--faint); white-space: nowrap; }
.facts th, .facts td { text-align: left; vertical-align: top; }
.facts th { min-width: 7rem; }
summary { cursor: pointer; color: var(--blue); }
ul { margin: .3rem 0; padding-left: 1.2rem; }
footer { color: var(--faint); font-size: .85rem; margin-top: 2.5rem; }
@media print { body { background: #fff; } main { max-width: none; padding: 0; } }
"""


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A figure with what it shows."""

    #: Short, for file names.
    name: str
    title: str
    caption: str
    figure: Figure
    #: What it shows at the pointer (`analysis.reports.hover`).
    panels: Sequence[Mapping[str, Any]] = ()


@dataclass(frozen=True, kw_only=True)
class Section:
    """What the page says of one study."""

    title: str
    #: Name and value of what the study is.
    facts: Mapping[str, str]
    #: What failures do to the indices; empty if nothing.
    warning: str
    remarks: Sequence[str]
    #: Sampled factors: name, distribution, unit.
    sampled: Sequence[tuple[str, str, str]]
    snapshot: Mapping[str, Any]
    #: The output of the figures.
    output: str
    #: Units of the outputs.
    units: Mapping[str, str]
    pictures: Sequence[Picture]
    #: Other estimators' indices of the output, by name.
    compared: Mapping[str, Compared]
    #: The runs that panels point at (`analysis.reports.hover.runs_table`).
    runs: Mapping[str, Any]
    #: What fitted functions say of the output, or why they say nothing; None: nobody asked.
    surrogate: Answer | str | None = None


def page(title: str, findings: Sequence[str], sections: Sequence[Section]) -> str:
    """Return the whole page."""
    output = sections[0].output if sections else ""
    script = files("analysis.reports").joinpath("page.js").read_text(encoding="utf-8")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    policy = (
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
        f"script-src 'sha256-{digest}'"
    )
    return "\n".join(
        [
            "<!DOCTYPE html>",
            '<html lang="en"><head><meta charset="utf-8">',
            f'<meta http-equiv="Content-Security-Policy" content="{policy}">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body><main>",
            f"<header><h1>{escape(title)}</h1>",
            f'<p class="lead">What moves <b>{escape(_words(output))}</b>, and how sure that is.',
            "</p>",
            "</header>",
            _card(_list(findings)) if findings else "",
            *(_section(section) for section in sections),
            f"<footer>rehyb {escape(version('rehyb'))}. Intervals are at the level named with each "
            "table. Methods: Tesfazgi, Sangouard, Endo and Hirche 2023, "
            "doi 10.3389/fnbot.2023.1167604, sections 2.4 and 3.</footer>",
            f"</main><script>{script}</script></body></html>\n",
        ]
    )


def _section(section: Section) -> str:
    snapshot, output = section.snapshot, section.output
    others = [name for name in snapshot["outputs"] if name != output]
    return "\n".join(
        [
            f"<section><h2>{escape(section.title)}</h2>",
            _card(f"<p>{escape(section.warning)}</p>", "warning") if section.warning else "",
            _card(_list(section.remarks)) if section.remarks else "",
            _card(_indices(snapshot, output, section.units)),
            _folded("Per unit of each factor", _per_unit(section))
            if snapshot["method"] == "morris"
            else "",
            _folded("Pairs of factors", _pairs(section))
            if "second_order" in snapshot["outputs"][output]
            else "",
            *(_card(_picture(picture)) for picture in section.pictures),
            _folded(
                "Every other output",
                "".join(_indices(snapshot, name, section.units) for name in others),
            )
            if others
            else "",
            _folded("Other estimators on the same runs", _comparison(section))
            if section.compared
            else "",
            _folded("Surrogates on the same runs", _surrogate(section))
            if section.surrogate
            else "",
            _folded("Failures", _failures(snapshot)) if snapshot["failure"]["failed"] else "",
            _folded("How this was computed", _facts(section)),
            f'<script type="application/json" class="runs">{_safe(section.runs)}</script>',
            "</section>",
        ]
    )


def _picture(picture: Picture) -> str:
    return (
        f"<figure><h3>{escape(picture.title)}</h3>"
        f'<div class="plot" data-panels="{escape(json.dumps(picture.panels, allow_nan=False))}" '
        f'style="max-width: {picture.figure.get_figwidth() * _PIXELS_PER_INCH:.0f}px">'
        f'<img alt="{escape(picture.title + ": " + picture.caption)}" '
        f'src="{_svg(picture.figure)}"></div>'
        f"<figcaption>{escape(picture.caption)}</figcaption></figure>"
    )


def _safe(content: Mapping[str, Any]) -> str:
    """Return JSON that ends no element: a name may hold anything."""
    return json.dumps(content, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _svg(figure: Figure) -> str:
    """Return a figure as a data URI; the same figure gives the same bytes."""
    import matplotlib as mpl

    text = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "rehyb"}):
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": "rehyb"})
    return "data:image/svg+xml;base64," + base64.b64encode(text.getvalue()).decode()


def _indices(snapshot: Mapping[str, Any], output: str, units: Mapping[str, str]) -> str:
    entry = snapshot["outputs"][output]
    unit = units.get(output, "")
    spread = ""
    if entry["mean"] is not None and entry["sd"] is not None:
        suffix = f" {unit}" if unit else ""
        spread = f": mean {entry['mean']:.3g}{suffix}, standard deviation {entry['sd']:.3g}{suffix}"
    level = f"{100 * snapshot['level']:.0f} % intervals"
    if snapshot["method"] == "morris":
        level += f"; {unit or 'effects'} per whole range of the factor"
    return f"<h3>{escape(_words(output) + spread)}</h3>" + _table(snapshot, entry, level)


def _table(snapshot: Mapping[str, Any], entry: Mapping[str, Any], level: str) -> str:
    columns = _COLUMNS[family(snapshot["method"])]
    ranked = sorted(
        entry["factors"].items(),
        key=lambda item: -(item[1][_RANKED_BY[family(snapshot["method"])]]["value"] or 0.0),
    )
    rows = [
        [escape(_words(name)), *(_interval(found[index]) for index in columns), f"{found['n']:,}"]
        for name, found in ranked
    ]
    foot: list[str] = []
    if family(snapshot["method"]) == "saltelli":
        sums = (entry["sum_first_order"], entry["sum_total_order"])
        foot = ["sum", *map(_interval, sums), ""]
    head = ["factor", *columns.values(), "n"]
    return _grid(head, rows, foot) + f'<p class="lead"><small>{level}</small></p>'


def _pairs(section: Section) -> str:
    """Return the second-order indices of the figures' output, the largest first."""
    pairs = section.snapshot["outputs"][section.output]["second_order"]
    rows = [
        [escape(" × ".join(map(_words, pair["factors"]))), _interval(pair), f"{pair['n']:,}"]
        for pair in sorted(pairs, key=lambda pair: -(pair["value"] or 0.0))
    ]
    return (
        f"<h3>{escape(_words(section.output))}</h3>"
        + _grid(["pair", "S of the pair", "n"], rows)
        + '<p class="lead"><small>Share of the variance that two factors have together beyond '
        "what each has alone (Saltelli 2002).</small></p>"
    )


def _per_unit(section: Section) -> str:
    """Return mu, mu* and sigma of the figures' output in the other of their two scalings."""
    columns = _COLUMNS["morris"]
    factors = section.snapshot["outputs"][section.output]["factors"]
    unit = section.units.get(section.output, "")
    rows = []
    for name, _, own in section.sampled:
        found = factors[name]["per_unit"]
        rows.append(
            [
                escape(_words(name)),
                *(_interval(found[index]) if found else "–" for index in columns),
                escape(f"{unit or 'output'} per {own or 'unit'}"),
                escape(f"{found['scale']['width']:.3g} ({found['scale']['by']})" if found else "–"),
            ]
        )
    return (
        f"<h3>{escape(_words(section.output))}</h3>"
        + _grid(["factor", *columns.values(), "unit", "width"], rows)
        + '<p class="lead"><small>Equation 22 with the step in the factor\'s own unit: what one '
        "unit of it does. Factors are compared by the table above, whose effects are those of "
        "their whole ranges: these divided by the width of the factor's distribution, which is "
        "its range or, where it is not uniform, the distance of its 5 % and 95 % quantiles over "
        "0.9.</small></p>"
    )


def _interval(index: Mapping[str, float | None]) -> str:
    if index["value"] is None:
        return "–"
    value, interval = with_interval(index["value"], index["low"], index["high"])
    return f"{value} <small>{interval}</small>" if interval else value


def _comparison(section: Section) -> str:
    factors = section.snapshot["outputs"][section.output]["factors"]
    parts = []
    for compared in section.compared.values():
        rows = [
            [escape(_words(name)), _estimate(compared.first, f), _estimate(compared.total, f)]
            for f, name in enumerate(factors)
        ]
        parts.append(
            f"<h3>{escape(compared.description)}</h3>" + _grid(["factor", "S", "ST"], rows)
        )
    return "".join(parts)


def _surrogate(section: Section) -> str:
    """Return the indices of fitted functions beside the sampled ones."""
    found = section.surrogate
    if found is None or isinstance(found, str):
        return f"<p>{escape(found or '')}</p>"
    fits = found.fits()
    sampled = section.snapshot["outputs"][section.output]["factors"]
    sampled_too = family(section.snapshot["method"]) == "saltelli"
    columns = _COLUMNS["saltelli"] if sampled_too else {}
    rows = [
        [
            escape(_words(name)),
            *(f"{fit.first_order[name]:.3f}, {fit.total_order[name]:.3f}" for fit in fits.values()),
            *(_interval(sampled[name][index]) for index in columns),
        ]
        for name in sorted(sampled, key=lambda name: -found.fit.total_order[name])
    ]
    head = [
        "factor",
        *(f"{name}: S, ST" for name in fits),
        *(f"{s} sampled" for s in columns.values()),
    ]
    held_out = [f"{max(fit.held_out, 0.0):.1%} explained" for fit in fits.values()]
    foot = ["held-out rows", *held_out, *("" for _ in columns)]
    return _grid(head, rows, foot) + f"<p>{escape(found.sentence)}</p>"


def _estimate(estimate: Estimate, f: int) -> str:
    ends = {end: float(getattr(estimate, end)[f]) for end in ("value", "low", "high")}
    return _interval({end: value if isfinite(value) else None for end, value in ends.items()})


def _failures(snapshot: Mapping[str, Any]) -> str:
    failure = snapshot["failure"]
    causes = [
        [escape(_words(cause)), f"{count:,}", f"{count / failure['runs']:.2%}"]
        for cause, count in sorted(snapshot["evaluations"].items(), key=lambda item: -item[1])
        if cause != "ok"
    ]
    return (
        f"<p>{escape(failure['sentence'])}</p>"
        + _grid(["cause", "runs", "share"], causes)
        + "<h3>Indices of failing (1 where a run failed, 0 elsewhere)</h3>"
        + _table(snapshot, failure, f"{100 * snapshot['level']:.0f} % intervals")
    )


def _facts(section: Section) -> str:
    rows = "".join(
        f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>"
        for name, value in section.facts.items()
    )
    sampled = [[escape(cell) for cell in row] for row in section.sampled]
    grid = _grid(["sampled factor", "distribution", "unit"], sampled)
    return f'<table class="facts">{rows}</table><div class="facts">{grid}</div>'


def _grid(head: Sequence[str], rows: Sequence[Sequence[str]], foot: Sequence[str] = ()) -> str:
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    last = "".join(f"<td>{cell}</td>" for cell in foot)
    return (
        f"<table><thead><tr>{''.join(f'<th>{cell}</th>' for cell in head)}</tr></thead>"
        f"<tbody>{body}</tbody>{f'<tfoot><tr>{last}</tr></tfoot>' if foot else ''}</table>"
    )


def _card(content: str, kind: str = "") -> str:
    return f'<div class="card {kind}">{content}</div>'


def _folded(title: str, content: str) -> str:
    return _card(f"<details><summary>{escape(title)}</summary>{content}</details>")


def _list(sentences: Sequence[str]) -> str:
    return f"<ul>{''.join(f'<li>{escape(sentence)}</li>' for sentence in sentences)}</ul>"


def _words(name: str) -> str:
    return name.replace("_", " ")
