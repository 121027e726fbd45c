"""A session that close-loop jobs are about, in a database that stays whole."""

import io
from collections.abc import Iterator

import pytest
from fastapi import FastAPI
from fastapi.testclient import TestClient

from server.operations import check, sessions


@pytest.fixture(autouse=True)
def whole(client: TestClient, app: FastAPI, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Whatever a test has done to it, the database is whole."""
    # The session of these tests is no zip file: its digest is taken on trust.
    monkeypatch.setattr(check, "_session_faults", lambda engine: ())
    yield
    assert check.faults(app.state.engine) == []


@pytest.fixture
def session(app: FastAPI) -> str:
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
