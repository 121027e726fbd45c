"""A coordinator on a fresh database, with a clock that tests set."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient
from pydantic import SecretStr
from sqlalchemy.engine import Engine

from server.app import create_app
from server.logic.fleet.verdicts import Report
from server.operations.fleet.exchange import Grant
from server.records import Plan
from server.settings import Settings
from server.store import create_engine, upgrade
from tests.testbed.clock import Clock
from tests.testbed.coordinators import exchanges, records
from tests.testbed.coordinators.turns import Turns

TOKEN = "correct-horse"


@pytest.fixture(params=["sqlite", "postgresql"])
def kind(request: pytest.FixtureRequest) -> str:
    """Of database."""
    return str(request.param)


@pytest.fixture
def url(kind: str, request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """The URL of an empty database."""
    if kind == "sqlite":
        return f"sqlite:///{tmp_path / 'rehyb.sqlite3'}"
    return str(request.getfixturevalue("empty_database")())


@pytest.fixture(scope="session")
def upgraded_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An SQLite file with the current schema and nothing in it, to be copied."""
    file = tmp_path_factory.mktemp("upgraded") / "rehyb.sqlite3"
    upgrade(f"sqlite:///{file}")
    return file


@pytest.fixture
def upgraded_sqlite(upgraded_file: Path, tmp_path: Path) -> str:
    """The URL of a SQLite database with the current schema."""
    # Every migration again would take longer than most tests.
    return f"sqlite:///{shutil.copyfile(upgraded_file, tmp_path / 'upgraded.sqlite3')}"


@pytest.fixture
def upgraded(kind: str, request: pytest.FixtureRequest) -> str:
    """The URL of a database of either kind with the current schema."""
    if kind == "sqlite":
        return str(request.getfixturevalue("upgraded_sqlite"))
    return str(request.getfixturevalue("upgraded_database")())


@pytest.fixture
def engine(upgraded: str) -> Iterator[Engine]:
    """A database with the current schema."""
    engine = create_engine(upgraded)
    yield engine
    engine.dispose()


@pytest.fixture
def turns(engine: Engine) -> Iterator[Turns]:
    """Turns on the database, which is PostgreSQL then."""
    found = Turns(engine)
    yield found
    found.close()


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def app(upgraded: str, clock: Clock) -> FastAPI:
    settings = Settings(
        database_url=upgraded, token=SecretStr(TOKEN), lease_seconds=60.0, session_bytes=3_000_000
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
    return records.plan


@pytest.fixture
def report() -> Callable[..., Report]:
    return records.report


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
