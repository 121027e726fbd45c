"""A coordinator on a fresh database, with a clock that tests set."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from pydantic import SecretStr
from sqlalchemy.engine import Engine

from server.app import create_app
from server.logic.plans import draw_up
from server.logic.verdicts import Report
from server.operations.leasing import Grant
from server.records import Plan
from server.settings import Settings
from server.store import create_engine, upgrade
from tests.testbed import exchanges
from tests.testbed.clock import Clock

TOKEN = "correct horse"


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """The URL of an empty database."""
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path / 'rehyb.sqlite3'}"
    return str(request.getfixturevalue("empty_database")())


@pytest.fixture
def engine(url: str) -> Iterator[Engine]:
    """A database with the current schema."""
    upgrade(url)
    engine = create_engine(url)
    yield engine
    engine.dispose()


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def app(url: str, clock: Clock) -> FastAPI:
    upgrade(url)
    settings = Settings(
        database_url=url, token=SecretStr(TOKEN), lease_seconds=60.0, session_bytes=3_000_000
    )
    app = create_app(settings)
    app.state.clock = clock
    return app


@pytest.fixture
def client(app: FastAPI) -> Iterator[TestClient]:
    """A client that bears the token."""
    headers = {"Authorization": f"Bearer {TOKEN}"}
    with TestClient(app, headers=headers, raise_server_exceptions=False) as client:
        yield client


@pytest.fixture
def plan() -> Callable[..., Plan]:
    """Draws up a study of the Ishigami function: two rows of four instances, unless told other."""

    def make(**changes: Any) -> Plan:
        request: dict[str, Any] = {
            "name": "a study",
            "model": "ishigami",
            "method": "morris",
            "sampling": "sobol",
            "rows": 2,
            "seed": 1,
            "factors": None,
            "fixed": {},
            "outputs": None,
        }
        return draw_up(**{**request, **changes})

    return make


@pytest.fixture
def report() -> Callable[..., Report]:
    """A faultless report of the Ishigami function unless told otherwise."""

    def make(instance: str, **changes: Any) -> Report:
        said: dict[str, Any] = {
            "outcome": "ok",
            "outputs": {"y": 1.5},
            "reason": "",
            "state": None,
            "wall_seconds": 0.25,
        }
        return Report(instance=instance, **{**said, **changes})

    return make


@pytest.fixture
def lease(engine: Engine) -> Callable[..., Grant]:
    """Leases so many instances of the Ishigami function to a worker, of which there are enough."""

    def ask(worker: str, count: int, *, now: float = 0.0) -> Grant:
        found = exchanges.grant(
            engine,
            worker=worker,
            host="h",
            versions={},
            models=["ishigami"],
            max_instances=count,
            now=now,
            ttl=60.0,
        )
        assert found is not None and len(found.lease.instances) == count
        return found

    return ask
