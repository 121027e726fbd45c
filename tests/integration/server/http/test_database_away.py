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
def server(engine: Engine) -> Iterator[Callable[..., None]]:
    """Cuts all connections to the database, for good or until it is called again."""
    database = engine.url.database
    admin = sa.create_engine(engine.url.set(database="postgres"), isolation_level="AUTOCOMMIT")

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
    admin.dispose()


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


def test_connections_that_were_cut_while_nobody_used_them_fail_no_request(
    client: TestClient, server: Callable[..., None]
) -> None:
    study = client.post("/v1/studies", json=STUDY).json()["id"]
    for _ in range(3):
        server(away=False)
        assert client.get(f"/v1/studies/{study}/progress").status_code == 200
