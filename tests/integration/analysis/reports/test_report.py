"""What a report promises: one file, nothing from outside, the coordinator's numbers, any state."""

import base64
import hashlib
import re
from dataclasses import dataclass, replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from analysis.designs import METHODS, row_width
from analysis.files.results_csv import read_table
from analysis.reports.report import Chapter, chapter, write_report
from analysis.sensitivity.records import LoggedResult, StudyPlan
from analysis.sensitivity.service import analyse
from tests.testbed.studies import FACTORS, described, results_of, study_plan, write_table

pytestmark = pytest.mark.usefixtures("without_layout")

UNITS = {"a": "m", "y": "Nm/rad"}
FAILED = [(0, 1), (4, 0), (7, 3)]


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


@dataclass(frozen=True, kw_only=True)
class Written:
    """A report that was written, and what of."""

    plan: StudyPlan
    results: list[LoggedResult]
    chapter: Chapter
    files: list[Path]

    #: Of the figures' files. PDF takes long, so one method's will do.
    @property
    def kinds(self) -> list[str]:
        return ["png", "pdf"] if self.plan.method == "saltelli" else ["png"]

    def again(self, folder: Path) -> list[Path]:
        """Write it into another folder."""
        return write_report(
            folder / "r.html",
            [self.chapter],
            "y",
            UNITS,
            title="T",
            findings=["F < G"],
            folders={kind: folder / kind for kind in self.kinds},
        )


@pytest.fixture(scope="module", params=METHODS)
def written(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Written:
    """A report of each method, written once for all tests."""
    folder = tmp_path_factory.mktemp(request.param)
    plan = study_plan(request.param, rows=16)
    results = results_of(plan, failed=FAILED)
    one = chapter(described(plan), write_table(folder / "r.csv", plan, results))
    first = Written(plan=plan, results=results, chapter=one, files=[])
    return replace(first, files=first.again(folder))


def test_a_report_holds_every_figure_of_its_method_and_nothing_from_outside(
    written: Written,
) -> None:
    method, files = written.plan.method, written.files
    text = files[0].read_text()
    outline = Outline()
    outline.feed(text)
    assert outline.open == []
    sources = [value or "" for name, value in outline.attributes if name == "src"]
    # Pairs are shown as bars and as a map; a sample has no indices.
    assert len(sources) == {"saltelli_second_order": 7, "sample": 3}.get(method, 5)
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
    first = [{"morris": "plane", "shapley": "effects"}.get(method, "shares")]
    first += ["together", "interactions"] if method == "saltelli_second_order" else []
    first = [] if method == "sample" else [*first, "convergence"]
    assert [file.name for file in files] == [
        "r.html",
        *(
            f"1-{method}-{name}.{kind}"
            for kind in written.kinds
            for name in (*first, "distribution", "scatter", "pairs")
        ),
    ]
    assert all(file.stat().st_size > 5000 for file in files)
    width = row_width(method, len(FACTORS))
    diverged = sum(position < width for _, position in FAILED)
    for words in (
        "F < G",
        "a <study> & more",
        f"{diverged} diverged",
        "d = 0.5",
        "uniform: low -1, high 1",
    ):
        assert words in outline.words, words
    heads = re.findall(r"<th[^>]*>([^<]+)", text)
    assert ("standard deviation" in heads) == (method == "sample")
    assert ("Martinez 2011" in outline.words) == (method in ("saltelli", "saltelli_second_order"))
    assert ("Pairs of factors" in outline.words) == (method == "saltelli_second_order")
    for words in ("per whole range of the factor", "Per unit of each factor", "Nm/rad per m"):
        assert (words in outline.words) == (method == "morris"), words


def test_numbers_are_those_of_the_coordinator_bit_for_bit(written: Written) -> None:
    assert written.chapter.snapshot == analyse(written.plan, written.results)


@pytest.mark.parametrize("written", ["saltelli"], indirect=True)
def test_the_same_study_gives_the_same_page(written: Written, tmp_path: Path) -> None:
    again = written.again(tmp_path)
    assert [file.read_bytes() for file in again] == [file.read_bytes() for file in written.files]


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
