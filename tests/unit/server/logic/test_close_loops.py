"""The life of a close-loop job, decision by decision."""

import json
from dataclasses import replace

import pytest

from analysis.closeloop.contract import Verdict
from server.logic.close_loops import (
    MAX_REPORT_BYTES,
    NOTED_SECONDS,
    after_attempt,
    answers,
    failed,
    finished,
    handed_out,
    is_noted,
    lease_of,
    parsed,
    released,
    suits,
    verdict_of,
)
from server.logic.fleet.leases import objection_to_renewal, objection_to_results
from server.logic.json_values import cut
from server.logic.study.instances import BUDGETS
from server.records import CloseLoopJob, Introduction, Lease
from server.states import JobKind

WAITING = CloseLoopJob(id="j", session_id="s", state="waiting", created_at=1.0)


def running(job: CloseLoopJob = WAITING, lease: str = "l", host: str = "pc") -> CloseLoopJob:
    worker = Introduction(id=f"w of {lease}", host=host, versions={})
    return handed_out(job, lease=lease, worker=worker, now=10.0, ttl=60.0)


@pytest.mark.parametrize(
    ("job", "code", "will_do"),
    [
        (WAITING, "any", True),
        (running(), "any", True),
        (finished(running(), "l", code="new", verdict="adequate", now=2.0), "new", True),
        (finished(running(), "l", code="old", verdict="adequate", now=2.0), "new", False),
        (failed(running(), outcome="crashed", detail="x", now=2.0), "any", False),
    ],
    ids=["waiting", "running", "same code", "older code", "failed"],
)
def test_a_job_that_will_do_is_not_made_anew(job: CloseLoopJob, code: str, will_do: bool) -> None:
    assert answers(job, code) is will_do


def test_each_lease_has_a_greater_fence_than_all_before_even_if_those_were_given_back() -> None:
    fences = []
    job = WAITING
    for number in range(3):
        job = running(job, f"l{number}")
        assert job.current is not None and job.expires_at == 70.0
        fences.append(job.current.fence)
        job = released(job) if number == 0 else after_attempt(job, cause="lost", reason="", now=80)
    assert fences == [1, 2, 3]
    assert [attempt.lease for attempt in job.attempts] == ["l1", "l2"]


def test_a_lease_that_is_given_back_takes_no_earlier_attempt_with_it() -> None:
    job = after_attempt(running(lease="l1"), cause="lost", reason="silent", now=2.0)
    back = released(running(job, "l2"))
    assert [(one.lease, one.ended) for one in back.attempts] == [("l1", "lost")]


def test_a_job_that_fails_while_it_waits_leaves_its_attempts_as_they_ended() -> None:
    waiting = after_attempt(running(lease="l1"), cause="lost", reason="silent", now=2.0)
    for job in (WAITING, waiting):
        assert failed(job, outcome="withdrawn", detail="why", now=3.0).attempts == job.attempts
    ended = failed(running(waiting, "l2"), outcome="bad", detail="why", now=3.0).attempts
    assert [(one.ended, one.reason) for one in ended] == [("lost", "silent"), ("bad", "why")]


def test_a_report_that_comes_late_takes_back_why_its_attempt_was_given_up() -> None:
    silent = after_attempt(running(lease="l1"), cause="lost", reason="silent", now=2.0)
    done = finished(running(silent, "l2"), "l1", code="c", verdict="adequate", now=3.0)
    assert [(one.ended, one.reason) for one in done.attempts] == [("done", ""), ("late", "")]


@pytest.mark.parametrize("cause", BUDGETS)
def test_a_cause_ends_a_job_when_its_own_budget_is_spent(cause: str) -> None:
    job = after_attempt(running(), cause="lost" if cause != "lost" else "crashed", reason="", now=2)
    for _ in range(BUDGETS[cause] - 1):
        job = after_attempt(running(job), cause=cause, reason="why", now=3.0)
        assert (job.state, job.expires_at, job.fault) == ("waiting", None, None)
    job = after_attempt(running(job), cause=cause, reason="why", now=4.0)
    assert (job.state, job.finished_at, job.expires_at) == ("failed", 4.0, None)
    assert job.fault == {
        "outcome": cause,
        "detail": "why",
        "file": None,
        "column": None,
        "line": None,
    }
    assert job.attempts[-1].ended == cause


def test_the_host_of_the_last_failure_is_avoided_until_the_next_begins() -> None:
    job = after_attempt(running(host="pc-1"), cause="crashed", reason="", now=2.0)
    assert job.avoid == "pc-1"
    assert running(job, "l2", host="pc-2").avoid is None
    assert WAITING.avoid is None


def test_only_the_last_lease_is_open_and_every_one_may_bring_the_report() -> None:
    job = running(after_attempt(running(), cause="lost", reason="", now=2.0), "l2")
    first, second = lease_of(job, "l"), lease_of(job, "l2")
    assert first is not None and second is not None
    assert objection_to_renewal(first, fence=1, now=20.0) == "the lease is lost"
    assert objection_to_renewal(second, fence=2, now=20.0) is None
    assert "expired" in str(objection_to_renewal(second, fence=2, now=71.0))
    assert objection_to_results(first, fence=1, worker="w of l") is None
    assert objection_to_results(first, fence=1, worker="w of l2") is not None
    assert objection_to_results(first, fence=2, worker="w of l") is not None
    assert lease_of(job, "l3") is None


def test_a_late_report_ends_the_attempt_of_whoever_was_slower() -> None:
    job = running(after_attempt(running(), cause="lost", reason="silent", now=2.0), "l2")
    job = finished(job, "l", code="c", verdict="adequate", now=30.0)
    assert [(a.lease, a.ended) for a in job.attempts] == [("l", "done"), ("l2", "late")]
    assert (job.state, job.expires_at, job.code, job.verdict) == ("done", None, "c", "adequate")


def test_a_late_report_is_better_than_having_failed() -> None:
    job = failed(running(), outcome="lost", detail="silent", now=2.0)
    assert finished(job, "l", code="c", verdict="adequate", now=3.0).fault is None


def test_a_released_job_is_as_it_was_but_for_its_fence() -> None:
    assert released(replace(running(), progress="tracing")) == replace(WAITING, grants=1)


@pytest.mark.parametrize("verdict", [*Verdict])
def test_every_verdict_of_the_contract_is_one(verdict: str) -> None:
    assert verdict_of(f'{{"schema": 1, "verdict": "{verdict}"}}'.encode()) == verdict


@pytest.mark.parametrize(
    "report",
    [
        b"",
        b"null",
        b"{}",
        b'{"schema": 2, "verdict": "adequate"}',
        b'{"schema": 1, "verdict": null}',
        b'{"schema": 1, "verdict": "adequate", "x": -Infinity}',
        b'{"schema": 1, "verdict": "adequate", "x": 1e999}',
        b'{"schema": 1, "verdict": "adequate", "x": ' + b"[" * 70 + b"]" * 70 + b"}",
        b"\xff\xfe",
        b"[" * 100_000,
        b" " * (MAX_REPORT_BYTES + 1),
    ],
)
def test_what_is_no_report_is_told_so_in_a_sentence(report: bytes) -> None:
    with pytest.raises(ValueError, match=r"report\.json") as caught:
        verdict_of(report)
    assert type(caught.value) is ValueError


def test_a_report_may_have_just_as_many_bytes_as_are_taken() -> None:
    report = b'{"schema": 1, "verdict": "adequate"}'.ljust(MAX_REPORT_BYTES)
    assert verdict_of(report) == "adequate"
    with pytest.raises(ValueError, match=rf"^report\.json has more than {MAX_REPORT_BYTES} bytes$"):
        verdict_of(report + b" ")


def test_a_report_of_another_verdict_is_told_which_there_are() -> None:
    with pytest.raises(ValueError, match=f"a verdict of {', '.join(Verdict)}$"):
        verdict_of(b'{"schema": 1, "verdict": "good"}')


def test_text_is_kept_as_every_database_can_hold_it() -> None:
    assert cut("a\0b\ud800c", 10) == "ab?c"
    assert cut("x" * 10, 3) == "xxx"


def test_a_lease_is_shown_as_leases_are_judged() -> None:
    job = running(after_attempt(running(), cause="lost", reason="", now=2.0), "l2")
    assert lease_of(job, "l2") == Lease(
        id="l2",
        fence=2,
        worker="w of l2",
        study="",
        state="open",
        expires_at=70.0,
        instances=(),
    )
    assert lease_of(job, "l") == Lease(
        id="l", fence=1, worker="w of l", study="", state="lost", expires_at=0.0, instances=()
    )
    timeless = replace(job, expires_at=None)
    assert (found := lease_of(timeless, "l2")) is not None and found.expires_at == 0.0


def test_a_running_job_says_who_has_it_since_when_and_forgets_what_was_said_before() -> None:
    job = running(replace(WAITING, progress="tracing"))
    assert (job.state, job.progress, job.grants) == ("running", "", 1)
    assert job.current is not None
    assert (job.current.worker, job.current.host) == ("w of l", "pc")
    assert job.current.granted_at == 10.0


def test_a_finished_job_says_when_and_whose_report_it_has() -> None:
    job = running(after_attempt(running(), cause="lost", reason="silent", now=2.0), "l2")
    done = finished(job, "l2", code="c", verdict="adequate", now=30.0)
    assert (done.state, done.finished_at) == ("done", 30.0)
    assert [(a.ended, a.reason) for a in done.attempts] == [("lost", "silent"), ("done", "")]


@pytest.mark.parametrize(
    ("report", "says"),
    [
        (b"nothing", "report.json is not JSON"),
        (b"\xff\xfe", "report.json is not JSON"),
        (b"[" * 100_000, "report.json is nested too deeply"),
        (b"[]", "report.json must hold an object"),
        (b'{"x": NaN}', "report.json holds NaN"),
        (b'{"x": -Infinity}', "report.json holds -Infinity"),
    ],
)
def test_a_report_that_cannot_be_read_is_told_why(report: bytes, says: str) -> None:
    with pytest.raises(ValueError, match=r"report\.json") as refused:
        parsed(report)
    assert str(refused.value) == says


@pytest.mark.parametrize(("noted", "lately"), [(None, False), (50.0, True), (50.1, False)])
def test_a_worker_is_written_down_again_when_the_last_time_is_long_ago_or_to_come(
    noted: float | None, lately: bool
) -> None:
    assert is_noted(noted, 50.0) is lately
    assert not is_noted(0.0, NOTED_SECONDS) and is_noted(0.0, NOTED_SECONDS - 0.1)


INTERPRET = replace(WAITING, kind=JobKind.INTERPRETATION)


@pytest.mark.parametrize(
    ("job", "bank", "is_for_it"),
    [
        (WAITING, None, True),
        (WAITING, "b1", True),
        (INTERPRET, None, False),
        (INTERPRET, "b1", True),
        (replace(INTERPRET, options={"bank": "b1"}), "b1", True),
        (replace(INTERPRET, options={"bank": "b1"}), "b2", False),
        (replace(INTERPRET, options={"bank": "b1"}), None, False),
        (replace(INTERPRET, options={"posture": 1}), "b2", True),
    ],
)
def test_a_recording_is_interpreted_where_its_bank_is(
    job: CloseLoopJob, bank: str | None, is_for_it: bool
) -> None:
    assert suits(job, bank) is is_for_it


def test_a_job_of_another_kind_or_with_other_options_will_not_do() -> None:
    assert answers(INTERPRET, None, JobKind.INTERPRETATION)
    assert not answers(INTERPRET, None)
    assert not answers(INTERPRET, None, JobKind.INTERPRETATION, {"bank": "b1"})


@pytest.mark.parametrize("name", ["id", "session_id", "state"])
def test_no_report_says_what_the_coordinator_says_of_its_job(name: str) -> None:
    report = json.dumps({"schema": 1, "verdict": "adequate", name: "another's"}).encode()
    with pytest.raises(ValueError, match=f"may not have {name}, which the coordinator says"):
        verdict_of(report)


def interpreted(**changes: object) -> bytes:
    stiffness = {"median": 30, "interval90": [20.5, 41]}
    return json.dumps({"stiffness": stiffness, "familiar": True, **changes}).encode()


def test_an_interpretation_is_familiar_or_not() -> None:
    assert verdict_of(interpreted(), JobKind.INTERPRETATION) == "familiar"
    assert verdict_of(interpreted(familiar=False), JobKind.INTERPRETATION) == "unfamiliar"


@pytest.mark.parametrize(
    "changes",
    [
        {"familiar": None},
        {"familiar": 1},
        {"stiffness": None},
        {"stiffness": [30, 20, 41]},
        {"stiffness": {"median": 30}},
        {"stiffness": {"median": 30, "interval90": 20}},
        {"stiffness": {"median": 30, "interval90": [20]}},
        {"stiffness": {"median": 30, "interval90": [20, 30, 41]}},
        {"stiffness": {"median": None, "interval90": [20, 41]}},
        {"stiffness": {"median": True, "interval90": [20, 41]}},
        {"stiffness": {"median": 30, "interval90": [20, "41"]}},
        {"stiffness": {"interval90": [20, 41]}},
    ],
)
def test_an_interpretation_without_an_interval_is_none(changes: dict[str, object]) -> None:
    with pytest.raises(ValueError) as refused:
        verdict_of(interpreted(**changes), JobKind.INTERPRETATION)
    assert str(refused.value) == (
        "report.json must say stiffness with interval90, and familiar or not"
    )
