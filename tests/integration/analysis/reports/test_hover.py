"""What is told at the pointer lies where the figure shows it, and names the run it is of."""

import re
from typing import Any

import numpy as np
import pytest

from analysis.reports import hover
from analysis.reports.figures import Figure, bars, convergence, pairs, plane, scatter
from analysis.reports.paper import on_paper
from analysis.sensitivity.service import analyse
from analysis.sensitivity.table import Table
from tests.testbed.studies import results_of, study_plan


def drawn(shown: Figure) -> tuple[Any, list[hover.Panel]]:
    figure = on_paper(shown)
    figure.draw_without_rendering()
    return figure, hover.panels(shown, figure)


def pixels(figure: Any, panel: hover.Panel, x: float, y: float) -> list[float]:
    """Return where the page puts a point, in the figure's own pixels, as page.js reckons it."""
    scale = np.log2 if panel["log"] else float
    (x0, x1), (y0, y1) = panel["x"], panel["y"]
    left, top, right, bottom = panel["box"]
    u = (scale(x) - scale(x0)) / (scale(x1) - scale(x0))
    v = (y - y0) / (y1 - y0)
    width, height = figure.get_size_inches() * figure.dpi
    return [(left + u * (right - left)) * width, (1.0 - bottom + v * (bottom - top)) * height]


def table_of(method: str, rows: int) -> Table:
    plan = study_plan(method, rows)
    results = results_of(plan, failed=[(1, 0)])
    rng = np.random.default_rng(2)
    return Table(
        plan=plan,
        rows=np.array([r.row for r in results]),
        positions=np.array([r.position for r in results]),
        outcomes=tuple(r.outcome for r in results),
        points=rng.random((len(results), 3)),
        values=np.array([[r.outputs.get(name, np.nan) for name in plan.outputs] for r in results]),
    )


def test_marks_of_indices_lie_on_their_points_and_tell_their_numbers() -> None:
    plan = study_plan("morris", 20)
    shot = analyse(plan, results_of(plan))
    figure, (panel,) = drawn(plane(shot, "y"))
    order = sorted("abc", key=lambda n: -shot["outputs"]["y"]["factors"][n]["mu_star"]["value"])
    assert order == [text.split(":")[0] for _, _, text in panel["marks"]]
    for x, y, _ in panel["marks"]:
        assert pixels(figure, panel, x, y) == pytest.approx(
            figure.axes[0].transData.transform((x, y)), abs=0.1
        )
    assert "μ* " in panel["marks"][0][2] and panel["marks"][0][2].endswith("n 20")


def test_marks_of_bars_and_of_convergence_lie_on_them() -> None:
    plan = study_plan("saltelli", 20)
    shot = analyse(plan, results_of(plan))
    figure, (panel,) = drawn(bars(shot, "y"))
    ends = {
        (round(bar.get_width(), 9), round(bar.get_center()[1], 9)) for bar in figure.axes[0].patches
    }
    assert {(round(x, 9), round(y, 9)) for x, y, _ in panel["marks"]} == ends
    figure, panels = drawn(convergence(shot, "y"))
    for axes, panel in zip(figure.axes, panels, strict=True):
        assert panel["log"]
        lines = [line for line in axes.lines if line.get_marker() != "None"]
        points = {(x, y) for line in lines for x, y in zip(*line.get_data(), strict=True)}
        assert {(x, y) for x, y, _ in panel["marks"]} == points
        x, y, text = panel["marks"][-1]
        assert re.match("[abc], 20 rows: S", text)
        assert pixels(figure, panel, x, y) == pytest.approx(
            axes.transData.transform((x, y)), abs=0.1
        )


@pytest.mark.parametrize("method", ["morris", "saltelli"])
def test_panels_of_runs_point_at_a_table_of_the_runs_that_are_drawn(method: str) -> None:
    table = table_of(method, rows=6)
    runs = hover.runs_table(table, "y")
    assert runs["columns"] == ["row", "position", "a", "b", "c", "y"]
    points, values = table.sample("y")
    assert [run[-1] for run in runs["runs"]] == [float(f"{value:.4g}") for value in values]
    failed = [run for run in runs["runs"] if run[:2] == [1, 0]]
    assert failed == []
    _, panels = drawn(scatter(points, values, table.plan.factors, "y"))
    assert [panel["runs"] for panel in panels] == [["a", "y"], ["b", "y"], ["c", "y"]]
    figure, panels = drawn(pairs(points, values, table.plan.factors, ["c", "a", "b"], "y"))
    assert [panel["runs"] for panel in panels] == [["c", "a"], ["c", "b"], ["a", "b"]]
    x, y = points[0, 2], points[0, 0]
    assert pixels(figure, panels[0], x, y) == pytest.approx(
        figure.axes[0].transData.transform((x, y)), abs=0.1
    )
