"""Closing the loop over REST: asked for once, leased, handed in once, read as it was written."""

import io
import json
from collections.abc import Iterator
from typing import Any

import pytest
import sqlalchemy as sa
from fastapi import FastAPI
from fastapi.testclient import TestClient

from analysis.closeloop.code import digest
from analysis.closeloop.contract import REPORT_FILES
from server.operations import check, sessions
from server.operations.fleet import leases
from server.store.database.engine import writing
from server.store.database.schema import close_loops as close_loops_table
from tests.testbed.clock import Clock
from tests.testbed.coordinators.rest_bodies import is_problem

Json = dict[str, Any]

REPORT: Json = {
    "schema": 1,
    "verdict": "effect_found",
    "effects": [{"name": "coulomb_friction", "parameters": {"torque": {"value": 0.1 + 0.2}}}],
    "session": {"folder": "monday"},
}
CODE = "0123456789abcdef"


@pytest.fixture(autouse=True)
def whole(client: TestClient, app: FastAPI) -> Iterator[None]:
    """Whatever a test has done to it, the database is whole."""
    yield
    assert check.faults(app.state.engine) == []


@pytest.fixture
def session(client: TestClient, app: FastAPI) -> str:
    """The id of a session that was uploaded."""
    kept, _ = sessions.create(
        app.state.engine,
        io.BytesIO(b"PK1"),
        name="monday",
        sha256="c4ed0a17fd5e6dc3dc9ff3ff2ca1ea10bdb7b03f8d7c0a40e2ea6e6bb8e9e1a0",
        size=3,
        content={},
        now=1.0,
    )
    return kept.id


@pytest.fixture(autouse=True)
def same_digest(monkeypatch: pytest.MonkeyPatch) -> None:
    """The session of these tests is no zip file: its digest is taken on trust."""
    monkeypatch.setattr(check, "_session_faults", lambda engine: ())


def asked(client: TestClient, session: str) -> Json:
    answer = client.post(f"/v1/sessions/{session}/close-loop")
    assert answer.status_code == 202
    job: Json = answer.json()
    assert answer.headers["location"] == f"/v1/close-loops/{job['id']}"
    return job


def leased(client: TestClient, worker: str = "w", host: str = "pc-1") -> Json | None:
    body = {"worker": {"id": worker, "host": host, "versions": {"mujoco": "4.0.1"}}}
    answer = client.post("/v1/close-loops/lease", json=body)
    assert answer.status_code in (201, 204)
    return answer.json() if answer.status_code == 201 else None


def held(client: TestClient, worker: str = "w", host: str = "pc-1") -> Json:
    lease = leased(client, worker, host)
    assert lease is not None
    return lease


def handed_in(
    client: TestClient,
    lease: Json,
    *,
    report: Any = REPORT,
    worker: str = "w",
    lacking: str = "",
    **changes: Any,
) -> Any:
    proof = {"lease": lease["lease"], "fence": lease["fence"], "worker": worker, "code": CODE}
    text = report if isinstance(report, bytes) else json.dumps(report).encode()
    contents = {"report.json": text, "report.html": b"<p>", "model_after.xml": b"<mujoco/>"}
    contents["residuals.csv"] = b"file,role\n" * 200_000
    files = {name: (name, contents[name]) for name in REPORT_FILES if name != lacking}
    path = f"/v1/close-loops/{lease['id']}/report"
    return client.post(path, params={**proof, **changes}, files=files)


def gone_wrong(client: TestClient, lease: Json, outcome: str, worker: str = "w", **say: Any) -> Any:
    body = {"lease": lease["lease"], "fence": lease["fence"], "worker": worker}
    body |= {"outcome": outcome, "reason": f"it {outcome}", **say}
    return client.post(f"/v1/close-loops/{lease['id']}/failure", json=body)


def shown(client: TestClient, job: Json) -> Json:
    answer: Json = client.get(f"/v1/close-loops/{job['id']}").json()
    return answer


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
    assert "no worker that can close loops" in shown(client, job)["note"]
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
