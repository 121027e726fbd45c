"""A database of every schema there has been comes up to date, and back."""

from typing import Any

import pytest
import sqlalchemy as sa
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy.engine import Connection, Engine

from server.logic.fleet.verdicts import Report
from server.operations.fleet import results
from server.operations.study import studies
from server.store import create_engine, upgrade
from server.store.database.engine import writing
from server.store.database.schema import metadata
from server.store.database.upgrade import _config
from tests.testbed.coordinators import exchanges

Row = dict[str, Any]

STUDY: Row = {
    "id": "old",
    "name": "begun before",
    "model": "ishigami",
    "method": "morris",
    "sampling": "sobol",
    "rows": 3,
    "seed": 1,
    "distributions": '[["x1", {"kind": "uniform", "low": 0.0, "high": 1.0}]]',
    "fixed": '{"x2": 0.0, "x3": 0.0}',
    "outputs": '["y"]',
    "state": "running",
    "created_at": 1.0,
    "request_digest": "d",
    "instances": 6,
    "handed_out": 3,
    "leased": 1,
    "result_count": 2,
    "ok_count": 2,
    "rows_complete": 1,
    "failures": "{}",
}
WORKER: Row = {"id": "w", "host": "h", "versions": "{}", "last_seen": 1.0, "instances_done": 2}
LEASE: Row = {
    "id": "l",
    "worker_id": "w",
    "study_id": "old",
    "state": "open",
    "granted_at": 1.0,
    "expires_at": 9.0,
    "instances": "[[0, 0], [0, 1], [1, 0]]",
}


def insert(connection: Connection, table: str, row: Row) -> None:
    names = ", ".join(f'"{name}"' for name in row)
    marks = ", ".join(f":{name}" for name in row)
    connection.execute(sa.text(f'INSERT INTO "{table}" ({names}) VALUES ({marks})'), row)


@pytest.fixture
def first_schema(url: str) -> Engine:
    """A database made by 0001 in which a study has begun: its second row only in part."""
    engine = create_engine(url)
    with writing(engine) as connection:
        command.upgrade(_config(connection), "0001")
        insert(connection, "studies", STUDY)
        insert(connection, "workers", WORKER)
        insert(connection, "leases", LEASE)
        for row, position, state, lease in (
            (0, 0, "done", None),
            (0, 1, "done", None),
            (1, 0, "leased", "l"),
        ):
            slot = {"study_id": "old", "row": row, "position": position, "state": state}
            insert(connection, "instances", {**slot, "lease_id": lease, "attempts": "{}"})
        for seq in (1, 2):
            result = {"study_id": "old", "seq": seq, "row": 0, "position": seq - 1}
            found = {"outcome": "ok", "outputs": '{"y": 0.5}', "reason": "", "worker_id": "w"}
            insert(connection, "results", {**result, **found, "received_at": 2.0})
    return engine


def test_a_study_begun_under_0001_goes_on_and_is_completed(first_schema: Engine, url: str) -> None:
    upgrade(url)
    study = studies.get(first_schema, "old")
    assert (study.handed_out, study.leased, study.returned, study.pending) == (4, 1, 1, 3)
    assert (study.priority, study.tags, study.identity) == (0, (), None)
    late = Report(
        instance="old:1:0", outcome="ok", outputs={"y": 1.0}, reason="", state=None, wall_seconds=1
    )
    fence = 1
    (verdict,) = exchanges.post(
        first_schema, [late], lease_id="l", fence=fence, worker="w", now=5.0, ttl=60.0
    )
    assert verdict.verdict == "accepted"
    grant = exchanges.grant(
        first_schema,
        worker="w",
        host="h",
        versions={"mujoco": "4.0.1"},
        models=["ishigami"],
        max_instances=9,
        now=6.0,
        ttl=60.0,
    )
    assert grant is not None
    assert grant.lease.instances == ((1, 1), (2, 0), (2, 1))
    first_schema.dispose()


def test_going_back_to_0001_leaves_its_schema_and_its_results(
    first_schema: Engine, url: str
) -> None:
    def described() -> dict[str, set[str]]:
        inspector = sa.inspect(first_schema)
        return {
            table: {str(column["name"]) for column in inspector.get_columns(table)}
            | {f"index {index['name']}" for index in inspector.get_indexes(table)}
            for table in inspector.get_table_names()
        }

    before = described()
    upgrade(url)
    assert described() != before
    with writing(first_schema) as connection:
        command.downgrade(_config(connection), "0001")
    assert described() == before
    upgrade(url)
    assert len(list(results.in_order(first_schema, studies.get(first_schema, "old")))) == 2
    with first_schema.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        assert compare_metadata(context, metadata) == []
    first_schema.dispose()
