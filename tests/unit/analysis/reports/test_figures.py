"""Figures for plotly.js: JSON of the study's own numbers, and nothing of its names as markup."""

import json
from typing import Any

import numpy as np
import pytest

from analysis.reports.figures import (
    bars,
    comparison,
    convergence,
    failures,
    parallel,
    plane,
    precision,
)
from analysis.reports.figures.distribution import distribution
from analysis.reports.figures.shared import COLOURS, plain
from analysis.sensitivity.judgement.stopping import advise
from analysis.sensitivity.service import analyse
from analysis.sensitivity.snapshot import empty_snapshot
from tests.testbed.studies import results_of, study_plan


@pytest.fixture(scope="module", params=["morris", "saltelli"])
def snapshot(request: pytest.FixtureRequest) -> dict[str, Any]:
    plan = study_plan(request.param, 32)
    return analyse(plan, results_of(plan))


def figures(snapshot: dict[str, Any]) -> dict[str, Any]:
    advice = advise(snapshot, "y")
    return {
        "bars": bars(snapshot, "y", "m"),
        "plane": plane(snapshot, "y", "m") if snapshot["method"] == "morris" else None,
        "convergence": convergence(snapshot, "y", "m"),
        "precision": precision(snapshot, "y", advice),
    }


def test_every_figure_is_plain_json_and_has_its_numbers_as_a_table(
    snapshot: dict[str, Any],
) -> None:
    drawn = figures(snapshot)
    assert (drawn.pop("plane") is None) == (snapshot["method"] != "morris")
    for name, figure in drawn.items():
        assert json.loads(json.dumps(figure, allow_nan=False)) == json.loads(json.dumps(figure))
        head, rows = figure["table"]["head"], figure["table"]["rows"]
        assert rows and {len(row) for row in rows} == {len(head)}, name


def test_bars_are_the_snapshot_s_indices_the_most_influential_first(
    snapshot: dict[str, Any],
) -> None:
    figure = bars(snapshot, "y", "m")
    assert figure is not None
    first, second = figure["data"]
    index = {"morris": "mu_star", "saltelli": "total_order"}[snapshot["method"]]
    shown = first if index == "mu_star" else second
    factors = snapshot["outputs"]["y"]["factors"]
    assert shown["x"] == [factors[name][index]["value"] for name in shown["customdata"]]
    assert shown["x"] == sorted(shown["x"], reverse=True)
    low = factors[shown["customdata"][0]][index]["low"]
    assert shown["x"][0] - shown["error_x"]["arrayminus"][0] == pytest.approx(low)


def test_the_precision_has_the_wanted_one_and_the_rows_at_which_it_is_expected(
    snapshot: dict[str, Any],
) -> None:
    advice = advise(snapshot, "y", 0.01)
    assert advice is not None and advice.more_rows
    figure = precision(snapshot, "y", advice)
    assert figure is not None
    expected = figure["data"][-1]
    assert expected["x"] == [32, 32 + advice.more_rows]
    assert expected["y"] == [advice.half_width, 0.01]
    assert figure["layout"]["shapes"][0]["y1"] == 0.01


def test_a_factor_has_one_colour_in_all_figures(snapshot: dict[str, Any]) -> None:
    drawn = figures(snapshot)
    for name in ("convergence", "precision"):
        lines = {t["name"]: t["line"]["color"] for t in drawn[name]["data"] if "customdata" in t}
        assert lines == dict(zip("abc", COLOURS, strict=False)), name


@pytest.mark.parametrize("method", ["morris", "saltelli"])
def test_before_there_is_anything_there_is_no_figure(method: str) -> None:
    empty = empty_snapshot(study_plan(method, 4))
    assert [figure["data"] for figure in figures(empty).values() if figure] == [
        [] for figure in figures(empty).values() if figure
    ]
    assert figures(empty)["precision"] is None


def test_a_unit_is_no_markup() -> None:
    plan = study_plan("morris", 8)
    unit = '<a href="x">&lt;'
    text = json.dumps(bars(analyse(plan, results_of(plan)), "y", unit))
    assert "<a" not in text and "&lt;a href" in text
    assert plain("&lt;") == "&amp;lt;"


def test_a_snapshot_of_an_earlier_version_is_drawn_as_far_as_it_goes(
    snapshot: dict[str, Any],
) -> None:
    output = snapshot["outputs"]["y"]
    lacking = ("convergence", "screening", "trust")
    old = {name: value for name, value in output.items() if name not in lacking}
    drawn = figures({**snapshot, "outputs": {"y": old}})
    assert drawn["bars"]["data"] and drawn["precision"] is None
    assert drawn["convergence"]["data"] == []


def test_a_plot_of_failures_says_how_many_of_how_many_it_shows() -> None:
    points = [{"a": 0.1, "b": 0.2}]
    found = failures(points, {"diverged": points * 2}, "a", "b", {"ok": 1234, "diverged": 5})
    assert found is not None
    names = [trace["name"] for trace in found["data"] if "name" in trace]
    assert names == ["ok, 1 of 1,234", "diverged, 2 of 5"]


def test_lines_of_runs_are_coloured_by_their_output_and_as_many_of_each_colour() -> None:
    points = np.array([[i, (7 * i) % 20] for i in range(20)], dtype=float)
    figure = parallel(points, points[:, 0] ** 2, ["a", "b"], "y")
    assert [trace["name"] for trace in figure["data"]] == [
        "0 to 9",
        "16 to 49",
        "64 to 121",
        "144 to 225",
        "256 to 361",
    ]
    largest = figure["data"][-1]
    # Four runs of three numbers, with a gap behind each; the largest a is at the top.
    assert len(largest["y"]) == 16 and largest["y"][3] is None and max(largest["y"][::4]) == 1.0
    assert parallel(points, np.ones(20), ["a", "b"], "y")["data"] == []
    assert parallel(points[:0], np.ones(0), ["a", "b"], "y")["data"] == []


def test_two_studies_have_their_bars_at_the_same_place_and_no_two_kinds_of_index() -> None:
    one, other = (
        analyse(plan, results_of(plan))
        for plan in (study_plan("saltelli", 16), study_plan("saltelli", 16, seed=8))
    )
    figure = comparison((one, other), ("<a>", "b"), "y")
    first, second, *_ = figure["data"]
    assert first["y"] == second["y"] and first["name"] == "&lt;a&gt;"
    ranked = [text.split("<br>")[1].split(":")[0] for text in first["hovertext"]]
    shown = [one["outputs"]["y"]["factors"][name]["first_order"]["value"] for name in ranked]
    assert first["x"] == shown
    plan = study_plan("morris", 4)
    with pytest.raises(ValueError, match="indices of saltelli and of morris are not of one kind"):
        comparison((one, analyse(plan, results_of(plan))), ("a", "b"), "y")


@pytest.mark.parametrize(
    ("values", "drawn"),
    [
        ([1.0] * 39 + [1.0 + 2.3e-16], False),
        ([1e-200, 2e-200, 3e-200], False),
        ([3.0], False),
        ([1e6 + 1e-3 * number for number in range(9)], True),
    ],
)
def test_what_differs_in_its_last_digits_has_no_histogram_and_no_error(
    values: list[float], drawn: bool
) -> None:
    assert bool(distribution(np.array(values), "y")["data"]) is drawn
