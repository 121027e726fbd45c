"""A study of single points: its indices are a function of its results, however they came."""

import json
import random
from dataclasses import replace
from functools import cache

from analysis.sensitivity.estimator_state import EstimatorState
from analysis.sensitivity.records import LoggedResult
from analysis.sensitivity.service import analyse
from tests.testbed.studies import results_of, study_plan

PLAN = replace(study_plan("surrogate", rows=140, sampling="owen_blocks"), outputs=("y",))


@cache
def results() -> tuple[LoggedResult, ...]:
    return tuple(results_of(PLAN, lambda x: {"y": x["a"] + 0.5 * x["a"] * x["b"]}))


def test_any_order_and_a_restart_leave_the_same_indices() -> None:
    expected = analyse(PLAN, results())
    mixed = random.Random(3).sample(results(), len(results()))
    state = EstimatorState(PLAN)
    state.take(mixed[:100])
    assert state.snapshot()["outputs"]["y"]["surrogate"] is None
    state = EstimatorState.from_bytes(PLAN, state.to_bytes())
    state.take(mixed[100:])
    snapshot = EstimatorState.from_bytes(PLAN, state.to_bytes()).snapshot()
    assert json.dumps(snapshot) == json.dumps(expected)


def test_the_first_128_rows_say_what_they_say_of_a_larger_study() -> None:
    """V(a (1 + b / 2)) with a of mean 0: a alone has 2.25 / (2.25 + 1 / 12) of it."""
    output = analyse(PLAN, results())["outputs"]["y"]
    assert output["surrogate"]["runs"] == 128
    assert abs(output["factors"]["a"]["first_order"]["value"] - 27.0 / 28.0) < 1e-6
    assert abs(output["factors"]["b"]["total_order"]["value"] - 1.0 / 28.0) < 1e-6
    assert output["convergence"]["rows"] == [128]
    assert output["trust"]["trusted"] is None and "fewer than 256" in output["trust"]["sentence"]
    early = replace(PLAN, rows=128)
    shown = analyse(early, [r for r in results() if r.row < 128])["outputs"]["y"]
    assert shown["factors"]["a"]["total_order"] == output["factors"]["a"]["total_order"]


def test_where_an_early_row_is_missing_nothing_is_said() -> None:
    output = analyse(PLAN, [r for r in results() if r.row != 5])["outputs"]["y"]
    assert output["surrogate"] is None
    assert output["factors"]["a"]["first_order"]["value"] is None
