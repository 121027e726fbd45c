"""While PostgreSQL is away the coordinator says so, and when it is back nobody notices."""

from collections.abc import Callable, Iterator
from typing import Any

import pytest
import sqlalchemy as sa
from fastapi.testclient import TestClient
from sqlalchemy.engine import Engine

from tests.testbed.coordinators.rest_bodies import STUDY, asking, is_problem, posting, result


@pytest.fixture
def kind() -> str:
    return "postgresql"


@pytest.fixture
def admin(engine: Engine) -> Iterator[Engine]:
    """The way to another database of the same server."""
    admin = sa.create_engine(engine.url.set(database="postgres"), isolation_level="AUTOCOMMIT")
    yield admin
    admin.dispose()


@pytest.fixture
def server(engine: Engine, admin: Engine) -> Iterator[Callable[..., None]]:
    """Cuts all connections to the database, for good or until it is called again."""
    database = engine.url.database

    def cut(*, away: bool) -> None:
        with admin.connect() as connection:
            connection.exec_driver_sql(
                f'ALTER DATABASE "{database}" ALLOW_CONNECTIONS {"false" if away else "true"}'
            )
            connection.execute(
                sa.text(
                    "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = :d"
                ),
                {"d": database},
            )

    yield cut
    cut(away=False)


def test_workers_and_readers_are_told_to_ask_again_and_then_lose_nothing(
    client: TestClient, server: Callable[..., None]
) -> None:
    study = client.post("/v1/studies", json=STUDY).json()["id"]
    lease: Any = client.post("/v1/leases", json=asking(max_instances=4)).json()
    body = posting(lease, [result(instance) for instance in lease["instances"]])
    server(away=True)
    for asked in (
        lambda: client.get(f"/v1/studies/{study}/progress"),
        lambda: client.post("/v1/results", json=body),
        lambda: client.post("/v1/leases", json=asking(max_instances=4)),
    ):
        response = asked()
        assert is_problem(response, 503)
        assert int(response.headers["Retry-After"]) > 0
        assert "database" in response.json()["detail"]
    server(away=False)
    assert client.post("/v1/results", json=body).status_code == 200
    assert client.get(f"/v1/studies/{study}/progress").json()["ok"] == 4


def test_a_server_that_only_reads_for_a_while_as_in_a_failover_is_away_and_nothing_is_lost(
    client: TestClient, server: Callable[..., None], engine: Engine, admin: Engine
) -> None:
    study = client.post("/v1/studies", json=STUDY).json()["id"]
    lease: Any = client.post("/v1/leases", json=asking(max_instances=4)).json()
    body = posting(lease, [result(instance) for instance in lease["instances"]])

    def only_read(yes: bool) -> None:
        with admin.connect() as connection:
            name, said = engine.url.database, "on" if yes else "off"
            connection.exec_driver_sql(
                f'ALTER DATABASE "{name}" SET default_transaction_read_only = {said}'
            )

    only_read(True)
    server(away=False)
    try:
        for asked in (
            lambda: client.post("/v1/results", json=body),
            lambda: client.post("/v1/leases", json=asking(max_instances=4)),
            lambda: client.post(f"/v1/studies/{study}/pause"),
        ):
            assert is_problem(asked(), 503)
    finally:
        only_read(False)
    # What was connected meanwhile would only read for ever.
    for _ in range(3):
        assert client.post("/v1/results", json=body).status_code == 200
    assert client.post(f"/v1/studies/{study}/pause").status_code == 200


def test_connections_that_were_cut_while_nobody_used_them_fail_no_request(
    client: TestClient, server: Callable[..., None]
) -> None:
    study = client.post("/v1/studies", json=STUDY).json()["id"]
    for _ in range(3):
        server(away=False)
        assert client.get(f"/v1/studies/{study}/progress").status_code == 200
