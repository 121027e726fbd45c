"""Sessions as a client sees them, of a real coordinator in this process."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from pydantic import SecretStr

from rehyb import Client, NotFound
from server.app import create_app
from server.settings import Settings
from server.store import upgrade
from tests.testbed.transport import CoordinatorTransport


@pytest.fixture
def client(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Client]:
    """A client of a coordinator that takes every session without a look at it."""

    async def look(_program: str, file: Path) -> dict[str, Any]:
        return {"model": "device.xml", "declared_effects": [], "trials": []}

    monkeypatch.setattr("server.routes.sessions.check", look)
    url = f"sqlite:///{tmp_path / 'rehyb.sqlite3'}"
    upgrade(url)
    app = create_app(Settings(database_url=url, token=SecretStr("t")))
    with (
        TestClient(app) as transport,
        Client(
            "http://testserver",
            "t",
            transport=CoordinatorTransport(transport._transport.handle_request),
        ) as client,
    ):
        yield client


def test_a_deleted_session_is_gone_with_all_that_was_found_in_it(
    client: Client, tmp_path: Path
) -> None:
    (tmp_path / "monday.zip").write_bytes(b"PK1")
    kept = client.upload_session(tmp_path / "monday.zip")
    job = client.close_loop(kept["id"])
    assert [one["name"] for one in client.sessions()] == ["monday"]
    assert client.close_loop_report(job["id"])["state"] == "waiting"
    client.delete_session(kept["id"])
    assert client.sessions() == []
    for ask in (client.session, client.delete_session, client.close_loop):
        with pytest.raises(NotFound):
            ask(kept["id"])
    with pytest.raises(NotFound):
        client.close_loop_report(job["id"])
    # The same bytes are a new session.
    again = client.upload_session(tmp_path / "monday.zip")
    assert [one["id"] for one in client.sessions()] == [again["id"]]
