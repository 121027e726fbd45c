"""What a group of workers may have of what waits, judged by those of it that came last."""

from typing import Any

import pytest

from server.logic.fleet.groups import LOOK_AGAIN_SECONDS, Share, Waiting, share, to_hand_out
from server.logic.fleet.hosts import host_class
from server.records import Study, Worker
from server.states import StudyState
from tests.testbed.coordinators.records import plan

NOW = 5000.0


def worker(**changes: Any) -> Worker:
    known = {"id": "g-w", "host": "h", "versions": {"code": "a"}, "last_seen": NOW, "tags": []}
    return Worker(**{**known, "instances_done": 0, "host_class": None, **changes})


def study(model: str = "", **changes: Any) -> Study:
    known: dict[str, Any] = {"state": StudyState.RUNNING, "created_at": 0.0}
    found = Study(id="s", plan=plan(), **{**known, **changes})
    if model:
        found.plan.__dict__["model"] = model
    return found


def waiting(of: Study, **changes: Any) -> Waiting:
    return Waiting(**{"study": of, "count": 8, "by_class": {}, "to_be_had": False, **changes})


def told(one: Waiting, *latest: Worker) -> Share:
    return share([one, waiting(study(), count=3)], latest, now=NOW)


def test_while_nobody_of_a_group_was_seen_all_that_waits_counts() -> None:
    assert share([waiting(study(tags=("gpu",)))], [], now=NOW) == Share(waiting=8)


@pytest.mark.parametrize(
    ("one", "why"),
    [
        (waiting(study(tags=("gpu",))), "study s is for workers tagged gpu (rehyb-worker --tags)"),
        (
            waiting(study("pump@1")),
            "study s samples pump@1, whose code none of these workers has "
            "(rehyb-worker --models or --allow)",
        ),
        (waiting(study(identity={"code": "b"}, leased=1)), "study s was begun with code b"),
        (
            waiting(study(), by_class={"other": 8}),
            "begun rows of study s can go to another kind of machine only",
        ),
    ],
)
def test_what_none_of_a_group_may_have_does_not_wait_for_it_and_the_reason_is_told(
    one: Waiting, why: str
) -> None:
    found = told(one, worker())
    assert (found.waiting, found.unfit) == (3, 8)
    assert found.why.startswith(why)


@pytest.mark.parametrize(
    ("one", "able"),
    [
        (waiting(study(tags=("gpu",))), worker(tags=["gpu"])),
        (waiting(study("pump@1")), worker(models={"pump@1": "c"})),
        (waiting(study("pump@1"), to_be_had=True), worker()),
        (waiting(study(identity={"code": "b"}, leased=1)), worker(versions={"code": "b"})),
        (waiting(study(), by_class={host_class({"code": "b"}): 8}), worker(versions={"code": "b"})),
        (waiting(study(), by_class={None: 8}), worker()),
    ],
)
def test_one_of_a_group_that_may_have_it_is_enough(one: Waiting, able: Worker) -> None:
    assert told(one, worker(tags=["fast"]), able) == Share(waiting=11)


def test_of_rows_bound_to_kinds_of_machines_only_those_of_others_are_unfit() -> None:
    bound = waiting(study(), by_class={"other": 5, host_class({"code": "a"}): 3})
    found = told(bound, worker())
    assert (found.waiting, found.unfit) == (6, 5)


def test_a_model_that_was_tried_and_refused_is_unfit_for_the_reason_that_was_told() -> None:
    refusing = worker(refused={"pump@1": "it gives other numbers"})
    found = told(waiting(study("pump@1"), to_be_had=True), refusing)
    assert found.unfit == 8
    assert found.why == "study s samples pump@1: h refuses it: it gives other numbers"


def test_when_nobody_looked_for_a_quarter_of_an_hour_one_instance_waits_for_a_look() -> None:
    tagged = waiting(study(tags=("gpu",)))
    at = NOW + LOOK_AGAIN_SECONDS
    assert share([tagged], [worker()], now=at - 1.0).waiting == 0
    assert share([tagged], [worker()], now=at).waiting == 1
    assert share([waiting(study())], [worker()], now=at).waiting == 8, "nothing is unfit"
    assert share([tagged], [worker(), worker(last_seen=at)], now=at).waiting == 0


def test_the_reasons_of_the_studies_with_most_instances_are_told() -> None:
    many = [waiting(study(tags=(f"t{n}",)), count=n) for n in range(1, 6)]
    why = share(many, [worker()], now=NOW).why
    assert [part.split("tagged ")[1][:2] for part in why.split("; ")] == ["t5", "t4", "t3"]


@pytest.mark.parametrize(
    ("state", "expected"),
    [(StudyState.RUNNING, 5), (StudyState.DRAINING, 2), (StudyState.PAUSED, 0)],
)
def test_what_waits_of_a_study_is_what_would_be_handed_out(state: Any, expected: int) -> None:
    assert plan().instances == 8
    assert to_hand_out(study(state=state, handed_out=5, leased=1, result_count=2)) == expected
