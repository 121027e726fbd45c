"""Instances one by one: where they stand, what became of them, and all that it takes to replay."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine, Row

from server.errors import NotFoundError
from server.logic.slots import BUDGETS
from server.logic.study import Study
from server.store.engine import reading
from server.store.ledger import Place
from server.store.schema import (
    comparisons,
    conflicts,
    instances,
    results,
    superseded,
    workers,
)
from server.store.slots import attempts_in
from server.store.studies import find

#: What a listing can be narrowed to: the states of an instance, and how it ended.
STATES = ("pending", "leased", "done", "ok", "failed", "quarantined")

_JOINED = instances.outerjoin(
    results,
    sa.and_(
        results.c.study_id == instances.c.study_id,
        results.c.row == instances.c.row,
        results.c.position == instances.c.position,
    ),
)
_COLUMNS = (
    instances.c.row,
    instances.c.position,
    instances.c.state,
    instances.c.attempts,
    instances.c.host_class,
    results.c.outcome,
    results.c.reason,
    results.c.wall_seconds,
    results.c.worker_id,
    results.c.received_at,
)


#: What a reader is shown of a comparison.
_OPINION = ("state", "first_host", "second_host", "outcome", "outputs", "difference", "decided_at")


@dataclass(frozen=True, kw_only=True)
class Account:
    """All that is known of one instance."""

    study: Study
    state: str
    #: How often it came back, by cause, and from which hosts.
    attempts: Mapping[str, int]
    hosts: Mapping[str, Sequence[str]]
    host_class: str | None
    #: Its final result with who reported it and with which versions; None if it has none.
    result: Mapping[str, Any] | None
    #: Results that contradict it.
    conflicts: list[Mapping[str, Any]]
    #: Results that were taken back before, first ones first.
    superseded: list[Mapping[str, Any]]
    #: What other hosts said when they were asked to compute it again.
    comparisons: list[Mapping[str, Any]]


def page(
    engine: Engine,
    study_id: str,
    *,
    state: str | None,
    outcome: str | None,
    after: Place,
    limit: int,
) -> list[Mapping[str, Any]]:
    """Return up to `limit` instances of begun rows beyond `after`, by row and position.

    Args:
        engine: where.
        study_id: which study.
        state: one of STATES; None: all.
        outcome: only those that ended so.
        after: (row, position) of the last one seen.
        limit: how many.

    Raises:
        NotFoundError: there is no study of that id.
    """
    query = (
        sa.select(*_COLUMNS)
        .select_from(_JOINED)
        .where(
            instances.c.study_id == study_id,
            sa.tuple_(instances.c.row, instances.c.position) > sa.tuple_(*after),
        )
        .order_by(instances.c.row, instances.c.position)
        .limit(limit)
    )
    if state == "ok":
        query = query.where(results.c.outcome == "ok")
    elif state == "failed":
        query = query.where(results.c.outcome != "ok")
    elif state == "quarantined":
        query = query.where(results.c.outcome.in_(BUDGETS))
    elif state is not None:
        query = query.where(instances.c.state == state)
    if outcome is not None:
        query = query.where(results.c.outcome == outcome)
    with reading(engine) as connection:
        find(connection, study_id)
        return [_listed(row) for row in connection.execute(query)]


def account(engine: Engine, study_id: str, place: Place) -> Account:
    """Return what is known of the instance at `place`, begun or not.

    Raises:
        NotFoundError: there is no such study, or no such place in it.
    """
    with reading(engine) as connection:
        study = find(connection, study_id)
        row, position = place
        if not (0 <= row < study.plan.rows and 0 <= position < study.plan.width):
            raise NotFoundError(
                f"study {study_id} has {study.plan.rows} rows of {study.plan.width} positions: "
                f"there is no row {row}, position {position}"
            )
        slot = connection.execute(_at(instances, study_id, place)).one_or_none()
        attempts, hosts = attempts_in({} if slot is None else slot.attempts)
        return Account(
            study=study,
            state="waiting" if slot is None else slot.state,
            attempts=attempts,
            hosts=hosts,
            host_class=None if slot is None else slot.host_class,
            result=_result(connection, study_id, place),
            conflicts=[_plain(r) for r in connection.execute(_at(conflicts, study_id, place))],
            superseded=[_plain(r) for r in connection.execute(_at(superseded, study_id, place))],
            comparisons=[
                {name: value for name, value in r._mapping.items() if name in _OPINION}
                for r in connection.execute(_at(comparisons, study_id, place))
            ],
        )


def _listed(row: Any) -> dict[str, Any]:
    attempts, hosts = attempts_in(row.attempts)
    return {**row._mapping, "attempts": attempts, "hosts": hosts}


def _at(table: sa.Table, study_id: str, place: Place) -> sa.Select[Any]:
    return sa.select(table).where(
        table.c.study_id == study_id, table.c.row == place[0], table.c.position == place[1]
    )


def _result(connection: Connection, study_id: str, place: Place) -> Mapping[str, Any] | None:
    query = (
        _at(results, study_id, place)
        .join(workers, workers.c.id == results.c.worker_id)
        .add_columns(workers.c.host, workers.c.versions)
    )
    row = connection.execute(query).one_or_none()
    return None if row is None else {**_plain(row), "state": row.state}


def _plain(row: Row[Any]) -> dict[str, Any]:
    """Return a result of any of the tables as JSON, without what the reader knows already."""
    known = ("id", "study_id", "row", "position", "seq", "worker_id", "state")
    found = {name: value for name, value in row._mapping.items() if name not in known}
    return {**found, "worker": row.worker_id}
