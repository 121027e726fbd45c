"""Closing the loop over REST: asked for once, leased, handed in once, read as it was written."""

import json

import pytest
import sqlalchemy as sa
from fastapi import FastAPI
from fastapi.testclient import TestClient

from analysis.closeloop.code import digest
from server.operations import check
from server.store.database.engine import writing
from server.store.database.schema import close_loops as close_loops_table
from tests.testbed.clock import Clock
from tests.testbed.coordinators.close_loop_bodies import (
    REPORT,
    Json,
    asked,
    gone_wrong,
    handed_in,
    held,
    leased,
    shown,
)
from tests.testbed.coordinators.rest_bodies import is_problem


def test_a_report_is_read_as_it_was_handed_in(client: TestClient, session: str) -> None:
    job = asked(client, session)
    assert (job["state"], job["session_id"]) == ("waiting", session)
    lease = held(client)
    assert lease["id"] == job["id"] and lease["session"]["name"] == "monday"
    assert shown(client, job)["worker"] == "w"
    answer = handed_in(client, lease)
    assert (answer.status_code, answer.json()) == (200, {"verdict": "accepted"})
    body = shown(client, job)
    assert body == {**REPORT, "id": job["id"], "session_id": session, "state": "done"}
    assert leased(client) is None
    path = f"/v1/close-loops/{job['id']}"
    assert json.loads(client.get(f"{path}/report.json").content) == REPORT
    assert client.get(f"{path}/residuals.csv").content == b"file,role\n" * 200_000
    assert client.get(f"{path}/model_after.xml").text == "<mujoco/>"


def test_a_page_may_run_nothing_and_ask_nobody(client: TestClient, session: str) -> None:
    job = asked(client, session)
    handed_in(client, held(client))
    answer = client.get(f"/v1/close-loops/{job['id']}/report.html")
    assert answer.headers["content-type"].startswith("text/html")
    policy = answer.headers["content-security-policy"].split("; ")
    assert "sandbox" in policy and "default-src 'none'" in policy
    assert not any("script" in rule or "connect" in rule for rule in policy)
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["content-disposition"].startswith("attachment")


def test_asking_again_finds_the_same_job_unless_it_failed_or_the_code_is_another(
    client: TestClient, session: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = asked(client, session)
    assert asked(client, session)["id"] == job["id"]
    lease = held(client)
    assert asked(client, session)["id"] == job["id"]
    gone_wrong(client, lease, "bad_session")
    second = asked(client, session)
    assert second["id"] != job["id"]
    handed_in(client, held(client))
    # A report of other code than is here now does not do.
    third = asked(client, session)
    assert third["id"] not in (job["id"], second["id"])
    handed_in(client, held(client), code=digest())
    assert asked(client, session)["id"] == third["id"]


def test_progress_is_what_the_worker_last_said(
    client: TestClient, clock: Clock, session: str
) -> None:
    job = asked(client, session)
    note = shown(client, job)["note"]
    assert "no worker that can close loops" in note
    # Pilots and the pods of our manifests are there, and do not.
    assert "`rehyb-worker` without --lifetime" in note
    lease = held(client)
    body = {"lease": lease["lease"], "fence": lease["fence"], "progress": "tracing"}
    clock.advance(50.0)
    path = f"/v1/close-loops/{job['id']}"
    assert client.post(f"{path}/renew", json=body).status_code == 200
    clock.advance(50.0)
    assert leased(client, "other", "pc-2") is None
    now = shown(client, job)
    assert (now["state"], now["progress"], now["worker"]) == ("running", "tracing", "w")
    assert "note" not in now


def test_what_was_seen_need_not_be_sent_again(client: TestClient, session: str) -> None:
    job = asked(client, session)
    path = f"/v1/close-loops/{job['id']}"
    seen: list[str] = []

    def changed() -> bool:
        known = {"If-None-Match": seen[-1]} if seen else {}
        answer = client.get(path, headers=known)
        seen.append(answer.headers["etag"])
        return answer.status_code == 200

    assert changed() and not changed()
    lease = held(client)
    assert changed() and not changed()
    proof = {"lease": lease["lease"], "fence": lease["fence"]}
    client.post(f"{path}/renew", json={**proof, "progress": "reading"})
    assert changed() and not changed()
    handed_in(client, lease)
    assert changed() and not changed()


def test_a_session_with_a_report_can_be_deleted(client: TestClient, session: str) -> None:
    asked(client, session)
    handed_in(client, held(client))
    assert client.delete(f"/v1/sessions/{session}").status_code == 204


def test_jobs_are_streamed_until_they_end(client: TestClient, session: str) -> None:
    job = asked(client, session)
    gone_wrong(client, held(client), "bad_session")
    with client.stream("GET", f"/v1/close-loops/{job['id']}/events") as stream:
        (told,) = [line for line in stream.iter_lines() if line.startswith("data: ")]
    assert json.loads(told.removeprefix("data: "))["state"] == "failed"
    is_problem(client.get("/v1/close-loops/nowhere/events"), 404)


def test_prometheus_counts_jobs_by_state(client: TestClient, session: str) -> None:
    asked(client, session)
    assert 'rehyb_close_loops{state="waiting"} 1.0' in client.get("/metrics").text


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"state": "done"}, "it is done with 0 of 4 files"),
        ({"verdict": "adequate"}, "it is running with a verdict"),
        ({"expires_at": None}, "it is running without an end of its lease"),
        ({"state": "waiting", "expires_at": None}, "it is waiting with 1 attempts under way"),
    ],
)
def test_the_check_of_a_database_finds_jobs_that_contradict_themselves(
    client: TestClient, app: FastAPI, session: str, changes: Json, fault: str
) -> None:
    job = asked(client, session)
    held(client)
    with writing(app.state.engine) as connection:
        before = connection.execute(sa.select(close_loops_table)).one()._mapping
        connection.execute(sa.update(close_loops_table).values(changes))
    assert f"close-loop {job['id']}: {fault}" in check.faults(app.state.engine)
    with writing(app.state.engine) as connection:
        connection.execute(sa.update(close_loops_table).values(before))
