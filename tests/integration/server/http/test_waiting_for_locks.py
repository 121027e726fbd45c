"""Nobody waits for a lock for longer than a worker waits for an answer, however many do."""

import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import pytest
import sqlalchemy as sa
from fastapi.testclient import TestClient
from pydantic import SecretStr
from sqlalchemy.engine import Engine

from server.app import create_app
from server.settings import Settings
from tests.testbed.coordinators.rest_bodies import STUDY, asking, is_problem

SECONDS = 2
TOKEN = {"Authorization": "Bearer t"}


@contextmanager
def kept_by_another(engine: Engine) -> Iterator[None]:
    """Somebody keeps what leases change until the block ends."""
    own = sa.create_engine(engine.url)
    with own.connect() as connection:
        if engine.dialect.name == "sqlite":
            connection.exec_driver_sql("BEGIN IMMEDIATE")
        else:
            connection.exec_driver_sql("LOCK TABLE instances IN ACCESS EXCLUSIVE MODE")
        yield
        connection.rollback()
    own.dispose()


@pytest.mark.parametrize("count", [1, 4])
def test_workers_are_told_to_wait_once_a_lock_was_waited_for_as_long_as_may_be(
    upgraded: str, monkeypatch: pytest.MonkeyPatch, count: int
) -> None:
    monkeypatch.setattr("server.store.database.engine.LOCK_SECONDS", SECONDS)
    app = create_app(Settings(database_url=upgraded, token=SecretStr("t")))
    with TestClient(app, headers=TOKEN, raise_server_exceptions=False) as client:
        client.post("/v1/studies", json=STUDY)
        lease = client.post("/v1/leases", json=asking(max_instances=1)).json()

        def seconds(number: int) -> float:
            """How long a lease takes, or a thread's transaction."""
            begun = time.monotonic()
            if number % 2 == 0:
                response = client.post("/v1/leases", json=asking(max_instances=1))
            else:
                response = client.post("/v1/studies", json={**STUDY, "name": str(number)})
            assert response.status_code == 201 or is_problem(response, 503)
            return time.monotonic() - begun

        with kept_by_another(app.state.engine), ThreadPoolExecutor(count) as threads:
            longest = max(threads.map(seconds, range(count)))
        assert longest < SECONDS * 1.75
        path = f"/v1/leases/{lease['id']}/renew"
        assert client.post(path, json={"fence": lease["fence"]}).status_code == 200
