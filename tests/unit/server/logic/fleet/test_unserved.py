"""Why a study has nobody who works on it."""

from collections.abc import Mapping
from typing import Any

import pytest

from server.logic.fleet.hosts import host_class
from server.logic.fleet.unserved import Patience, why_it_waits, why_its_rows_wait
from server.records import Study, Worker
from server.states import StudyState
from tests.testbed.coordinators.records import plan


def worker(**changes: Any) -> Worker:
    known = {"id": "w", "host": "h", "versions": {"code": "a"}, "last_seen": 0.0, "tags": []}
    return Worker(**{**known, "instances_done": 0, "host_class": None, **changes})


def study(**changes: Any) -> Study:
    known: dict[str, Any] = {"state": StudyState.RUNNING, "created_at": 0.0}
    return Study(id="s", plan=plan(), **{**known, **changes})


def test_nobody_is_there() -> None:
    assert why_it_waits(study(), []) == "no worker was heard from lately"
    assert why_it_waits(study(), [], listening=3.0) == "no worker was heard from yet"


def test_one_who_may_is_enough() -> None:
    tagged = study(tags=("gpu",))
    assert why_it_waits(tagged, [worker(), worker(tags=["gpu"])]) is None


def test_tags_code_and_models_that_nobody_has_are_named() -> None:
    assert "workers tagged gpu" in str(why_it_waits(study(tags=("gpu",)), [worker()]))
    other = study(identity={"code": "b"}, leased=1)
    said = str(why_it_waits(other, [worker(), worker(id="x")]))
    assert "code b" in said and said.count("was begun with") == 1
    own = study()
    own.plan.__dict__["model"] = "pendulum@1"
    assert why_it_waits(own, [worker()]) == "no worker has the model pendulum@1"


def test_why_workers_refuse_a_model_is_told_once_of_each_host() -> None:
    own = study()
    own.plan.__dict__["model"] = "random0@1"
    refusing = [
        worker(host=host, refused={"random0@1": "it gives other numbers"}) for host in "aab"
    ]
    told = "a refuses it: it gives other numbers; b refuses it: it gives other numbers"
    assert why_it_waits(own, [worker(), *refusing]) == told
    taking = worker(models={"random0@1": "7c"})
    assert why_it_waits(own, [taking, *refusing]) is None


def test_no_more_than_three_objections_are_listed() -> None:
    theirs = [worker(versions={"code": code}) for code in "bcde"]
    said = str(why_it_waits(study(identity={"code": "a"}, leased=1), theirs))
    assert [part.count("this worker has code") for part in said.split("; ")] == [1, 1, 1]
    assert "; study s was begun" in said
    assert "code d" in said and "code e" not in said


def test_one_who_introduced_itself_with_the_model_and_the_tag_may() -> None:
    own = study(tags=("gpu",))
    own.plan.__dict__["model"] = "pendulum@1"
    assert why_it_waits(own, [worker(models={"pendulum@1": "7c"}, tags=["gpu"])]) is None


#: Of two rows of four instances, both begun, three instances have no result.
BEGUN = {"handed_out": 8, "result_count": 5}
THERE, AWAY = {"cpu": "here"}, {"cpu": "gone"}


def rows_wait(
    waiting: Mapping[str | None, int], *heard: Worker, since: float = 0.0, **changes: Any
) -> str | None:
    return why_its_rows_wait(
        study(**{**BEGUN, **changes}),
        waiting,
        heard,
        now=4000.0,
        patience=Patience(seconds=3600.0, since=since),
    )


def test_rows_of_a_kind_of_machine_that_is_gone_are_named_with_when_they_begin_anew() -> None:
    present = worker(versions=THERE, last_seen=3999.0)
    gone = worker(id="x", versions=AWAY, last_seen=3280.0)
    kind = host_class(AWAY)
    for heard in ((present, gone), (gone, worker(versions=AWAY, last_seen=2000.0))):
        assert rows_wait({kind: 3}, *heard) == (
            f"3 instances of begun rows can go to machines of class {kind} only, and none of these "
            "was heard from for 12 minutes: their rows begin anew on any machine in 48 minutes "
            "(REHYB_STRANDED_SECONDS); `rehyb study rerun s --which all` begins the whole study "
            "anew at once"
        )


def test_a_coordinator_that_was_just_restarted_listens_for_as_long_before_rows_begin_anew() -> None:
    gone = worker(versions=AWAY, last_seen=3280.0)
    said = str(rows_wait({host_class(AWAY): 3}, gone, since=3940.0))
    assert "for 12 minutes:" in said and "in 59 minutes (" in said
    said = str(rows_wait({"e": 3}, since=3940.0))
    assert "for 60 minutes or longer:" in said and "in 59 minutes (" in said
    assert "in 1 minute (" in str(rows_wait({"e": 3}, since=0.0))


def test_of_many_kinds_that_are_gone_those_with_the_most_instances_are_named() -> None:
    said = str(rows_wait({"a": 1, "b": 2, "c": 9, "d": 3}))
    assert [part.split(" only")[0] for part in said.split("; ")[:-1]] == [
        "9 instances of begun rows can go to machines of class c",
        "3 instances of begun rows can go to machines of class d",
        "2 instances of begun rows can go to machines of class b",
    ]
    assert "1 instance of begun rows" in str(rows_wait({"a": 1}))


@pytest.mark.parametrize("last_seen", [3950.0, 3999.0])
def test_rows_do_not_wait_in_vain_while_a_machine_of_their_kind_is_there(last_seen: float) -> None:
    mine = worker(versions=AWAY, last_seen=last_seen)
    assert rows_wait({host_class(AWAY): 3}, mine) is None
    assert rows_wait({"e": 2, host_class(AWAY): 1}, mine) is None


def test_rows_do_not_wait_in_vain_while_any_machine_may_have_some_of_the_study() -> None:
    assert rows_wait({"e": 2, None: 1}) is None
    assert rows_wait({}) is None
    assert rows_wait({"e": 2}, handed_out=4, result_count=2) is None, "a row is not begun yet"
    draining = {"handed_out": 4, "result_count": 2, "state": StudyState.DRAINING}
    assert "2 instances" in str(rows_wait({"e": 2}, **draining))
