"""What is promised about failures: they have indices, and the reader learns what causes them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from scipy.stats import qmc

from analysis.designs import METHODS, SINGLE_POINTS, instance_parameters, unit_row, unit_rows
from analysis.designs.radial import MEAN_INVERSE_STEP, legs
from analysis.sensitivity.judgement.failures import FEWEST
from analysis.sensitivity.records import StudyPlan
from analysis.sensitivity.service import analyse
from tests.testbed.studies import FACTORS, results_of, study_plan, two_outputs

#: In rows that share coordinates a failed run has others to be compared with.
BY_ROWS = [method for method in METHODS if method not in SINGLE_POINTS]


def failing_where(plan: StudyPlan, condition: Any) -> list[tuple[int, int]]:
    """Return the places whose factor values meet a condition."""
    return [
        (row, position)
        for row in range(plan.rows)
        for position, point in enumerate(
            instance_parameters(plan.method, plan.sampling, plan.seed, row, FACTORS)
        )
        if condition(point)
    ]


@pytest.mark.parametrize("method", BY_ROWS)
def test_a_factor_that_makes_runs_fail_is_named_and_the_reader_warned(method: str) -> None:
    plan = study_plan(method, rows=128)
    failed = failing_where(plan, lambda x: x["b"] > 1.6)
    failure = analyse(plan, results_of(plan, failed=failed))["failure"]
    assert (failure["depends_on_factors"], failure["caused_by"]) == (True, ["b"])
    assert failure["failed"] == len(failed)
    assert failure["sentence"].startswith(f"{len(failed)} of {failure['runs']} runs failed (")
    assert "failures depend on the factors: b." in failure["sentence"]


@pytest.mark.parametrize("method", BY_ROWS)
def test_two_factors_that_fail_only_together_are_both_named(method: str) -> None:
    plan = study_plan(method, rows=256)
    failed = failing_where(plan, lambda x: (x["a"] > 0.0) == (x["b"] > 1.0) and x["c"] >= 10.0)
    failure = analyse(plan, results_of(plan, failed=failed))["failure"]
    assert failure["depends_on_factors"] is True
    assert set(failure["caused_by"]) == {"a", "b"}


@pytest.mark.parametrize("method", SINGLE_POINTS)
def test_single_points_do_not_tell_why_runs_fail(method: str) -> None:
    plan = study_plan(method, rows=64)
    failed = failing_where(plan, lambda x: x["b"] > 1.0)
    failure = analyse(plan, results_of(plan, failed=failed))["failure"]
    assert (failure["depends_on_factors"], failure["caused_by"]) == (None, [])
    assert failure["sentence"] == (
        "32 of 64 runs failed (50.0%): single points do not tell whether failures depend on the "
        "factors."
    )


def test_too_few_failures_are_counted_and_not_judged() -> None:
    plan = study_plan("saltelli", rows=20)
    failed = [(row, 1) for row in range(FEWEST - 1)]
    failure = analyse(plan, results_of(plan, failed=failed))["failure"]
    assert failure["depends_on_factors"] is None
    assert failure["sentence"] == (
        "19 of 100 runs failed (19.0%): too few to tell whether failures depend on the factors."
    )


def test_the_indicator_has_the_indices_of_an_output_that_is_1_where_runs_failed() -> None:
    """The oracle is a study whose output is the indicator itself."""
    plan = study_plan("saltelli", rows=64)

    def indicator(x: Mapping[str, float]) -> dict[str, float]:
        return {"y": float(x["a"] + x["b"] > 1.2), "z": 0.0}

    failed = failing_where(plan, lambda x: indicator(x)["y"] == 1.0)
    failure = analyse(plan, results_of(plan, failed=failed))["failure"]
    oracle = analyse(plan, results_of(plan, indicator))["outputs"]["y"]
    assert {key: failure[key] for key in oracle} == oracle


def test_rows_of_which_every_run_failed_are_not_used() -> None:
    plan = study_plan("saltelli", rows=8)
    failed = [(3, position) for position in range(5)]
    snapshot = analyse(plan, results_of(plan, failed=failed))
    assert (snapshot["rows_complete"], snapshot["rows_used"]) == (8, 7)
    assert snapshot["outputs"]["y"]["n"] == 14


def test_the_mean_inverse_step_is_that_of_the_design() -> None:
    rows = unit_rows("morris", "sobol", 3, range(4096), 4)
    found = np.mean([1.0 / np.abs(legs(row)[1]) for row in rows])
    assert found == pytest.approx(MEAN_INVERSE_STEP, rel=2e-3)


def test_a_factor_of_no_influence_has_indices_of_exactly_zero_and_a_dummy_shows_chance() -> None:
    """Effects, S and ST are made of differences within a row, where an idle factor does nothing."""
    for method in ("morris", "shapley", "saltelli_second_order", "saltelli"):
        plan = study_plan(method, rows=256)
        idle = analyse(plan, results_of(plan, lambda x: two_outputs(x) | {"z": x["a"]}))
        for factor in ("b", "c"):
            entry = idle["outputs"]["z"]["factors"][factor]
            found = [*entry.values(), *entry.get("per_unit", {}).values()]
            indices = [one for one in found if isinstance(one, dict) and "value" in one]
            assert len(indices) == {"morris": 6, "shapley": 5}.get(method, 3)
            assert all(index["value"] == 0.0 for index in indices)
            assert factor in idle["outputs"]["z"]["screening"]["non_influential"]
    dummy = idle["outputs"]["z"]["dummy_first_order"]
    unit = qmc.scale(
        np.stack([unit_row("saltelli", "sobol", 7, r, 3)[:2, 0] for r in range(256)]), -1, 1
    )
    assert dummy["value"] == pytest.approx(np.corrcoef(unit.T)[0, 1], abs=0.03)
    assert dummy["low"] < 0.0 < dummy["high"]


def tied(seed: int) -> dict[str, Any]:
    """Return the failures of 256 rows where three runs of ten above the 90th percentile fail."""
    plan = study_plan("saltelli", rows=256, sampling="owen_blocks", seed=seed)
    results = results_of(plan)
    bound = float(np.quantile([r.outputs["y"] for r in results], 0.9))
    rng = np.random.default_rng(seed)
    failed = [(r.row, r.position) for r in results if r.outputs["y"] > bound and rng.random() < 0.3]
    return dict(analyse(plan, results_of(plan, failed=failed))["failure"])


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_failures_that_go_with_an_output_are_noticed(seed: int) -> None:
    failure = tied(seed)
    assert failure["depends_on_factors"] is True
    assert "y" in failure["goes_with"]
    assert "They go with high y" in failure["sentence"]


def test_an_all_clear_says_what_would_have_been_noticed() -> None:
    plan = study_plan("saltelli", rows=128, sampling="owen_blocks")
    rng = np.random.default_rng(2)
    failed = [(row, p) for row in range(128) for p in range(5) if rng.random() < 0.06]
    failure = analyse(plan, results_of(plan, failed=failed))["failure"]
    assert failure["depends_on_factors"] is False and failure["goes_with"] == []
    assert 0.3 < failure["detectable"] < 2.0
    assert (
        f"Had the rows of failed runs been {failure['detectable']:.2g} standard deviations off"
        in failure["sentence"]
    )
