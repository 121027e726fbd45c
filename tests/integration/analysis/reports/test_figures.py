"""What the figures promise: a picture of any snapshot, also of an empty or a failed one."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.reports import hover
from analysis.reports.figures import (
    Figure,
    bars,
    campaign,
    convergence,
    distribution,
    pairs,
    plane,
    scatter,
    together,
)
from analysis.reports.figures.scatter import bin_means
from analysis.reports.figures.shared import COLOURS, beside, figure
from analysis.reports.html import data_uri
from analysis.reports.paper import on_paper
from analysis.sensitivity.service import analyse
from analysis.sensitivity.snapshot import empty_snapshot
from tests.testbed.studies import results_of, study_plan

pytestmark = pytest.mark.usefixtures("without_layout")


def snapshots(rows: int, failed: list[tuple[int, int]]) -> tuple[dict[str, Any], dict[str, Any]]:
    plans = [study_plan(method, rows) for method in ("morris", "saltelli")]
    first, second = (analyse(plan, results_of(plan, failed=failed)) for plan in plans)
    return first, second


@pytest.mark.parametrize("case", ["whole", "failing", "one row", "empty"])
def test_every_state_of_a_study_can_be_drawn(case: str, tmp_path: Path) -> None:
    phase1, phase2 = {
        "whole": lambda: snapshots(12, []),
        "failing": lambda: snapshots(12, [(0, 0), (3, 1), (5, 2)]),
        "one row": lambda: snapshots(1, []),
        "empty": lambda: tuple(empty_snapshot(study_plan(m, 3)) for m in ("morris", "saltelli")),
    }[case]()
    for shown in (
        plane(phase1, "y", "Nm/rad"),
        bars(phase2, "y"),
        convergence(phase1, "y", "Nm/rad"),
        convergence(phase2, "y"),
        campaign(phase1, phase2, "y", "Nm/rad"),
    ):
        json.dumps(shown, allow_nan=False)
        on_paper(shown).savefig(tmp_path / "figure.png", dpi=40)
        assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")


def test_the_unit_and_the_failures_are_written_in_the_picture(tmp_path: Path) -> None:
    phase1, phase2 = snapshots(12, [(0, 0), (3, 1)])
    drawn = on_paper(campaign(phase1, phase2, "y", "Nm/rad"))
    drawn.savefig(tmp_path / "campaign.svg")
    picture = (tmp_path / "campaign.svg").read_text()
    for text in (
        "(Nm/rad per whole range)",
        "diverged",
        "phase 1: 2 of 48",
        "phase 2: 2 of 60",
        "90 % intervals",
    ):
        assert f"<!-- {text}" in picture or text in picture


def test_a_factor_keeps_its_colour_where_another_was_fixed() -> None:
    plan = study_plan("saltelli", 12)
    shot = analyse(plan, results_of(plan))
    for entry in (shot["outputs"]["y"], shot["outputs"]["y"]["convergence"]):
        del entry["factors"]["a"]
    for palette, own in ((["a", "b", "c"], COLOURS[1:3]), (["b", "c"], COLOURS[:2])):
        drawn = on_paper(convergence(shot, "y", palette=palette))
        lines = {line.get_label(): line.get_color() for line in drawn.axes[0].lines}
        assert {name: lines[name] for name in "bc"} == dict(zip("bc", own, strict=True))


def test_wide_bands_of_the_first_rows_do_not_hide_the_lines() -> None:
    plan = study_plan("saltelli", 40)
    shot = analyse(plan, results_of(plan))
    for curve in shot["outputs"]["y"]["convergence"]["factors"].values():
        curve["total_order"]["high"][0] = 99.0
    for axes in on_paper(convergence(shot, "y")).axes:
        assert axes.get_ylim()[1] < 2.0


def test_intervals_and_clouds_of_a_screening_have_the_same_axes() -> None:
    plan = study_plan("morris", 12)
    clouds = np.random.default_rng(3).random((2, 50, 3)) * [[[9.0]], [[0.1]]]
    left, right = on_paper(plane(analyse(plan, results_of(plan)), "y", clouds=clouds)).axes
    assert left.get_xlim() == right.get_xlim() and left.get_ylim() == right.get_ylim()
    assert left.get_xlim()[1] > 8.9


def test_a_figure_refuses_the_wrong_method_or_output() -> None:
    phase1, phase2 = snapshots(2, [])
    with pytest.raises(ValueError, match="shows studies of method morris, not saltelli"):
        plane(phase2, "y")
    with pytest.raises(ValueError, match="shows studies of method saltelli, not morris"):
        campaign(phase1, phase1, "y")
    with pytest.raises(ValueError, match="has no output 'w': it has y, z"):
        campaign(phase1, phase2, "w")


@pytest.mark.parametrize("runs", [0, 1, 2, 300])
def test_samples_of_any_number_can_be_drawn(runs: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    points, names = rng.random((runs, 4)), ["a", "b", "c", "d"]
    values = points @ [1.0, 2.0, 0.0, 4.0]
    for shown in (
        distribution(values, "y", "N"),
        scatter(points, values, names, "y", "N", ["m", "", "kg", "N/m"]),
        pairs(points, values, names, ["d", "b", "a"], "y", "N"),
        pairs(points[:, :1], values, ["a"], ["a"], "y"),
    ):
        json.dumps(shown, allow_nan=False)
        on_paper(shown).savefig(tmp_path / "figure.png", dpi=40)
        assert (tmp_path / "figure.png").stat().st_size > 0


def test_bins_are_of_equal_width_and_hold_the_mean_of_what_lies_in_them() -> None:
    centres, means = bin_means(np.array([0.0, 0.05, 0.5, 1.0]), np.array([1.0, 3.0, 7.0, 9.0]))
    np.testing.assert_allclose(centres, [0.05, 0.55, 0.95])
    np.testing.assert_allclose(means, [2.0, 7.0, 9.0])


def test_a_trace_that_is_not_known_is_refused_and_a_name_is_no_formula() -> None:
    with pytest.raises(ValueError, match="no violin is drawn on paper"):
        on_paper(figure([{"type": "violin"}], 300, xaxis={}, yaxis={}))
    line = {"type": "scatter", "mode": "lines", "name": "$x_1$ &lt;b&gt;", "x": [1], "y": [2]}
    drawn = on_paper(figure([line], 300, xaxis={"title": {"text": "$\\alpha$"}}, yaxis={}))
    (axes,) = drawn.axes
    assert axes.get_xlabel() == r"\$\alpha\$"
    assert axes.get_legend_handles_labels()[1] == [r"\$x_1\$ <b>"]


def test_panels_stand_beside_each_other_each_with_what_is_its_own() -> None:
    plan = study_plan("morris", 12)
    one = plane(analyse(plan, results_of(plan)), "y")
    both: Figure = beside([one, one, one], columns=2)
    assert both["layout"]["grid"]["rows"] == both["layout"]["grid"]["columns"] == 2
    assert {trace["xaxis"] + trace["yaxis"] for trace in both["data"]} == {"xy", "x2y2", "x3y3"}
    assert [shape["xref"] for shape in both["layout"]["shapes"]] == ["x", "x2", "x3"]
    assert [shape["yref"] for shape in both["layout"]["shapes"]] == [
        "y domain",
        "y2 domain",
        "y3 domain",
    ]
    drawn = on_paper(both)
    assert [len(axes.lines) for axes in drawn.axes[:3]] == [len(drawn.axes[0].lines)] * 3
    assert not drawn.axes[3].axison


@pytest.mark.parametrize("kind", ["svg", "png"])
def test_the_same_figure_is_the_same_image(kind: str) -> None:
    once, again = (
        data_uri(on_paper(distribution(np.arange(9.0), "y")), kind, dpi=30)  # type: ignore[arg-type]
        for _ in range(2)
    )
    assert once == again and once.startswith(f"data:image/{kind}")


@pytest.mark.parametrize("rows", [0, 1, 40])
def test_pairs_are_drawn_with_their_convergence_and_told_at_the_pointer(rows: int) -> None:
    plan = study_plan("saltelli_second_order", rows=max(rows, 1))
    shot = analyse(plan, results_of(plan)) if rows else empty_snapshot(plan)
    shown = together(shot, "y")
    figure = on_paper(shown)
    figure.draw_without_rendering()
    bars, curves = figure.axes
    panel, _ = hover.panels(shown, figure)
    known = [pair for pair in shot["outputs"]["y"]["second_order"] if pair["value"] is not None]
    assert len(bars.patches) == len(panel["marks"]) == len(known)
    if rows == 40:
        # The largest on top: a and b, whose product is in the output.
        assert bars.get_yticklabels()[0].get_text() == "a × b" and bars.yaxis_inverted()
        assert panel["marks"][0][2].startswith("a and b: ")
        assert curves.lines[0].get_label() == "a × b"
    with pytest.raises(ValueError, match="shows studies of method saltelli, not morris"):
        together(empty_snapshot(study_plan("morris", rows=3)), "y")
