"""A study with a goal grows by itself: to its precision or its cap, once, whoever asks."""

import asyncio
import json
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy.engine import Engine

from analysis.sensitivity.service import catch_up
from server.errors import ConflictError, InvalidStudyError, NotFoundError
from server.logic.fleet.unserved import Patience
from server.logic.fleet.verdicts import Report
from server.logic.study.points import instance_id, parameters
from server.logic.study.precision_goals import is_settled, next_extension, precision_goal, shown
from server.operations.study import precision_goals, reruns, studies
from server.operations.study.result_log import StoreResultLog
from server.records import Plan, PrecisionGoal, Study
from server.routes.study.progress import events
from sim.evaluation import evaluate
from tests.testbed.coordinators import exchanges
from tests.testbed.coordinators.rest_bodies import STUDY, Json, is_problem

Drawing = Callable[..., Plan]
WORKER: Json = {"worker": "w", "host": "h", "versions": {}, "models": ["ishigami"]}


def run(engine: Engine, study_id: str) -> None:
    """Evaluate all there is to do, and let the analysis see it."""
    plan = studies.get(engine, study_id).plan
    while grant := exchanges.grant(engine, max_instances=1000, now=0.0, ttl=60.0, **WORKER):
        held = grant.lease
        points = {row: parameters(plan, row) for row in {row for row, _ in held.instances}}
        reports = [
            Report(
                instance=instance_id(study_id, row, position),
                outcome="ok",
                outputs=evaluate("ishigami", points[row][position]).outputs,
                reason="",
                state=None,
                wall_seconds=0.1,
            )
            for row, position in held.instances
        ]
        proof: Json = {"lease_id": held.id, "fence": held.fence, "worker": "w"}
        exchanges.post(engine, reports, now=0.0, ttl=60.0, **proof)
    catch_up(StoreResultLog(engine), study_id)


def begun(engine: Engine, plan: Plan) -> Study:
    return studies.create(engine, plan, key=None, digest="", now=0.0)[0]


def test_a_complete_study_is_extended_until_it_is_precise(engine: Engine, plan: Drawing) -> None:
    study = begun(engine, plan(method="saltelli", rows=16))
    precision_goals.put(engine, study.id, PrecisionGoal(output="y", target=0.4, up_to=1024))
    log = StoreResultLog(engine)
    assert precision_goals.due(engine) == [] and not precision_goals.act_on(engine, study.id)
    rows = []
    for _ in range(8):
        run(engine, study.id)
        rows.append(studies.get(engine, study.id).plan.rows)
        log.act_on_precision_goals()
    found = precision_goals.of(engine, study.id)
    assert found is not None and is_settled(studies.get(engine, study.id), found)
    assert [step["rows"] for step in found.steps] == sorted(set(rows))
    assert [step["extended_to"] for step in found.steps] == [*sorted(set(rows))[1:], None]
    assert 2 <= len(found.steps) < 7
    assert [step["reached"] for step in found.steps] == [False] * (len(found.steps) - 1) + [True]
    assert found.steps[-1]["sentence"].startswith("Every index of y is within ±0.4")
    snapshot = log.snapshot(study.id)
    assert snapshot is not None and snapshot["rows_complete"] == rows[-1]
    # Nothing is left to do, however often one asks.
    assert precision_goals.due(engine) == [] and not precision_goals.act_on(engine, study.id)


def test_a_study_stops_at_its_cap_and_is_judged_anew_after_a_rerun(
    engine: Engine, plan: Drawing
) -> None:
    study = begun(engine, plan(method="saltelli", rows=8))
    precision_goals.put(engine, study.id, PrecisionGoal(output="y", target=0.001, up_to=12))
    for _ in range(2):
        run(engine, study.id)
        assert precision_goals.due(engine) == [study.id]
        assert precision_goals.act_on(engine, study.id)
    found = precision_goals.of(engine, study.id)
    assert found is not None and is_settled(studies.get(engine, study.id), found)
    assert [(step["rows"], step["extended_to"]) for step in found.steps] == [(8, 12), (12, None)]
    assert "12 at most were allowed" in found.steps[-1]["sentence"]
    reruns.rerun(engine, study.id, which="all", outcomes=None, now=0.0)
    assert precision_goals.due(engine) == []
    run(engine, study.id)
    assert precision_goals.due(engine) == [study.id]


def test_two_processes_extend_a_study_once(engine: Engine, plan: Drawing) -> None:
    study = begun(engine, plan(method="saltelli", rows=8))
    precision_goals.put(engine, study.id, PrecisionGoal(output="y", target=0.001, up_to=999))
    run(engine, study.id)
    assert [precision_goals.act_on(engine, study.id) for _ in range(2)] == [True, False]
    assert studies.get(engine, study.id).plan.rows == 16


@pytest.mark.parametrize("target", [1e-60, 1e-200, 1e-320])
def test_a_target_out_of_reach_of_effects_ends_at_the_cap(
    engine: Engine, plan: Drawing, target: float
) -> None:
    study = begun(engine, plan(method="morris", rows=8))
    goal = precision_goal(study.plan, output=None, target=target, up_to=12)
    precision_goals.put(engine, study.id, goal)
    for _ in range(2):
        run(engine, study.id)
        StoreResultLog(engine).act_on_precision_goals()
    found = precision_goals.of(engine, study.id)
    assert found is not None
    assert [(step["rows"], step["extended_to"]) for step in found.steps] == [(8, 12), (12, None)]


def test_a_study_that_cannot_be_judged_says_so_and_keeps_no_other_from_it(
    engine: Engine,
    plan: Drawing,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    both = []
    for _ in range(2):
        study = begun(engine, plan(method="saltelli", rows=8))
        precision_goals.put(engine, study.id, PrecisionGoal(output="y", target=0.001, up_to=16))
        run(engine, study.id)
        both.append(study)
    bad, good = both

    def fails_at_one(study: Study, *rest: Any) -> Any:
        if study.id == bad.id:
            raise KeyError("an error of ours")
        return next_extension(study, *rest)

    monkeypatch.setattr(f"{precision_goals.__name__}.next_extension", fails_at_one)
    StoreResultLog(engine).act_on_precision_goals()
    assert studies.get(engine, good.id).plan.rows == 16
    found = precision_goals.of(engine, bad.id)
    assert found is not None and is_settled(studies.get(engine, bad.id), found)
    (step,) = found.steps
    assert (step["extended_to"], step["reached"]) == (None, False)
    assert "could not be told, an error of rehyb" in step["sentence"]
    (told,) = caplog.records
    assert f"study {bad.id} cannot be judged" in told.message and told.exc_info
    assert precision_goals.due(engine) == []


def test_what_the_analysis_has_not_seen_yet_is_waited_for(engine: Engine, plan: Drawing) -> None:
    study = begun(engine, plan(method="saltelli", rows=8))
    precision_goals.put(engine, study.id, PrecisionGoal(output="y", target=0.001, up_to=999))
    run(engine, study.id)
    complete = studies.get(engine, study.id)
    snapshot = StoreResultLog(engine).snapshot(study.id)
    assert snapshot is not None
    goal = PrecisionGoal(output="y", target=0.001, up_to=999)
    assert next_extension(complete, goal, snapshot) is not None
    old = {key: value for key, value in snapshot.items() if key != "sampling"}
    assert next_extension(complete, goal, old) == next_extension(complete, goal, snapshot)
    assert next_extension(complete, goal, {**snapshot, "rows_complete": 7}) is None
    assert next_extension(replace(complete, state="paused"), goal, snapshot) is None
    assert next_extension(complete, replace(goal, judged=complete.edition), snapshot) is None


def test_events_go_on_while_a_complete_study_may_yet_be_extended(
    engine: Engine, plan: Drawing, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("server.routes.study.progress.EVENT_SECONDS", 0.01)
    study = begun(engine, plan(method="saltelli", rows=8))
    precision_goals.put(engine, study.id, PrecisionGoal(output="y", target=0.001, up_to=9))
    run(engine, study.id)

    async def told() -> list[Json]:
        state = SimpleNamespace(stopping=asyncio.Event(), clock=lambda: 1e6)
        request: Any = SimpleNamespace(app=SimpleNamespace(state=state))
        answer = await events(study.id, engine, Patience(seconds=60.0, since=0.0), request)
        stream: Any = answer.body_iterator
        said = [await anext(stream)]
        precision_goals.remove(engine, study.id)
        said += [event async for event in stream]
        return [json.loads(event.partition("data: ")[2]) for event in said]

    first, last = asyncio.run(told())
    assert first["state"] == last["state"] == "complete"
    assert first["precision"]["settled"] is False and last["precision"] is None


def test_a_goal_goes_with_its_study_and_is_refused_where_there_is_none(
    engine: Engine, plan: Drawing
) -> None:
    study = begun(engine, plan())
    goal = PrecisionGoal(output="y", target=None, up_to=9)
    precision_goals.put(engine, study.id, goal)
    precision_goals.put(engine, study.id, replace(goal, up_to=99))
    assert precision_goals.every(engine) == {study.id: replace(goal, up_to=99)}
    studies.cancel(engine, study.id, now=1.0)
    with pytest.raises(ConflictError, match="is cancelled: it has all the rows"):
        precision_goals.put(engine, study.id, goal)
    studies.delete(engine, study.id)
    assert precision_goals.every(engine) == {}
    for change in (
        lambda: precision_goals.put(engine, "x", goal),
        lambda: precision_goals.remove(engine, "x"),
    ):
        with pytest.raises(NotFoundError):
            change()


@pytest.mark.parametrize(
    ("changes", "pointer", "said"),
    [
        ({"output": "z"}, "/precision/output", "has no output 'z': it has y"),
        ({"target": 0.0}, "/precision/target", "positive half width"),
        ({"up_to": 0}, "/precision/up_to", "between 1 and"),
        (
            {"up_to": 1},
            "/precision/up_to",
            "must be 2 or more, the rows that the study has already",
        ),
    ],
)
def test_a_goal_that_is_none_is_refused(
    plan: Drawing, changes: Json, pointer: str, said: str
) -> None:
    asked: Json = {"output": None, "target": 0.1, "up_to": 9, **changes}
    with pytest.raises(InvalidStudyError, match=said) as refused:
        precision_goal(plan(), pointer="/precision", **asked)
    assert refused.value.pointer == pointer
    assert precision_goal(plan(), output=None, target=None, up_to=9).output == "y"
    assert shown(object(), None) is None  # type: ignore[arg-type]


def test_a_goal_is_posted_shown_replaced_and_dropped(client: TestClient) -> None:
    body = {**STUDY, "precision": {"target": 0.05, "up_to": 64}}
    study = client.post("/v1/studies", json=body, headers={"Idempotency-Key": "k"}).json()
    expected: dict[str, Any] = {
        "output": "y",
        "target": 0.05,
        "up_to": 64,
        "settled": False,
        "reached": False,
        "steps": [],
    }
    assert study["precision"] == expected
    path = f"/v1/studies/{study['id']}"
    assert client.get(path).json()["precision"] == expected
    progress = client.get(f"{path}/progress")
    assert progress.json()["precision"] == expected
    # The same study under the same key, whatever it is to become.
    again = client.post("/v1/studies", json=STUDY, headers={"Idempotency-Key": "k"})
    assert (again.status_code, again.json()) == (200, study)
    aimed = client.post(f"{path}/precision", json={"output": "y", "up_to": 128}).json()
    assert aimed["precision"] == {**expected, "target": None, "up_to": 128}
    assert client.get(f"{path}/progress").headers["etag"] != progress.headers["etag"]
    assert client.delete(f"{path}/precision").status_code == 204
    assert client.get(path).json()["precision"] is None
    wrong = {**STUDY, "precision": {"output": "z", "up_to": 64}}
    problem = is_problem(client.post("/v1/studies", json=wrong), 422)
    assert problem["pointer"] == "/precision/output"
    assert len(client.get("/v1/studies").json()["studies"]) == 1
    is_problem(client.post("/v1/studies/none/precision", json={"up_to": 9}), 404)
