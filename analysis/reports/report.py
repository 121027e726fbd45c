"""One page that holds all there is to say of one study, or of the two phases of a campaign.

Everything is computed from the study's description and its table of results, so a report can be
made again from these two files alone, and its numbers are those of the coordinator bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from analysis.designs import family
from analysis.files.results_csv import read_table
from analysis.reports import hover
from analysis.reports.figures import (
    convergence_figure,
    distribution_figure,
    pairs_figure,
    scatter_figure,
    screening_figure,
    together_figure,
    variance_figure,
)
from analysis.reports.page import Picture, Section, page
from analysis.sensitivity.comparison import Compared, compare, rows_of
from analysis.sensitivity.records import plan_of
from analysis.sensitivity.remarks import remarks, warning
from analysis.sensitivity.study_state import StudyState
from analysis.sensitivity.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from analysis.sensitivity.estimators import Estimator
    from analysis.sensitivity.surrogate import Answer

_METHODS = {
    "morris": "Screening by elementary effects",
    "saltelli": "Variance-based indices",
    "saltelli_second_order": "Variance-based indices, also of pairs",
}
_PLANE = (
    "Left: mean magnitude and spread of the elementary effects with their intervals, each the "
    "effect of a factor's whole range; below the "
    "dotted line an effect is mostly monotonic and without interactions, left of the dashed one it "
    "is less than a tenth of the largest. Right: where bootstrap "
    "replicates put them. Near the origin a factor does little (paper, figure 8)."
)
_SHARES = (
    "Share of the output's variance due to a factor alone (S) and in company (ST), with intervals; "
    "ST near 0 means that the factor may take any value; left of the dashed line, a share of 0.05, "
    "it does too little to matter (paper, figure 10)."
)
_TOGETHER = (
    "Share of the output's variance that two factors have together beyond what each has alone "
    "(Saltelli 2002), the largest, and the same from growing parts of the sample."
)
_DISTRIBUTION = (
    "What the sampled uncertainty does to the output. Variance stands for uncertainty as far as "
    "this has one hump and little skew (paper, figure 9)."
)
_CONVERGENCE = (
    "The same indices from the first 8, 16, 32, ... rows. Bands are intervals, cut off where the "
    "first ones would dwarf the rest; lines that still move ask for more rows (paper, figure 11)."
)
_SCATTER = "Every run, and the mean of each tenth of a factor's range (paper, figure 12)."
_PAIRS = (
    "Two factors against each other, the output as colour. A pattern along a diagonal hints at an "
    "interaction (paper, figure 13)."
)


@dataclass(frozen=True, kw_only=True)
class Chapter:
    """One study with its results and what was made of them."""

    study: Mapping[str, Any]
    table: Table
    snapshot: Mapping[str, Any]
    estimator: Estimator


@dataclass(frozen=True, kw_only=True)
class Units:
    """Units by name, for axes; a name without a unit is left out."""

    factors: Mapping[str, str]
    outputs: Mapping[str, str]


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
    state = StudyState(plan)
    state.take(table.results())
    return Chapter(study=study, table=table, snapshot=state.snapshot(), estimator=state.estimator())


def pictures(
    chapter: Chapter, output: str, units: Units, palette: Sequence[str] = ()
) -> list[Picture]:
    """Return every figure of the paper that the study's method has, drawn.

    Args:
        chapter: the study.
        output: one of its outputs.
        units: for axes.
        palette: factors in the order of their colours; default: the study's.

    Raises:
        ValueError: the study has no such output.
    """
    plan, snapshot = chapter.table.plan, chapter.snapshot
    unit = units.outputs.get(output, "")
    own = [units.factors.get(name, "") for name in plan.factors]
    points, values = (
        chapter.table.sample(output) if output in plan.outputs else (np.empty((0, 0)), np.empty(0))
    )
    order = snapshot["outputs"][output]["ranking"]["order"] or list(plan.factors)
    if plan.method == "morris":
        first = _picture(
            "plane",
            "Elementary effects",
            _PLANE,
            screening_figure(snapshot, output, unit, _clouds(chapter, output), palette),
            lambda figure: hover.plane(figure, snapshot, output),
        )
    else:
        first = _picture(
            "shares",
            "Shares of the variance",
            _SHARES,
            variance_figure(snapshot, output, unit),
            lambda figure: hover.shares(figure, snapshot, output),
        )
    together = []
    if "second_order" in snapshot["outputs"][output]:
        together.append(
            _picture(
                "together",
                "Pairs of factors",
                _TOGETHER,
                together_figure(snapshot, output),
                lambda figure: hover.together(figure, snapshot, output),
            )
        )
    return [
        first,
        *together,
        _picture(
            "convergence",
            "Convergence",
            _CONVERGENCE,
            convergence_figure(snapshot, output, unit, palette),
            lambda figure: hover.convergence(figure, snapshot, output),
        ),
        _picture(
            "distribution",
            "Distribution of the output",
            _DISTRIBUTION,
            distribution_figure(values, output, unit),
            lambda figure: [],
        ),
        _picture(
            "scatter",
            "Output against each factor",
            _SCATTER,
            scatter_figure(points, values, plan.factors, output, unit, own),
            lambda figure: hover.scatter(figure, plan.factors, output),
        ),
        _picture(
            "pairs",
            "Pairs of the leading factors",
            _PAIRS,
            pairs_figure(points, values, plan.factors, order, output, unit, own),
            lambda figure: hover.pairs(figure, order),
        ),
    ]


def _picture(
    name: str,
    title: str,
    caption: str,
    figure: Figure,
    panels: Callable[[Figure], list[hover.Panel]],
) -> Picture:
    # Places of panels are settled when a figure is drawn, and not before.
    figure.draw_without_rendering()
    return Picture(name=name, title=title, caption=caption, figure=figure, panels=panels(figure))


def write_report(
    path: Path,
    chapters: Sequence[Chapter],
    output: str,
    units: Units,
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
        units: for axes and tables.
        title: of the page.
        findings: sentences for its top.
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
    palette = list(dict.fromkeys(name for one in chapters for name in one.table.plan.factors))
    for number, one in enumerate(chapters, 1):
        drawn = pictures(one, output, units, palette)
        section = _section(one, output, units, drawn)
        sections.append(
            replace(section, surrogate=_surrogate(one, output)) if surrogates else section
        )
        for kind, folder in (folders or {}).items():
            folder.mkdir(parents=True, exist_ok=True)
            for picture in drawn:
                files.append(folder / f"{number}-{one.table.plan.method}-{picture.name}.{kind}")
                # Without the date, so that the same study gives the same file.
                undated = {"CreationDate": None} if kind == "pdf" else {}
                picture.figure.savefig(files[-1], metadata=undated)
    partial = path.with_name(path.name + ".partial")
    partial.write_text(page(title, findings, sections), encoding="utf-8")
    partial.replace(path)
    return files


def _section(chapter: Chapter, output: str, units: Units, drawn: list[Picture]) -> Section:
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
    alarm = warning(snapshot)
    return Section(
        title=_METHODS[study["method"]],
        facts={name: value for name, value in facts.items() if value},
        warning=alarm,
        remarks=[sentence for sentence in remarks(snapshot, output) if sentence != alarm],
        sampled=[
            (
                factor["name"],
                _distribution(factor["distribution"]),
                units.factors.get(factor["name"], ""),
            )
            for factor in study["factors"]
        ],
        snapshot=snapshot,
        output=output,
        units=units.outputs,
        pictures=drawn,
        compared=_compared(chapter, output),
        runs=hover.runs_table(chapter.table, output),
    )


def _surrogate(chapter: Chapter, output: str) -> Answer | str:
    """Return what fitted functions say, or why they cannot."""
    from analysis.sensitivity.surrogate import answer

    try:
        return answer(chapter.table, output)
    except ValueError as error:
        return f"There is no surrogate: {error}."


def _compared(chapter: Chapter, output: str) -> Mapping[str, Compared]:
    if family(chapter.table.plan.method) != "saltelli":
        return {}
    return compare(rows_of(chapter.table, output), chapter.snapshot["level"])


def _clouds(chapter: Chapter, output: str) -> Any:
    """Return mu* and sigma of every replicate, shape (2, replicates, factors)."""
    statistics = chapter.estimator.statistics()
    o = chapter.table.plan.outputs.index(output) if output in chapter.table.plan.outputs else 0
    return np.stack([statistics[name].weighted[1:, o] for name in ("mu_star", "sigma")])


def _distribution(described: Mapping[str, Any]) -> str:
    parameters = ", ".join(
        f"{name} {' '.join(f'{number:g}' for number in np.atleast_1d(value))}"
        for name, value in described.items()
        if name != "kind"
    )
    return f"{described['kind'].replace('_', ' ')}: {parameters}"
