"""A report as a reader sees it, in a real browser: complete, quiet, and answering the pointer."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from analysis.designs import instance_parameters
from analysis.designs.distributions import Uniform
from analysis.reports.report import chapter, write_report
from sim.evaluation import evaluate
from tests.testbed.browser import launched, needs_browser

pytestmark = needs_browser

RANGES = {f"x{i}": Uniform(low=0.0, high=1.0) for i in range(1, 7)}


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of the two phases of a small study of Sobol's g-function."""
    folder, chapters = tmp_path_factory.mktemp("report"), []
    for method, rows in (("morris", 8), ("saltelli", 16)):
        lines = [",".join(["row,position", *RANGES, "outcome,y,wall_seconds,worker"])]
        for row in range(rows):
            points = instance_parameters(method, "sobol", 1, row, RANGES)
            for position, x in enumerate(points):
                failed = (row, position) == (2, 1)
                y = "" if failed else repr(evaluate("sobol_g", x).outputs["y"])
                cells = [row, position, *map(repr, x.values()), "slipped" if failed else "ok", y]
                lines.append(",".join(map(str, [*cells, 0.1, "pc"])))
        table = folder / f"{method}.csv"
        table.write_text("\n".join(lines) + "\n")
        study = {
            "id": method,
            "name": "</script> & more",
            "model": "sobol_g",
            "method": method,
            "sampling": "sobol",
            "rows": rows,
            "seed": 1,
            "factors": [{"name": n, "distribution": d.to_json()} for n, d in RANGES.items()],
            "fixed": {},
            "outputs": ["y"],
        }
        chapters.append(chapter(study, table))
    units = {}
    write_report(folder / "report.html", chapters, "y", units, title="Two phases")
    return folder / "report.html"


@pytest.fixture
def page(report: Path) -> Iterator[Any]:
    """The report in a browser that is offline; whatever it complained of must be nothing."""
    complaints: list[str] = []
    with launched() as browser:
        page = browser.new_page(viewport={"width": 1100, "height": 800})
        page.context.set_offline(True)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("console", lambda message: complaints.append(message.text))
        page.on("request", lambda request: _only_itself(request.url, complaints))
        page.goto(report.as_uri())
        yield page
    assert complaints == []


def _only_itself(url: str, complaints: list[str]) -> None:
    if not url.startswith(("data:", "file:")) or url.endswith(".js"):
        complaints.append(f"asked for {url}")


def point_at(page: Any, plot: int, panel: int, x: float, y: float) -> str:
    """Move the pointer to a value in a panel and return what is told there; "" if nothing."""
    at = page.evaluate(
        """([plot, panel, x, y]) => {
            const element = document.querySelectorAll("[data-panels]")[plot];
            element.scrollIntoView({block: "center"});
            const size = element.getBoundingClientRect();
            const [px, py] = place(JSON.parse(element.dataset.panels)[panel], size, x, y);
            return [size.left + px, size.top + py];
        }""",
        [plot, panel, x, y],
    )
    page.mouse.move(*at)
    tip = page.locator("#tip")
    return str(tip.inner_text()) if tip.is_visible() else ""


def test_every_figure_is_seen_and_nothing_is_wider_than_the_page(page: Any) -> None:
    images = page.evaluate(
        "[...document.images].map(i => [i.complete, i.naturalWidth > 0, i.clientWidth > 300])"
    )
    assert images == [[True, True, True]] * 10
    for width in (1100, 480):
        page.set_viewport_size({"width": width, "height": 800})
        assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_the_pointer_tells_values_and_shows_the_same_run_everywhere(page: Any) -> None:
    runs = page.evaluate("JSON.parse(document.querySelectorAll('script.runs')[1].textContent)")
    row, position, x1, *_, y = runs["runs"][7]
    # The second phase's scatter is the ninth figure.
    told = point_at(page, 8, 0, x1, y)
    assert told.splitlines()[0] == f"row {row}, position {position}"
    assert f"x1 {x1}" in told and f"y {y}" in told
    # In six panels of the scatter and three of pairs; none of the first phase.
    assert page.locator(".ring").count() == 9
    assert page.locator("section").nth(0).locator(".ring").count() == 0
    page.mouse.move(1, 1)
    assert page.locator(".ring").count() == 0 and not page.locator("#tip").is_visible()


def test_the_pointer_tells_indices_with_their_intervals(page: Any) -> None:
    marks = page.evaluate(
        "[...document.querySelectorAll('[data-panels]')].map(p => JSON.parse(p.dataset.panels))"
    )
    for plot, symbol in ((0, "μ*"), (1, "rows: μ*"), (5, "S "), (6, "rows: S")):
        x, y, text = marks[plot][0]["marks"][0]
        told = point_at(page, plot, 0, x, y)
        assert symbol in told and told.startswith("x"), (plot, told, text)


def test_a_table_is_sorted_by_the_column_that_is_clicked(page: Any) -> None:
    table = page.locator("section").nth(1).locator("table").first
    cells = "els => els.map(e => parseFloat(e.textContent))"

    def first_order() -> list[float]:
        return list(table.locator("tbody td:nth-child(2)").evaluate_all(cells))

    head = table.locator("th", has_text="S").first
    head.click()
    assert head.get_attribute("aria-sort") == "descending"
    assert first_order() == sorted(first_order(), reverse=True)
    head.click()
    assert first_order() == sorted(first_order())
    assert table.locator("tfoot td").first.inner_text() == "sum"
