"""What a report promises: one file, nothing from outside, the coordinator's numbers, any state."""

import base64
import csv
import hashlib
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from analysis.designs import METHODS, instance_parameters
from analysis.files.results_csv import read_table
from analysis.reports.report import Units, chapter, write_report
from analysis.sensitivity.records import LoggedResult, StudyPlan
from analysis.sensitivity.service import analyse
from tests.testbed.studies import FACTORS, results_of, study_plan

UNITS = Units(factors={"a": "m"}, outputs={"y": "Nm/rad"})
FAILED = [(0, 1), (4, 0), (7, 3)]


def described(plan: StudyPlan) -> dict[str, Any]:
    """Return the study as a coordinator shows it."""
    return {
        "id": plan.id,
        "name": "a <study> & more",
        "model": "two_outputs",
        "method": plan.method,
        "sampling": plan.sampling,
        "rows": plan.rows,
        "seed": plan.seed,
        "factors": [{"name": name, "distribution": d.to_json()} for name, d in FACTORS.items()],
        "fixed": {"d": 0.5},
        "outputs": list(plan.outputs),
    }


def write_table(path: Path, plan: StudyPlan, results: list[LoggedResult]) -> Path:
    """Write results as a coordinator does."""
    with path.open("w", newline="") as file:
        lines = csv.writer(file, lineterminator="\n")
        lines.writerow(["row", "position", *FACTORS, "outcome", *plan.outputs, "wall_seconds"])
        for result in results:
            point = instance_parameters(plan.method, plan.sampling, plan.seed, result.row, FACTORS)[
                result.position
            ]
            outputs = [result.outputs.get(name) for name in plan.outputs]
            lines.writerow(
                [result.row, result.position, *point.values(), result.outcome, *outputs, 0.1]
            )
    return path


class Outline(HTMLParser):
    """Every tag's attributes, and whether each tag that opened has closed."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.words = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.attributes += attrs
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words += data


@pytest.mark.parametrize("method", METHODS)
def test_a_report_holds_every_figure_of_its_method_and_nothing_from_outside(
    method: str, tmp_path: Path
) -> None:
    plan = study_plan(method, rows=16)
    table = write_table(tmp_path / "r.csv", plan, results_of(plan, failed=FAILED))
    one = chapter(described(plan), table)
    files = write_report(
        tmp_path / "r.html",
        [one],
        "y",
        UNITS,
        title="T",
        findings=["F < G"],
        folders={"png": tmp_path / "p", "pdf": tmp_path / "q"},
    )
    text = (tmp_path / "r.html").read_text()
    outline = Outline()
    outline.feed(text)
    assert outline.open == []
    sources = [value or "" for name, value in outline.attributes if name == "src"]
    assert len(sources) == (6 if method == "saltelli_second_order" else 5)
    assert all(source.startswith("data:image/svg+xml;base64,") for source in sources)
    assert not [name for name, _ in outline.attributes if name == "href"]
    assert "url(" not in text and "@import" not in text
    # The browser is told to run one script, ours, and to load nothing.
    assert dict(outline.attributes)["content"] == "width=device-width, initial-scale=1"
    policy = next(value for _, value in outline.attributes if value and "default-src" in value)
    assert policy.startswith("default-src 'none'; img-src data:; style-src 'unsafe-inline'; script")
    scripts = re.findall(r"<script(.*?)>(.*?)</script>", text, re.DOTALL)
    assert [kind for kind, _ in scripts] == [' type="application/json" class="runs"', ""]
    digest = base64.b64encode(hashlib.sha256(scripts[1][1].encode()).digest()).decode()
    assert policy.endswith(f"script-src 'sha256-{digest}'")
    first = ["plane" if method == "morris" else "shares"]
    first += ["together"] if method == "saltelli_second_order" else []
    assert [file.name for file in files] == [
        "r.html",
        *(
            f"1-{method}-{name}.{kind}"
            for kind in ("png", "pdf")
            for name in (*first, "convergence", "distribution", "scatter", "pairs")
        ),
    ]
    assert all(file.stat().st_size > 5000 for file in files)
    for words in ("F < G", "a <study> & more", "3 diverged", "d = 0.5", "uniform: low -1, high 1"):
        assert words in outline.words, words
    assert ("Martinez 2011" in outline.words) == (method != "morris")
    assert ("Pairs of factors" in outline.words) == (method == "saltelli_second_order")
    for words in ("per whole range of the factor", "Per unit of each factor", "Nm/rad per m"):
        assert (words in outline.words) == (method == "morris"), words


@pytest.mark.parametrize("method", METHODS)
def test_numbers_are_those_of_the_coordinator_bit_for_bit(method: str, tmp_path: Path) -> None:
    plan = study_plan(method, rows=16)
    results = results_of(plan, failed=FAILED)
    one = chapter(described(plan), write_table(tmp_path / "r.csv", plan, results))
    assert one.snapshot == analyse(plan, results)


def test_the_same_study_gives_the_same_page(tmp_path: Path) -> None:
    plan = study_plan("saltelli", rows=8)
    table = write_table(tmp_path / "r.csv", plan, results_of(plan))
    written = []
    for name in ("a", "b"):
        one = chapter(described(plan), table)
        folders = {"pdf": tmp_path / name}
        page = tmp_path / f"{name}.html"
        files = write_report(page, [one], "y", UNITS, title="T", folders=folders)
        written.append([file.read_bytes() for file in files])
    assert written[0] == written[1]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("rows", [0, 3])
def test_a_study_that_has_hardly_begun_or_only_failed_has_a_report_too(
    method: str, rows: int, tmp_path: Path
) -> None:
    plan = study_plan(method, rows=4)
    broken = [(row, position) for row in range(4) for position in range(5)]
    results = [r for r in results_of(plan, failed=broken) if r.row < rows]
    one = chapter(described(plan), write_table(tmp_path / "r.csv", plan, results))
    write_report(tmp_path / "r.html", [one], "z", UNITS, title="T")
    assert f"{rows} of 4 complete, 0 used" in (tmp_path / "r.html").read_text()


def test_failures_that_depend_on_the_factors_are_a_banner(tmp_path: Path) -> None:
    plan = study_plan("saltelli", rows=64)
    failed = [
        (r.row, r.position)
        for r in results_of(plan, lambda x: {"y": x["b"], "z": 0.0})
        if r.outputs["y"] > 1.5
    ]
    table = write_table(tmp_path / "r.csv", plan, results_of(plan, failed=failed))
    write_report(tmp_path / "r.html", [chapter(described(plan), table)], "y", UNITS, title="T")
    banner = re.search(r'<div class="card warning"><p>(.*?)</p>', (tmp_path / "r.html").read_text())
    assert banner is not None and "failures depend on the factors: b." in banner[1]


def test_surrogates_stand_in_a_report_where_asked_or_say_why_not(tmp_path: Path) -> None:
    plan = study_plan("saltelli", rows=16)
    one = chapter(described(plan), write_table(tmp_path / "r.csv", plan, results_of(plan)))
    write_report(tmp_path / "r.html", [one], "y", UNITS, title="T", surrogates=True)
    text = (tmp_path / "r.html").read_text()
    assert "Surrogates on the same runs" in text and "polynomial chaos: S, ST" in text
    assert "Fitted to 80 runs" in text
    few = study_plan("saltelli", rows=2)
    table = write_table(tmp_path / "f.csv", few, results_of(few))
    one = chapter(described(few), table)
    write_report(tmp_path / "f.html", [one], "y", UNITS, title="T", surrogates=True)
    assert "There is no surrogate: a surrogate needs 15 runs" in (tmp_path / "f.html").read_text()


def test_points_that_stand_for_the_distributions_are_a_and_b_of_a_saltelli_row(
    tmp_path: Path,
) -> None:
    for method, per_row in (("saltelli", 2), ("morris", 4)):
        plan = study_plan(method, rows=6)
        path = write_table(tmp_path / "r.csv", plan, results_of(plan, failed=[(2, 0)]))
        points, values = read_table(plan, path).sample("z")
        assert points.shape == (6 * per_row - 1, 3)
        assert values.tolist() == [1e4 + 1e-3 * b**2 for b in points[:, 1]]


def test_a_table_of_another_study_is_refused(tmp_path: Path) -> None:
    plan = study_plan("morris", rows=2)
    (tmp_path / "r.csv").write_text("row,position,a,b,outcome,y\n")
    with pytest.raises(ValueError, match="is no table of study study: no c, z"):
        chapter(described(plan), tmp_path / "r.csv")
