"""What waits for a machine is found without a look at all that is done."""

from collections.abc import Callable
from typing import Any

import pytest
from sqlalchemy.engine import Engine

from server.logic.fleet.verdicts import Report
from server.logic.study.points import instance_id
from server.operations.fleet.exchange import Grant
from server.operations.study import studies
from server.records import Plan
from server.store.database.prepared import Prepared
from tests.testbed.coordinators import exchanges

ROWS, WIDTH = 200, 4


def finish(engine: Engine, grant: Grant, report: Callable[..., Report]) -> None:
    """Post a result for all that a lease holds."""
    reports = [report(instance_id(grant.study.id, *place)) for place in grant.lease.instances]
    assert set(exchanges.hand_in(engine, grant.lease, reports)) == {"accepted"}


def effort(engine: Engine, monkeypatch: pytest.MonkeyPatch, do: Callable[[], object]) -> int:
    """Return how many hundreds of steps SQLite takes for what waits, while something is done."""
    steps = 0
    execute = Prepared.execute

    def count() -> int:
        nonlocal steps
        steps += 1
        return 0

    def counting(self: Prepared, connection: Any, *values: Any) -> Any:
        text = self._in_words_of(connection.dialect).text
        driver = connection.connection.dbapi_connection
        driver.set_progress_handler(count if "'pending'" in text else None, 100)
        return execute(self, connection, *values)

    with monkeypatch.context() as patch:
        patch.setattr(Prepared, "execute", counting)
        do()
    return steps


@pytest.mark.parametrize("kind", ["sqlite"], indirect=True)
def test_a_study_with_much_done_is_not_looked_through(
    engine: Engine,
    plan: Callable[..., Plan],
    lease: Callable[..., Grant],
    report: Callable[..., Report],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    studies.create(engine, plan(rows=ROWS), key=None, digest="", now=0.0)
    finish(engine, lease("w", WIDTH * (ROWS - 2)), report)
    # Of the last row but one some instances are left over.
    finish(engine, lease("w", 1), report)
    assert effort(engine, monkeypatch, lambda: lease("w", 2)) < 10
    (found,) = studies.every(engine)
    assert found.handed_out == WIDTH * (ROWS - 1)
