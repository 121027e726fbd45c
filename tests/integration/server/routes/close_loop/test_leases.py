"""Leases of close-loop jobs over REST: silence, failures, and reports that are none."""

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient

from analysis.closeloop.contract import REPORT_FILES
from server.operations.fleet import leases
from tests.testbed.clock import Clock
from tests.testbed.coordinators.close_loop_bodies import (
    REPORT,
    asked,
    gone_wrong,
    handed_in,
    held,
    leased,
    shown,
)
from tests.testbed.coordinators.rest_bodies import is_problem


def test_silence_hands_the_job_to_another_and_a_late_report_still_counts(
    client: TestClient, clock: Clock, session: str
) -> None:
    job = asked(client, session)
    first = held(client, "w", "pc-1")
    clock.advance(61.0)
    proof = {"lease": first["lease"], "fence": first["fence"]}
    second = held(client, "v", "pc-2")
    assert second["fence"] > first["fence"] and second["lease"] != first["lease"]
    path = f"/v1/close-loops/{job['id']}"
    is_problem(client.post(f"{path}/renew", json=proof), 409)
    assert handed_in(client, first).json() == {"verdict": "accepted"}
    other = {**REPORT, "verdict": "adequate"}
    assert handed_in(client, second, report=other, worker="v").json() == {"verdict": "duplicate"}
    assert shown(client, job)["verdict"] == "effect_found"
    renewal = {"lease": second["lease"], "fence": second["fence"]}
    is_problem(client.post(f"{path}/renew", json=renewal), 409)


def test_a_form_with_too_many_files_is_told_which_ones_a_report_has(
    client: TestClient, session: str
) -> None:
    asked(client, session)
    lease = held(client)
    path = f"/v1/close-loops/{lease['id']}/report"
    proof = {"lease": lease["lease"], "fence": lease["fence"], "worker": "w", "code": "0" * 16}
    doubled = [(name, (name, b"x")) for name in (*REPORT_FILES, "report.html")]
    answer = client.post(path, params=proof, files=doubled)
    is_problem(answer, 400)
    assert "The form must have the files report.json, " in answer.json()["detail"]
    assert answer.json()["detail"].endswith("each once.")
    for headers in ({}, {"Content-Type": "text/plain"}):
        detail = is_problem(client.post(path, params=proof, content=b"x", headers=headers), 415)
        assert detail["detail"].endswith("send multipart/form-data")
    answer = client.post("/v1/sessions", files=doubled)
    is_problem(answer, 400)
    assert "The form must have one file" in answer.json()["detail"]


def test_only_who_holds_a_lease_is_heard(client: TestClient, session: str) -> None:
    job = asked(client, session)
    lease = held(client)
    for changes in ({"fence": 2}, {"lease": "made up"}, {"worker": "thief"}):
        said = {"worker": "w", **changes}
        worker = said.pop("worker")
        forged = {**lease, **said}
        is_problem(handed_in(client, forged, worker=worker), 409)
        is_problem(gone_wrong(client, forged, "bad_session", worker), 409)
    proof = {"lease": lease["lease"], "fence": 9}
    for verb in ("renew", "release"):
        is_problem(client.post(f"/v1/close-loops/{job['id']}/{verb}", json=proof), 409)
    assert shown(client, job)["state"] == "running"
    other = {**lease, "id": "nowhere"}
    is_problem(handed_in(client, other), 404)
    is_problem(gone_wrong(client, other, "crashed"), 404)


def test_a_released_job_waits_again_and_nothing_is_counted(
    client: TestClient, session: str
) -> None:
    job = asked(client, session)
    lease = held(client)
    proof = {"lease": lease["lease"], "fence": lease["fence"]}
    for _ in range(2):
        path = f"/v1/close-loops/{job['id']}/release"
        answer = client.post(path, json=proof)
        # The second time nobody remembers it, and no harm is done.
        assert answer.status_code in (200, 409)
    now = shown(client, job)
    assert (now["state"], now["attempts"]) == ("waiting", [])
    assert held(client)["fence"] > lease["fence"]


def test_what_went_wrong_on_a_host_goes_to_another_if_there_is_one(
    client: TestClient, clock: Clock, session: str
) -> None:
    asked(client, session)
    assert gone_wrong(client, held(client), "crashed").json() == {"verdict": "accepted"}
    # Nobody else is there.
    assert gone_wrong(client, held(client), "crashed").json() == {"verdict": "accepted"}
    lease = held(client)
    assert leased(client, "v", "pc-2") is None
    clock.advance(59.0)
    gone_wrong(client, lease, "timed_out")
    assert leased(client) is None
    clock.advance(2.0)
    # The other has fallen silent.
    assert held(client)["fence"] == 4
    clock.advance(61.0)
    assert held(client, "v", "pc-2")["fence"] == 5


@pytest.mark.parametrize(("outcome", "tries"), [("crashed", 3), ("timed_out", 3)])
def test_a_session_that_kills_its_workers_fails_in_the_end(
    client: TestClient, session: str, outcome: str, tries: int
) -> None:
    job = asked(client, session)
    for _ in range(tries):
        lease = held(client)
        gone_wrong(client, lease, outcome)
    assert leased(client) is None
    now = shown(client, job)
    assert (now["state"], now["problem"]["outcome"]) == ("failed", outcome)
    assert (now["problem"]["status"], now["problem"]["detail"]) == (500, f"it {outcome}")
    assert [attempt["ended"] for attempt in now["attempts"]] == [outcome] * tries
    # What it said of an attempt that has ended no longer counts.
    assert gone_wrong(client, lease, outcome).json() == {"verdict": "duplicate"}
    is_problem(client.get(f"/v1/close-loops/{job['id']}/report.json"), 404)


def test_a_session_that_cannot_be_analysed_is_a_problem_with_its_sentence(
    client: TestClient, session: str
) -> None:
    job = asked(client, session)
    place = {"file": "a.csv", "column": "time\0", "line": 3}
    gone_wrong(client, held(client), "bad_session", reason="a.csv, column time: \0no", **place)
    now = shown(client, job)
    assert now["state"] == "failed"
    problem = now["problem"]
    assert (problem["status"], problem["detail"]) == (422, "a.csv, column time: no")
    assert (problem["file"], problem["column"], problem["line"]) == ("a.csv", "time", 3)


@pytest.mark.parametrize(
    ("report", "why"),
    [
        (b"", "not JSON"),
        (b"[]", "must hold an object"),
        (b'{"schema": 1, "verdict": "fine"}', "a verdict of"),
        (b'{"schema": 1, "verdict": "adequate", "x": NaN}', "holds NaN"),
        (b"[" * 100_000, "nested too deeply"),
        (b"\xff", "not JSON"),
    ],
)
def test_a_report_that_makes_no_sense_is_refused_and_counted(
    client: TestClient, session: str, report: bytes, why: str
) -> None:
    job = asked(client, session)
    problem = is_problem(handed_in(client, held(client), report=report), 422)
    assert why in problem["detail"]
    now = shown(client, job)
    assert (now["state"], now["attempts"][0]["ended"]) == ("waiting", "invalid")


def test_a_report_without_all_its_files_or_too_large_is_refused(
    client: TestClient, app: FastAPI, session: str
) -> None:
    job = asked(client, session)
    lease = held(client)
    is_problem(handed_in(client, lease, lacking="report.html"), 422)
    large = b" " * app.state.settings.session_bytes
    assert "SESSION_BYTES" in is_problem(handed_in(client, lease, report=large), 413)["detail"]
    assert shown(client, job)["state"] == "running"
    assert handed_in(client, lease).status_code == 200


def test_a_coordinator_that_was_away_excuses_silence(
    client: TestClient, app: FastAPI, clock: Clock, session: str
) -> None:
    job = asked(client, session)
    held(client)
    clock.advance(1000.0)
    leases.extend_open_leases(app.state.engine, now=clock(), ttl=60.0)
    assert leased(client, "v", "pc-2") is None
    assert shown(client, job)["state"] == "running"


def test_what_a_deleted_session_s_worker_says_is_not_found(
    client: TestClient, session: str
) -> None:
    job = asked(client, session)
    lease = held(client)
    assert client.delete(f"/v1/sessions/{session}").status_code == 204
    proof = {"lease": lease["lease"], "fence": lease["fence"]}
    is_problem(client.post(f"/v1/close-loops/{job['id']}/renew", json=proof), 404)
    is_problem(handed_in(client, lease), 404)
    is_problem(client.get(f"/v1/close-loops/{job['id']}"), 404)
    is_problem(client.post(f"/v1/sessions/{session}/close-loop"), 404)
