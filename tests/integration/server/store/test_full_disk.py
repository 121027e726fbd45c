"""A database without room refuses what it cannot keep, and loses nothing it has."""

import sqlite3
from typing import Any

import sqlalchemy as sa
from fastapi.testclient import TestClient
from pydantic import SecretStr

from server.app import create_app
from server.operations import check
from server.settings import Settings
from tests.testbed.coordinators.rest_bodies import is_problem

STUDY = {"name": "s", "model": "ishigami", "method": "morris", "rows": 25}
ASKING = {"worker": {"id": "w", "host": "h"}, "models": ["ishigami"], "max_instances": 100}


def test_results_that_find_no_room_are_taken_when_there_is_some(upgraded_sqlite: str) -> None:
    app = create_app(Settings(database_url=upgraded_sqlite, token=SecretStr("t")))
    room = [2**30]

    def limit(connection: sa.Connection) -> None:
        driver: Any = connection.connection.dbapi_connection
        driver.execute(f"PRAGMA max_page_count = {room[0]}")

    sa.event.listen(app.state.engine, "begin", limit)
    headers = {"Authorization": "Bearer t"}
    with TestClient(app, headers=headers, raise_server_exceptions=False) as client:
        study = client.post("/v1/studies", json=STUDY).json()["id"]
        lease = client.post("/v1/leases", json=ASKING).json()
        results = [
            {
                "instance": instance["id"],
                "outcome": "diverged",
                "reason": "x" * 4000,
                "state": {"qpos": [0.5] * 100},
            }
            for instance in lease["instances"]
        ]
        body = {"lease": lease["id"], "fence": lease["fence"], "worker": "w", "results": results}
        client.post("/v1/studies", json={**STUDY, "rows": 5000})
        room[0] = 1
        refused = client.post("/v1/results", json=body)
        assert is_problem(refused, 503)
        assert int(refused.headers["Retry-After"]) > 0
        while (answer := client.post("/v1/leases", json=ASKING)).status_code == 201:
            pass
        assert is_problem(answer, 503)
        assert client.get("/readyz").status_code == 503
        assert "full" in client.get("/readyz").json()["detail"]
        assert client.get(f"/v1/studies/{study}/progress").json()["leased"] == 100
        assert check.faults(app.state.engine) == []
        room[0] = 2**30
        taken = client.post("/v1/results", json=body)
        assert {v["verdict"] for v in taken.json()["verdicts"]} == {"accepted"}
        assert client.get(f"/v1/studies/{study}/progress").json()["failed"] == 100
        assert check.faults(app.state.engine) == []


def test_a_database_that_takes_no_writes_is_not_ready_before_any_lease_has_failed(
    upgraded_sqlite: str,
) -> None:
    app = create_app(Settings(database_url=upgraded_sqlite, token=SecretStr("t")))

    def write_nothing(connection: sa.Connection) -> None:
        driver: Any = connection.connection.dbapi_connection
        driver.set_authorizer(
            lambda action, *_: (
                sqlite3.SQLITE_DENY if action == sqlite3.SQLITE_UPDATE else sqlite3.SQLITE_OK
            )
        )

    with TestClient(app, raise_server_exceptions=False) as client:
        sa.event.listen(app.state.engine, "begin", write_nothing)
        assert client.get("/readyz").status_code == 503
        assert "not authorized" in client.get("/readyz").json()["detail"]
