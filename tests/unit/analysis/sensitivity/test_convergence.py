"""What the series promises: what a study of 8, 16, 32, ... rows would have said, in any order."""

import dataclasses
import random
from functools import cache
from typing import Any

import pytest

from analysis.designs import METHODS
from analysis.sensitivity.estimator_state import EstimatorState
from analysis.sensitivity.records import LoggedResult, StudyPlan
from analysis.sensitivity.service import analyse
from tests.testbed.studies import results_of, study_plan

FAILED = [(0, 1), (4, 0), (9, 3), (17, 2)]


@cache
def at_one_go(method: str) -> tuple[StudyPlan, list[LoggedResult], dict[str, Any]]:
    """Return a study, its results in order, of which some failed, and their snapshot."""
    plan = study_plan(method, rows=37)
    results = results_of(plan, failed=FAILED)
    return plan, results, analyse(plan, results)


@pytest.mark.parametrize("method", METHODS)
def test_a_point_of_the_series_is_the_index_of_a_study_of_that_many_rows(method: str) -> None:
    plan, results, snapshot = at_one_go(method)
    series = snapshot["outputs"]["y"]["convergence"]
    assert series["rows"] == [8, 16, 32]
    for place, rows in enumerate(series["rows"]):
        shorter = dataclasses.replace(plan, rows=rows)
        alone = analyse(shorter, [r for r in results if r.row < rows])["outputs"]["y"]
        for factor, curves in series["factors"].items():
            for name, curve in curves.items():
                expected = alone["factors"][factor][name]
                assert {end: curve[end][place] for end in curve} == expected


@pytest.mark.parametrize("method", METHODS)
def test_order_batches_and_restarts_leave_the_same_bits(method: str) -> None:
    plan, results, expected = at_one_go(method)
    shuffled = list(results)
    random.Random(3).shuffle(shuffled)
    state = EstimatorState(plan)
    for start in range(0, len(shuffled), 29):
        state.take(shuffled[start : start + 29])
        state = EstimatorState.from_bytes(plan, state.to_bytes())
    assert state.snapshot() == expected


def test_a_point_waits_for_every_row_before_it() -> None:
    plan = study_plan("saltelli", rows=32)
    results = results_of(plan)
    state = EstimatorState(plan)
    state.take(r for r in results if r.row != 5)
    assert state.snapshot()["outputs"]["y"]["convergence"]["rows"] == []
    assert state.snapshot()["rows_used"] == 31
    state.take(r for r in results if r.row == 5)
    assert state.snapshot()["outputs"]["y"]["convergence"]["rows"] == [8, 16, 32]
