"""Why a study has nobody who works on it."""

from typing import Any

from server.logic.fleet.unserved import why_it_waits
from server.records import Study, Worker
from server.states import StudyState
from tests.testbed.coordinators.records import plan


def worker(**changes: Any) -> Worker:
    known = {"id": "w", "host": "h", "versions": {"code": "a"}, "last_seen": 0.0, "tags": []}
    return Worker(**{**known, "instances_done": 0, "host_class": None, **changes})


def study(**changes: Any) -> Study:
    return Study(id="s", plan=plan(), state=StudyState.RUNNING, created_at=0.0, **changes)


def test_nobody_is_there() -> None:
    assert why_it_waits(study(), []) == "no worker was heard from lately"


def test_one_who_may_is_enough() -> None:
    tagged = study(tags=("gpu",))
    assert why_it_waits(tagged, [worker(), worker(tags=["gpu"])]) is None


def test_tags_code_and_models_that_nobody_has_are_named() -> None:
    assert "workers tagged gpu" in str(why_it_waits(study(tags=("gpu",)), [worker()]))
    other = study(identity={"code": "b"})
    said = str(why_it_waits(other, [worker(), worker(id="x")]))
    assert "code b" in said and said.count("was begun with") == 1
    own = study()
    own.plan.__dict__["model"] = "pendulum@1"
    assert why_it_waits(own, [worker()]) == "no worker has the model pendulum@1"


def test_no_more_than_three_objections_are_listed() -> None:
    theirs = [worker(versions={"code": code}) for code in "bcde"]
    said = str(why_it_waits(study(identity={"code": "a"}), theirs))
    assert [part.count("this worker has code") for part in said.split("; ")] == [1, 1, 1]
    assert "; study s was begun" in said
    assert "code d" in said and "code e" not in said


def test_one_who_introduced_itself_with_the_model_and_the_tag_may() -> None:
    own = study(tags=("gpu",))
    own.plan.__dict__["model"] = "pendulum@1"
    assert why_it_waits(own, [worker(models={"pendulum@1": "7c"}, tags=["gpu"])]) is None
