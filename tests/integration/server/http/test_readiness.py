"""`/readyz` says 503 while no worker could be served, says why, and says so soon."""

import asyncio
import sqlite3
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
import sqlalchemy as sa
from fastapi.testclient import TestClient
from pydantic import SecretStr
from sqlalchemy.engine import Engine

from server.app import create_app
from server.operations import tokens
from server.operations.fleet.sweep import SWEEP_SECONDS
from server.operations.readiness import GOOD_SECONDS, LOOK_SECONDS, Readiness
from server.settings import Settings
from server.store.database.engine import writing
from tests.testbed.coordinators.rest_bodies import STUDY, Json, asking, is_problem, posting, result

on_postgresql = pytest.mark.parametrize("kind", ["postgresql"])
on_sqlite = pytest.mark.parametrize("kind", ["sqlite"])


def said(client: TestClient) -> str:
    """What `/readyz` objects; empty: nothing."""
    response = client.get("/readyz")
    if response.status_code == 200:
        return ""
    assert is_problem(response, 503) and int(response.headers["Retry-After"]) > 0
    return str(response.json()["detail"])


@contextmanager
def another(engine: Engine, statement: str) -> Iterator[None]:
    """A session that has executed a statement, in a transaction that lasts as long as the block."""
    # Of the test's own: that of the coordinator waits for no lock for long.
    own = sa.create_engine(engine.url)
    with own.connect() as connection:
        connection.execute(sa.text(statement))
        yield
    own.dispose()


@on_postgresql
@pytest.mark.parametrize(
    "table",
    [
        *("studies", "workers", "leases", "instances", "results", "comparisons"),
        *("tokens", "loop_workers", "models"),
    ],
)
def test_while_another_session_locks_a_table_that_workers_need_it_is_not_ready(
    client: TestClient, engine: Engine, table: str
) -> None:
    with another(engine, f"LOCK TABLE {table} IN ACCESS EXCLUSIVE MODE"):
        begun = time.monotonic()
        assert "another session keeps a table locked" in said(client)
        assert time.monotonic() - begun < LOOK_SECONDS
    assert said(client) == ""


@on_postgresql
def test_a_session_that_makes_an_index_lets_nobody_write_so_it_is_not_ready(
    client: TestClient, engine: Engine
) -> None:
    with another(engine, "LOCK TABLE leases IN SHARE MODE"):
        assert "another session keeps a table locked" in said(client)


@on_postgresql
@pytest.mark.parametrize(
    ("table", "mode"), [("tokens", "SHARE"), ("snapshots", "ACCESS EXCLUSIVE")]
)
def test_a_lock_that_keeps_no_worker_waiting_does_not_make_it_unready(
    client: TestClient, engine: Engine, table: str, mode: str
) -> None:
    with another(engine, f"LOCK TABLE {table} IN {mode} MODE"):
        assert said(client) == ""


@on_postgresql
@pytest.mark.parametrize(
    ("table", "waits"), [("tokens", "asked"), ("loop_workers", "there"), ("leases", "there")]
)
def test_a_lease_that_waited_for_a_lock_in_vain_is_told_of_afterwards_wherever_it_waited(
    upgraded: str, monkeypatch: pytest.MonkeyPatch, table: str, waits: str
) -> None:
    monkeypatch.setattr("server.store.database.engine.LOCK_SECONDS", 1)
    app = create_app(Settings(database_url=upgraded, token=SecretStr("t")))
    _, secret = tokens.create(app.state.engine, name="w", scopes=["work"], now=1.0)
    bearer = {"Authorization": f"Bearer {secret}"}
    with TestClient(app, raise_server_exceptions=False) as client:
        client.post("/v1/studies", json=STUDY, headers={"Authorization": "Bearer t"})
        if waits == "there":
            # It is known already who asks.
            client.get("/v1/work", headers=bearer)
            time.sleep(SWEEP_SECONDS)
        with another(app.state.engine, f"LOCK TABLE {table} IN ACCESS EXCLUSIVE MODE"):
            response = client.post("/v1/leases", json=asking(), headers=bearer)
            assert is_problem(response, 503)
        assert "the last lease failed: canceling statement due to lock timeout" in said(client)
        assert client.post("/v1/leases", json=asking(), headers=bearer).status_code == 201
        assert said(client) == ""


@on_postgresql
def test_a_session_that_reads_all_or_keeps_a_row_to_itself_does_not_make_it_unready(
    client: TestClient, engine: Engine
) -> None:
    client.post("/v1/studies", json=STUDY)
    with another(engine, "SELECT * FROM studies FOR UPDATE"):
        assert said(client) == ""


@on_postgresql
def test_looking_hinders_nobody_who_works_at_the_same_time(
    client: TestClient, engine: Engine
) -> None:
    client.post("/v1/studies", json=STUDY)
    lease = client.post("/v1/leases", json=asking()).json()
    with another(engine, "LOCK TABLE studies, leases, results IN ROW EXCLUSIVE MODE"):
        assert said(client) == ""
        posted = posting(lease, [result(one) for one in lease["instances"]])
        assert client.post("/v1/results", json=posted).status_code == 200


@on_postgresql
def test_however_many_ask_while_a_table_is_locked_all_hear_it_within_one_look(
    engine: Engine, kind: str
) -> None:
    readiness = Readiness(engine)

    async def all_ask() -> list[str | None]:
        return await asyncio.gather(*(readiness.objection() for _ in range(20)))

    with another(engine, "LOCK TABLE studies IN ACCESS EXCLUSIVE MODE"):
        begun = time.monotonic()
        (heard,) = {*asyncio.run(all_ask())}
        assert heard is not None and "keeps a table locked" in heard
        assert time.monotonic() - begun < LOOK_SECONDS
    readiness.close()


@on_sqlite
def test_a_database_that_does_not_answer_in_time_is_not_ready_until_it_does(
    engine: Engine, kind: str
) -> None:
    readiness = Readiness(engine, look_seconds=0.2)
    with closing(sqlite3.connect(str(engine.url.database), isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        for _ in range(2):
            heard = asyncio.run(readiness.objection())
            assert heard == "it did not answer within 0.2 s"
        other.execute("ROLLBACK")
    deadline = time.monotonic() + 10.0
    while asyncio.run(readiness.objection()) is not None:
        assert time.monotonic() < deadline
    readiness.close()


@on_sqlite
@pytest.mark.parametrize("instead", [False, True])
def test_while_its_file_is_elsewhere_it_is_not_ready_and_takes_nothing_that_would_be_lost(
    client: TestClient, engine: Engine, instead: bool
) -> None:
    client.post("/v1/studies", json={**STUDY, "rows": 20})
    lease = client.post("/v1/leases", json=asking(max_instances=4)).json()
    body = posting(lease, [result(one) for one in lease["instances"]])
    path = Path(str(engine.url.database))
    path.rename(path.with_name("gone"))
    if instead:
        path.touch()
    time.sleep(GOOD_SECONDS)
    assert "its file was moved, removed or replaced since it was opened" in said(client)
    for answer in (
        client.post("/v1/results", json=body),
        client.post("/v1/leases", json=asking()),
        client.post("/v1/studies", json=STUDY),
    ):
        assert is_problem(answer, 503)
    # Nor is a new one made in its place.
    assert path.exists() is instead
    path.with_name("gone").rename(path)
    assert client.post("/v1/results", json=body).status_code == 200
    assert client.post("/v1/leases", json=asking()).status_code == 201
    assert said(client) == ""
    assert len(client.get("/v1/studies").json()["studies"]) == 1


def no_room_for_results(engine: Engine, yes: bool) -> None:
    """Have every result refused as PostgreSQL refuses what its disk has no room for, or none."""
    with writing(engine) as connection:
        if not yes:
            connection.exec_driver_sql("DROP FUNCTION no_room CASCADE")
            return
        connection.exec_driver_sql(
            "CREATE FUNCTION no_room() RETURNS trigger LANGUAGE plpgsql AS "
            "'BEGIN RAISE EXCEPTION ''could not extend file: No space left on device'' "
            "USING ERRCODE = ''53100''; END'"
        )
        connection.exec_driver_sql(
            "CREATE TRIGGER no_room BEFORE INSERT ON results EXECUTE FUNCTION no_room()"
        )


@on_postgresql
@pytest.mark.parametrize("further", [{}, {"next": asking()}])
def test_while_the_disk_has_no_room_for_results_it_is_not_ready_though_leases_are_served(
    client: TestClient, engine: Engine, further: Json
) -> None:
    client.post("/v1/studies", json={**STUDY, "rows": 20})
    lease = client.post("/v1/leases", json=asking(max_instances=4)).json()
    body = posting(lease, [result(one) for one in lease["instances"]], **further)
    no_room_for_results(engine, True)
    try:
        assert is_problem(client.post("/v1/results", json=body), 503)
        assert client.post("/v1/leases", json=asking(max_instances=4)).status_code == 201
        assert "the last post of results failed: could not extend file" in said(client)
    finally:
        no_room_for_results(engine, False)
    assert client.post("/v1/results", json=body).status_code == 200
    assert said(client) == ""
