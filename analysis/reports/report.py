"""One page that holds all there is to say of one study, or of the two phases of a campaign.

Everything is computed from the study's description and its table of results, so a report can be
made again from these two files alone, and its numbers are those of the coordinator bit for bit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from analysis.designs import SINGLE_POINTS, family
from analysis.files.results_csv import read_table
from analysis.reports import hover, tables
from analysis.reports.html import render
from analysis.reports.pictures import Picture, Subject, curve_pictures, pictures
from analysis.reports.tables import Grid
from analysis.sensitivity.estimator_state import EstimatorState
from analysis.sensitivity.estimators import Estimator
from analysis.sensitivity.estimators.other_formulas import uncentred
from analysis.sensitivity.records import plan_of
from analysis.sensitivity.remarks import remarks, warning
from analysis.sensitivity.table import Table

_METHODS = {
    "morris": "Screening by elementary effects",
    "saltelli": "Variance-based indices",
    "saltelli_second_order": "Variance-based indices, also of pairs",
    "shapley": "Shapley effects",
    "surrogate": "Variance-based indices of a fitted function",
    "sample": "A sample",
}


@dataclass(frozen=True, kw_only=True)
class Chapter:
    """One study with its results and what was made of them."""

    study: Mapping[str, Any]
    table: Table
    snapshot: Mapping[str, Any]
    estimator: Estimator


def chapter(study: Mapping[str, Any], results: Path) -> Chapter:
    """Return the chapter of a study.

    Args:
        study: as `GET /v1/studies/{id}` describes it.
        results: its `results.csv`.

    Raises:
        ValueError: the table is not one of this study.
    """
    plan = plan_of(study)
    table = read_table(plan, results)
    state = EstimatorState(plan)
    state.take(table.results())
    return Chapter(study=study, table=table, snapshot=state.snapshot(), estimator=state.estimator())


def write_report(
    path: Path,
    chapters: Sequence[Chapter],
    output: str,
    units: Mapping[str, str],
    *,
    title: str,
    findings: Sequence[str] = (),
    folders: Mapping[str, Path] | None = None,
    surrogates: bool = False,
) -> list[Path]:
    """Write the page, and every figure into each of `folders`.

    Args:
        path: of the page, one HTML file without references to anything outside.
        chapters: the studies, in the order they are told.
        output: the output shown in the figures; tables show all.
        units: of factors and outputs by name; a name without a unit is left out.
        folders: by format, "png" or "pdf"; made if missing.
        surrogates: also fit functions to each study's runs, which takes some seconds.

    Returns:
        The files written, the page first.

    Raises:
        ValueError: a study has no such output.
        ModuleNotFoundError: surrogates were asked for without scikit-learn (extra `surrogate`).
    """
    sections, files = [], [path]
    # A factor has one colour in all chapters, also where an earlier one was fixed.
    palette = list(dict.fromkeys(name for one in chapters for name in one.table.plan.units))
    for number, one in enumerate(chapters, 1):
        drawn = curve_pictures(one.snapshot, units, palette)
        subject = Subject(
            table=one.table,
            snapshot=one.snapshot,
            estimator=one.estimator,
            output=output,
            unit=units.get(output, ""),
            factor_units=[units.get(name, "") for name in one.table.plan.factors],
            palette=palette,
        )
        if output not in one.snapshot.get("curves", {}):
            drawn = [*pictures(subject), *drawn]
        sections.append(_section(one, output, units, drawn, surrogates=surrogates))
        for kind, folder in (folders or {}).items():
            folder.mkdir(parents=True, exist_ok=True)
            for picture in drawn:
                files.append(folder / f"{number}-{one.table.plan.method}-{picture.name}.{kind}")
                # Without the date, so that the same study gives the same file.
                undated = {"CreationDate": None} if kind == "pdf" else {}
                picture.figure.savefig(files[-1], metadata=undated)
    page = render(
        "study.html",
        script="study.js",
        title=title,
        output=output,
        findings=findings,
        sections=sections,
        version=version("rehyb"),
    )
    path.write_text(page, encoding="utf-8")
    return files


def _section(
    chapter: Chapter,
    output: str,
    units: Mapping[str, str],
    drawn: list[Picture],
    *,
    surrogates: bool,
) -> dict[str, Any]:
    """Return what `templates/study.html` says of one study, in its order."""
    snapshot, unit = chapter.snapshot, units.get(output, "")
    names = [factor["name"] for factor in chapter.study["factors"]]
    own = {name: units.get(name, "") for name in names}
    single = {name: own.get(name, "") for name in chapter.table.plan.units}
    alarm = warning(snapshot)
    curves = {name: tables.curve(snapshot, name) for name in snapshot.get("curves", {})}
    beside: dict[str, list[Grid | str]] = {}
    if output not in curves:
        if snapshot["method"] == "morris":
            beside["Per unit of each factor"] = [tables.per_unit(snapshot, output, unit, single)]
        if "second_order" in snapshot["outputs"][output]:
            beside["Pairs of factors"] = [tables.pairs(snapshot, output)]
    others = [block for name, blocks in curves.items() for block in blocks[name == output :]]
    if others:
        beside["Whole curves"] = others
    behind: dict[str, list[Grid | str]] = {
        "Every other output": [
            tables.indices(snapshot, name, units.get(name, ""))
            for name in snapshot["outputs"]
            if name != output
        ],
        "Other estimators on the same runs": [] if output in curves else _compared(chapter, output),
        "Surrogates on the same runs": _surrogate(chapter, output) if surrogates else [],
        "Failures": tables.failures(snapshot) if snapshot["failure"]["failed"] else [],
    }
    return {
        "title": _METHODS[chapter.study["method"]],
        "warning": alarm,
        "remarks": [sentence for sentence in remarks(snapshot, output) if sentence != alarm],
        "indices": curves[output][0]
        if output in curves
        else tables.indices(snapshot, output, unit),
        # What can be opened below the indices, and below the pictures.
        "beside": beside,
        "pictures": drawn,
        "behind": {title: blocks for title, blocks in behind.items() if blocks},
        "facts": _facts(chapter),
        "sampled": tables.sampled(chapter.study["factors"], own),
        # No figure of a curve shows single runs.
        "runs": {"columns": [], "runs": []}
        if output in curves
        else hover.runs_table(chapter.table, output),
    }


def _facts(chapter: Chapter) -> dict[str, str]:
    study, snapshot = chapter.study, chapter.snapshot
    evaluations = snapshot["evaluations"]
    runs = sum(evaluations.values())
    facts = {
        "study": f"{study['name']} ({study['id']})",
        "model": study["model"],
        "design": f"{study['method']}, {study['sampling']}, seed {study['seed']}",
        "rows": f"{snapshot['rows_complete']:,} of {snapshot['rows']:,} complete, "
        f"{snapshot['rows_used']:,} used",
        "runs": f"{runs:,}: " + ", ".join(f"{n:,} {cause}" for cause, n in evaluations.items()),
        "fixed": ", ".join(f"{name} = {value:g}" for name, value in study["fixed"].items()),
    }
    return {name: value for name, value in facts.items() if value}


def _compared(chapter: Chapter, output: str) -> list[Grid | str]:
    method = chapter.table.plan.method
    if family(method) != "saltelli" or method in SINGLE_POINTS:
        return []
    found = zip(*uncentred(chapter.table.by_row(output)), strict=True)
    plain = dict(zip(chapter.table.plan.units, found, strict=True))
    return tables.compared(chapter.snapshot, output, plain)


def _surrogate(chapter: Chapter, output: str) -> list[Grid | str]:
    """Return what fitted functions say, or why they cannot."""
    from analysis.sensitivity.surrogate import answer

    try:
        return tables.surrogate(chapter.snapshot, answer(chapter.table, output))
    except ValueError as error:
        return [f"There is no surrogate: {error}."]
