"""A PostgreSQL that falls silent keeps nobody waiting for ever, and one that is at work does."""

import asyncio
import os
import signal
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import psutil
import pytest
import sqlalchemy as sa
from fastapi.testclient import TestClient
from pydantic import SecretStr
from sqlalchemy.engine import Engine
from sqlalchemy.exc import DBAPIError

from server.app import create_app
from server.settings import Settings
from server.store import create_engine
from server.store.database import pipeline as pipelines
from server.store.database import silence
from server.store.database.engine import LOCK_SECONDS, reading, writing
from server.store.database.pipeline import Pipeline
from server.store.database.presence import Presence, why_away
from tests.testbed.coordinators.cable import Cable
from tests.testbed.coordinators.rest_bodies import STUDY, asking, is_problem, posting, result
from worker.cli import PATIENCE_SECONDS

GONE = "and its server takes no connections"


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (silence, pipelines):
        monkeypatch.setattr(module, "SILENT_SECONDS", 0.2)
    monkeypatch.setattr(silence, "LOOK_SECONDS", 0.3)
    monkeypatch.setitem(silence.NETWORK_LIMITS, "connect_timeout", 1)


@pytest.fixture
def url(upgraded_database: Callable[[], str]) -> str:
    return upgraded_database()


@pytest.fixture
def cable(url: str) -> Iterator[Cable]:
    cable = Cable(url)
    yield cable
    cable.close()


@pytest.fixture
def engine(cable: Cable) -> Iterator[Engine]:
    """The way to a database by the cable."""
    engine = create_engine(cable.url)
    yield engine
    engine.dispose()


def ask(engine: Engine, what: str = "SELECT 1") -> Any:
    with reading(engine) as connection:
        return connection.scalar(sa.text(what))


def refused(act: Callable[[], object], seconds: float) -> str:
    """Return why an act is refused, which takes so long at most."""
    begun = time.monotonic()
    with pytest.raises(DBAPIError) as caught:
        act()
    assert time.monotonic() - begun < seconds
    return str(why_away(caught.value))


@contextmanager
def stopped(backend: int) -> Iterator[None]:
    """Stop a process of the server for as long as a block lasts."""
    with suppress(psutil.NoSuchProcess):
        if psutil.Process(backend).name().startswith("postgres"):
            os.kill(backend, signal.SIGSTOP)
            try:
                yield
            finally:
                os.kill(backend, signal.SIGCONT)
            return
    pytest.skip("the server is on another machine")


@pytest.mark.parametrize(("said", "idle"), [("", 10), ("?keepalives_idle=77", 77)])
def test_the_network_notices_within_seconds_unless_the_url_says_otherwise(
    url: str, said: str, idle: int
) -> None:
    engine = create_engine(url + said)
    with engine.connect() as connection:
        driver: Any = connection.connection.driver_connection
        there = socket.socket(fileno=os.dup(driver.fileno()))
        options = [
            there.getsockopt(socket.IPPROTO_TCP, option)
            for option in (
                socket.TCP_KEEPIDLE,
                socket.TCP_KEEPINTVL,
                socket.TCP_KEEPCNT,
                socket.TCP_USER_TIMEOUT,
            )
        ]
        there.close()
    engine.dispose()
    assert options == [idle, 5, 2, 20_000]


def test_who_waits_for_a_server_that_is_silent_is_told_and_all_goes_on_when_it_is_back(
    engine: Engine, cable: Cable
) -> None:
    def ask_in_the_midst() -> None:
        with reading(engine) as connection:
            cable.silent = True
            connection.scalar(sa.text("SELECT 1"))

    assert ask(engine) == 1
    assert GONE in refused(ask_in_the_midst, 6.0)
    for _ in range(2):
        assert refused(lambda: ask(engine), 6.0)
    cable.mend()
    assert ask(engine) == 1


def test_a_trip_to_a_server_that_is_silent_ends_and_one_that_takes_long_does_not(
    engine: Engine, cable: Cable
) -> None:
    held = engine.raw_connection()
    driver: Any = held.driver_connection
    driver.autocommit = True

    async def work() -> None:
        pipeline = Pipeline(driver)
        assert await pipeline.trip([("SELECT pg_sleep(1.0)", ()), ("SELECT 7", ())])
        cable.silent = True
        with pytest.raises(silence.SilentError, match=GONE):
            await asyncio.wait_for(pipeline.trip([("SELECT 7", ())]), 6.0)
        with pytest.raises(silence.SilentError, match=GONE):
            await pipeline.trip([("SELECT 7", ())])

    asyncio.run(work())
    held.invalidate()
    held.close()


def test_a_statement_that_takes_long_is_waited_for_while_its_server_takes_connections(
    engine: Engine,
) -> None:
    assert ask(engine, "SELECT 7 FROM pg_sleep(1.5)") == 7


def test_a_process_of_the_server_that_stands_still_is_given_up_in_the_end(
    engine: Engine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(silence, "LONGEST_SECONDS", 1.0)
    monkeypatch.setattr(pipelines, "TRIP_SECONDS", 1.0)

    def ask_who_stands_still() -> None:
        which = sa.text("SELECT pg_backend_pid()")
        with reading(engine) as connection, stopped(connection.scalar(which)):
            connection.scalar(sa.text("SELECT 1"))

    assert refused(ask_who_stands_still, 6.0) == "it did not answer for 1 s"
    held = engine.raw_connection()
    driver: Any = held.driver_connection

    async def trip() -> None:
        with pytest.raises(silence.SilentError, match="did not answer for 1 s"):
            await asyncio.wait_for(Pipeline(driver).trip([("SELECT 7", ())]), 6.0)

    with stopped(driver.info.backend_pid):
        asyncio.run(trip())
    held.invalidate()
    held.close()


def test_requests_to_a_coordinator_whose_database_is_silent_get_503_and_lose_nothing(
    cable: Cable, caplog: pytest.LogCaptureFixture
) -> None:
    app = create_app(Settings(database_url=cable.url, token=SecretStr("t")))
    with TestClient(app, headers={"Authorization": "Bearer t"}) as client:
        study = client.post("/v1/studies", json=STUDY).json()["id"]
        lease: Any = client.post("/v1/leases", json=asking(max_instances=4)).json()
        body = posting(lease, [result(instance) for instance in lease["instances"]])
        cable.silent = True
        for act in (
            lambda: client.post("/v1/results", json=body),
            lambda: client.post("/v1/leases", json=asking()),
            lambda: client.get(f"/v1/studies/{study}/progress"),
            lambda: client.post(f"/v1/leases/{lease['id']}/renew", json={"fence": lease["fence"]}),
        ):
            begun = time.monotonic()
            assert is_problem(act(), 503)
            assert time.monotonic() - begun < 6.0
        cable.mend()
        assert client.post("/v1/results", json=body).status_code == 200
        assert client.get(f"/v1/studies/{study}/progress").json()["ok"] == 4
    told = [message for message in caplog.messages if "database is" in message]
    assert [message.partition(":")[0] for message in told] == [
        "the database is away or full, and who asks is told to wait",
        "the database is back",
    ]


def test_a_request_waits_for_no_lock_for_as_long_as_a_worker_waits_for_it(
    url: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    assert LOCK_SECONDS + silence.SILENT_SECONDS < PATIENCE_SECONDS
    monkeypatch.setattr("server.store.database.engine.LOCK_SECONDS", 1)
    engine = create_engine(url, presence=Presence())
    lock = sa.text("LOCK TABLE studies")
    locked, done = threading.Event(), threading.Event()

    def keep() -> None:
        with writing(engine) as connection:
            connection.execute(lock)
            locked.set()
            done.wait(10.0)

    other = threading.Thread(target=keep)
    other.start()
    assert locked.wait(5.0)

    def wait() -> None:
        with writing(engine) as connection:
            connection.execute(lock)

    try:
        assert "lock timeout" in refused(wait, 6.0)
        assert caplog.messages == ["a request waited in vain for what another one keeps locked"]
    finally:
        done.set()
        other.join()
        engine.dispose()
