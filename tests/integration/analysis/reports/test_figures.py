"""What the figures promise: a picture of any snapshot, also of an empty or a failed one."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.reports.figures import (
    campaign_figure,
    convergence_figure,
    distribution_figure,
    pairs_figure,
    scatter_figure,
    screening_figure,
    variance_figure,
)
from analysis.reports.figures.scatter import bin_means
from analysis.reports.figures.style import COLOURS
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
    for figure in (
        screening_figure(phase1, "y", "Nm/rad"),
        variance_figure(phase2, "y"),
        convergence_figure(phase1, "y", "Nm/rad"),
        convergence_figure(phase2, "y"),
        campaign_figure(phase1, phase2, "y", "Nm/rad"),
    ):
        figure.savefig(tmp_path / "figure.png", dpi=40)
        assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")


def test_the_unit_and_the_failures_are_written_in_the_picture(tmp_path: Path) -> None:
    phase1, phase2 = snapshots(12, [(0, 0), (3, 1)])
    campaign_figure(phase1, phase2, "y", "Nm/rad").savefig(tmp_path / "campaign.svg")
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
    whole, rest = (convergence_figure(shot, "y", palette=p) for p in (["a", "b", "c"], ["b", "c"]))
    assert [line.get_color() for line in whole.axes[0].lines[:2]] == list(COLOURS[1:3])
    assert [line.get_color() for line in rest.axes[0].lines[:2]] == list(COLOURS[:2])


def test_wide_bands_of_the_first_rows_do_not_hide_the_lines() -> None:
    plan = study_plan("saltelli", 40)
    shot = analyse(plan, results_of(plan))
    for curve in shot["outputs"]["y"]["convergence"]["factors"].values():
        curve["total_order"]["high"][0] = 99.0
    for axes in convergence_figure(shot, "y").axes:
        assert axes.get_ylim()[1] < 2.0


def test_intervals_and_clouds_of_a_screening_have_the_same_axes() -> None:
    plan = study_plan("morris", 12)
    clouds = np.random.default_rng(3).random((2, 50, 3)) * [[[9.0]], [[0.1]]]
    left, right = screening_figure(analyse(plan, results_of(plan)), "y", clouds=clouds).axes
    assert left.get_xlim() == right.get_xlim() and left.get_ylim() == right.get_ylim()
    assert left.get_xlim()[1] > 8.9


def test_a_figure_refuses_the_wrong_method_or_output() -> None:
    phase1, phase2 = snapshots(2, [])
    with pytest.raises(ValueError, match="shows studies of method morris, not saltelli"):
        screening_figure(phase2, "y")
    with pytest.raises(ValueError, match="shows studies of method saltelli, not morris"):
        variance_figure(phase1, "y")
    with pytest.raises(ValueError, match="has no output 'w': it has y, z"):
        campaign_figure(phase1, phase2, "w")


@pytest.mark.parametrize("runs", [0, 1, 2, 300])
def test_samples_of_any_number_can_be_drawn(runs: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    points, names = rng.random((runs, 4)), ["a", "b", "c", "d"]
    values = points @ [1.0, 2.0, 0.0, 4.0]
    for figure in (
        distribution_figure(values, "y", "N"),
        scatter_figure(points, values, names, "y", "N", ["m", "", "kg", "N/m"]),
        pairs_figure(points, values, names, ["d", "b", "a"], "y", "N"),
        pairs_figure(points[:, :1], values, ["a"], ["a"], "y"),
    ):
        figure.savefig(tmp_path / "figure.png", dpi=40)
        assert (tmp_path / "figure.png").stat().st_size > 0


def test_bins_are_of_equal_width_and_hold_the_mean_of_what_lies_in_them() -> None:
    centres, means = bin_means(np.array([0.0, 0.05, 0.5, 1.0]), np.array([1.0, 3.0, 7.0, 9.0]))
    np.testing.assert_allclose(centres, [0.05, 0.55, 0.95])
    np.testing.assert_allclose(means, [2.0, 7.0, 9.0])
