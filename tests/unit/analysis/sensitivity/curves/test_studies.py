"""Studies with curves: what comes in any order, in batches and after restarts is the same."""

import json
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from analysis.designs import row_width, unit_row
from analysis.sensitivity.estimator_state import EstimatorState
from analysis.sensitivity.judgement.stopping import Goal, advise, next_step
from analysis.sensitivity.records import LoggedResult, StudyPlan, output_of, plan_of
from analysis.sensitivity.service import analyse
from analysis.sensitivity.snapshot import empty_snapshot
from models.curves import Curve, columns
from tests.testbed.functions.curves import ishigami_over_time

POINTS = 5
CURVES = {"torque": Curve(points=POINTS, over="phase")}
NAMES = columns("torque", POINTS)


def plan(method: str = "saltelli", rows: int = 8, **changes: Any) -> StudyPlan:
    made = StudyPlan(
        id="s",
        method=method,
        seed=3,
        sampling="owen_blocks",
        rows=rows,
        factors=("a", "b", "c"),
        outputs=("y", *NAMES, "z"),
        curves=CURVES,
    )
    return replace(made, **changes)


def results(of: StudyPlan, failed: tuple[tuple[int, int], ...] = ((2, 1),)) -> list[LoggedResult]:
    function, found = ishigami_over_time(POINTS), []
    for row in range(of.rows):
        points = unit_row(of.method, of.sampling, of.seed, row, 3)
        for position, curve in enumerate(function.values(points).tolist()):
            ok = (row, position) not in failed
            numbers = {"y": curve[0], **dict(zip(NAMES, curve, strict=True)), "z": curve[-1]}
            found.append(
                LoggedResult(
                    seq=len(found) + 1,
                    instance=f"s:{row}:{position}",
                    row=row,
                    position=position,
                    outcome="ok" if ok else "stuck",
                    outputs=numbers if ok else {},
                )
            )
    return found


@cache
def at_one_go(method: str) -> tuple[list[LoggedResult], dict[str, Any]]:
    """Return a study's results in order, and their snapshot."""
    every = results(plan(method))
    return every, analyse(plan(method), every)


@settings(max_examples=8, deadline=None)
@given(data=st.data(), method=st.sampled_from(["saltelli", "morris"]))
def test_order_batches_and_restarts_leave_no_trace(data: st.DataObject, method: str) -> None:
    study, (every, expected) = plan(method), at_one_go(method)
    order = data.draw(st.permutations(range(len(every))))
    cut = data.draw(st.integers(0, len(every)))
    shuffled = [replace(every[i], seq=seq + 1) for seq, i in enumerate(order)]
    state = EstimatorState(study)
    state.take(shuffled[:cut])
    state = EstimatorState.from_bytes(study, state.to_bytes())
    state.take(shuffled[cut:])
    assert state.snapshot() == expected


@pytest.mark.parametrize("method", ["morris", "saltelli", "saltelli_second_order"])
def test_a_snapshot_has_curves_beside_outputs_and_is_json(method: str) -> None:
    study = plan(method)
    for snapshot in (empty_snapshot(study), analyse(study, results(study))):
        assert json.loads(json.dumps(snapshot, allow_nan=False)) == snapshot
        assert list(snapshot["outputs"]) == ["y", "z"]
        said = snapshot["curves"]["torque"]
        assert said["axis"] == [0.0, 0.25, 0.5, 0.75, 1.0]
        assert list(said["factors"]) == list(said["whole"]["factors"]) == ["a", "b", "c"]


def test_scalars_say_the_same_with_curves_beside_them_and_without() -> None:
    alone = plan(outputs=("y", "z"), curves={})
    with_curves, without = (analyse(one, results(one)) for one in (plan(), alone))
    del with_curves["curves"]
    assert with_curves == without


def test_the_points_say_what_they_say_as_outputs_of_their_own() -> None:
    as_outputs = plan(curves={}, rows=64)
    torque = analyse(plan(rows=64), results(as_outputs))["curves"]["torque"]
    outputs = analyse(as_outputs, results(as_outputs))["outputs"]
    for point, name in enumerate(NAMES):
        for factor, of_factor in outputs[name]["factors"].items():
            first = torque["factors"][factor]["first_order"]
            for end in ("value", "low", "high"):
                assert first[end][point] == of_factor["first_order"][end]


def test_a_study_may_have_curves_alone_and_a_goal_on_the_whole() -> None:
    study = plan(outputs=NAMES, rows=8)
    snapshot = analyse(study, results(study))
    assert snapshot["outputs"] == {} and snapshot["rows_used"] == 8
    assert output_of(snapshot, "torque")["factors"]["a"]["total_order"]["value"] > 0.0
    advice = advise(snapshot, "torque", 0.05)
    assert advice is not None and advice.more_rows > 0
    step = next_step(snapshot, Goal(output="torque", target=0.05, up_to=64), 8)
    assert step is not None and step.rows == 16
    with pytest.raises(ValueError, match="no output 'force': it has torque"):
        output_of(snapshot, "force")


def test_a_run_whose_curve_is_beyond_all_numbers_counts_as_failed() -> None:
    study = plan(rows=8)
    every = results(study, failed=())
    every[3] = replace(every[3], outputs={**every[3].outputs, NAMES[2]: 1e101})
    assert analyse(study, every)["evaluations"] == {"ok": 39, "out_of_range": 1}


def test_a_long_curve_is_looked_at_in_some_of_its_points() -> None:
    names = columns("y", 1000)
    study = plan(outputs=names, curves={"y": Curve(points=1000, over="time", unit="s", high=9.99)})
    rng = np.random.default_rng(1)
    found = [
        LoggedResult(
            seq=1 + i,
            instance="",
            row=i // row_width("saltelli", 3),
            position=i % row_width("saltelli", 3),
            outcome="ok",
            outputs=dict(zip(names, rng.normal(size=1000).tolist(), strict=True)),
        )
        for i in range(2 * row_width("saltelli", 3))
    ]
    said = analyse(study, found)["curves"]["y"]
    assert said["looked_at"][:2] == [0, 5] and said["axis"][-1] == 9.99
    assert len(said["factors"]["a"]["first_order"]["value"]) == len(said["axis"]) == 201


def test_a_plan_is_read_from_what_the_interface_shows() -> None:
    shown = {
        "id": "s",
        "method": "saltelli",
        "seed": 3,
        "sampling": "owen_blocks",
        "rows": 8,
        "factors": [
            {"name": name, "distribution": {"kind": "uniform", "low": 0.0, "high": 1.0}}
            for name in "abc"
        ],
        "outputs": ["y", "torque", "z"],
        "curves": {"torque": CURVES["torque"].as_json()},
    }
    assert replace(plan_of(shown), scales={}) == plan()
    del shown["curves"]
    assert plan_of(shown).outputs == ("y", "torque", "z")
