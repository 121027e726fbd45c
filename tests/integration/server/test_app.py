"""What the coordinator does unasked, and when."""

import asyncio
import threading
from itertools import count
from typing import Any

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from pydantic import SecretStr

from server import app as web
from server.errors import NotFoundError, SchemaError
from server.metrics import Metrics
from server.records import Plan
from server.settings import Settings
from server.store.database.engine import writing
from tests.testbed.clock import Clock
from tests.testbed.coordinators.rest_bodies import STUDY, asking


def test_rows_are_freed_only_by_who_has_listened_for_that_long(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = [1000.0]
    freed_at: list[float] = []

    async def sleep(seconds: float) -> None:
        now[0] += seconds
        if now[0] > 1200.0:
            raise asyncio.CancelledError

    async def here(call: Any, *given: Any, **named: Any) -> Any:
        return call(*given, **named)

    def free(_engine: object, **_: float) -> int:
        freed_at.append(now[0])
        return 0

    monkeypatch.setattr(web, "monotonic", lambda: now[0])
    monkeypatch.setattr(web.asyncio, "sleep", sleep)
    monkeypatch.setattr(web.asyncio, "to_thread", here)
    asked = count(1)

    def sweep() -> int:
        if next(asked) == 2:
            raise NotFoundError("a study was deleted meanwhile")
        return 0

    monkeypatch.setattr(web.close_loop_operations, "reap", lambda *_, **__: 0)
    monkeypatch.setattr(web.comparisons, "give_up", lambda *_, **__: None)
    monkeypatch.setattr(web.reruns, "free_stranded_rows", free)
    engine: Any = None
    swept: Any = sweep
    settings = Settings(token=SecretStr("t" * 16), lease_seconds=60.0, stranded_seconds=100.0)
    with pytest.raises(asyncio.CancelledError):
        measures = Metrics(engine, lambda: now[0])
        asyncio.run(web._reap_for_ever(swept, engine, measures, lambda: now[0], settings))
    # Looks every 15 s, from 1000 on; the first after 100 s is at 1105.
    assert freed_at == [1105.0, 1120.0, 1135.0, 1150.0, 1165.0, 1180.0, 1195.0]


def test_who_refuses_to_start_leaves_no_connection_open(app: FastAPI) -> None:
    engine = app.state.engine
    with writing(engine) as connection:
        connection.exec_driver_sql("UPDATE alembic_version SET version_num = '9999'")
    pool = engine.pool
    assert pool.checkedin() == 1
    with pytest.raises(SchemaError), TestClient(app):
        pass
    assert pool.checkedin() == 0


def test_leases_live_on_a_clock_that_cannot_be_set_back(
    upgraded: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    app = web.create_app(Settings(database_url=upgraded, token=SecretStr("t")))
    before = app.state.clock()
    monkeypatch.setattr("time.time", lambda: before - 3600.0)
    assert 0.0 <= app.state.clock() - before < 600.0
    app.state.engine.dispose()


def test_a_coordinator_goes_on_from_the_latest_time_that_it_knows(
    app: FastAPI, clock: Clock
) -> None:
    who = {"worker": {"id": "w", "host": "h"}, "models": ["ishigami"], "max_instances": 1}
    with TestClient(app, headers={"Authorization": "Bearer correct-horse"}) as client:
        client.post("/v1/leases", json=who)
    last = clock.now
    clock.advance(-3600.0)
    again = web.create_app(app.state.settings)
    again.state.clock = clock
    with TestClient(again):
        assert again.state.clock() == last
        clock.advance(2.0)
        assert again.state.clock() == last + 2.0


def test_a_coordinator_follows_another_of_its_database_whose_clock_is_ahead(
    app: FastAPI, clock: Clock
) -> None:
    who = {"worker": {"id": "w", "host": "h"}, "models": ["ishigami"], "max_instances": 1}
    other = web.create_app(app.state.settings)
    other.state.clock = ahead = Clock()
    ahead.now = clock.now + 3600.0
    token = {"Authorization": "Bearer correct-horse"}
    with TestClient(app, headers=token) as client, TestClient(other, headers=token) as beside:
        assert app.state.clock() == clock.now
        beside.post("/v1/leases", json=who)
        client.post("/v1/leases", json=who)
        assert app.state.clock() == ahead.now


def test_a_coordinator_that_begins_with_a_clock_ahead_ends_no_lease_of_the_one_behind(
    app: FastAPI, clock: Clock
) -> None:
    other = web.create_app(app.state.settings)
    other.state.clock = ahead = Clock()
    ahead.now = clock.now + 3600.0
    token = {"Authorization": "Bearer correct-horse"}
    with TestClient(app, headers=token) as client, TestClient(other, headers=token) as beside:
        client.post("/v1/studies", json=STUDY)
        held = client.post("/v1/leases", json=asking(max_instances=1)).json()
        for _ in range(6):
            for one in (beside, client):
                one.post("/v1/leases", json=asking(models=["sobol_g"]))
            renewal = client.post(f"/v1/leases/{held['id']}/renew", json={"fence": held["fence"]})
            assert renewal.status_code == 200
            clock.advance(15.0)
            ahead.advance(15.0)


def test_no_lease_is_the_first_to_draw_a_row(
    upgraded: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[str] = []

    def parameters(plan: Plan, row: int) -> None:
        drawn.append(f"{plan.sampling} {row} on {threading.current_thread().name}")

    monkeypatch.setattr("server.routes.study.studies.parameters", parameters)
    monkeypatch.setattr("server.operations.study.studies.parameters", parameters)
    settings = Settings(database_url=upgraded, token=SecretStr("t"))
    headers = {"Authorization": "Bearer t"}
    with TestClient(web.create_app(settings), headers=headers) as client:
        assert drawn == []
        study = {"name": "s", "model": "ishigami", "method": "saltelli", "sampling": "sobol"}
        for rows in (8, 16):
            answer = client.post("/v1/studies", json={**study, "rows": rows, "seed": 1})
            assert answer.status_code == 201, answer.text
    with TestClient(web.create_app(settings), headers=headers):
        pass
    # In threads, that is: each when it is submitted, and one when a coordinator starts again.
    assert [what.split(" on ")[0] for what in drawn] == ["sobol 0"] * 3
    assert not any("asyncio-portal" in what for what in drawn)
