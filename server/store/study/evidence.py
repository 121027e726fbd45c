"""Instances one by one, with their results and whatever contradicts them."""

from collections.abc import Collection, Mapping
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Row

from server.records import Place
from server.states import InstanceState, Outcome
from server.store.database.schema import (
    OF_INSTANCE,
    comparisons,
    conflicts,
    instances,
    results,
    superseded,
    workers,
)
from server.store.study.instances import attempts_in

_LISTED = sa.select(
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
).select_from(instances.outerjoin(results, OF_INSTANCE))
#: What a reader is shown of a comparison.
_OPINION = ("state", "first_host", "second_host", "outcome", "outputs", "difference", "decided_at")
#: What a reader of a result knows already.
_KNOWN = ("id", "study_id", "row", "position", "seq", "worker_id", "state")


def page(
    connection: Connection,
    study_id: str,
    *,
    state: InstanceState | None,
    outcomes: Collection[str] | None,
    failed: bool,
    after: Place,
    limit: int,
) -> list[dict[str, Any]]:
    """Return up to `limit` instances of begun rows beyond `after`, by row and position.

    Args:
        state: only those in this state.
        outcomes: only those that ended in one of these.
        failed: only those that ended, but not in "ok".
        after: (row, position) of the last one seen.
    """
    query = (
        _LISTED.where(
            instances.c.study_id == study_id,
            sa.tuple_(instances.c.row, instances.c.position) > sa.tuple_(*after),
        )
        .order_by(instances.c.row, instances.c.position)
        .limit(limit)
    )
    if state is not None:
        query = query.where(instances.c.state == state)
    if outcomes is not None:
        query = query.where(results.c.outcome.in_(outcomes))
    if failed:
        query = query.where(results.c.outcome != Outcome.OK)
    return [{**row._mapping, **_went_wrong(row)} for row in connection.execute(query)]


def standing(connection: Connection, study_id: str, place: Place) -> dict[str, Any] | None:
    """Return state, attempts, hosts and host_class of an instance; None if its row is not begun."""
    row = connection.execute(_at(instances, study_id, place)).one_or_none()
    if row is None:
        return None
    return {"state": row.state, **_went_wrong(row), "host_class": row.host_class}


def around(connection: Connection, study_id: str, place: Place) -> dict[str, Any]:
    """Return the final result of an instance and what else was ever said about it.

    "result" with who reported it and with which versions, or None; "conflicts" with it;
    "superseded" results, which were taken back before; "comparisons" with other hosts.
    """

    def every(table: sa.Table) -> list[Row[Any]]:
        return list(connection.execute(_at(table, study_id, place)))

    query = (
        _at(results, study_id, place)
        .join(workers, workers.c.id == results.c.worker_id)
        .add_columns(workers.c.host, workers.c.versions)
    )
    result = connection.execute(query).one_or_none()
    return {
        "result": None if result is None else {**_plain(result), "state": result.state},
        "conflicts": [_plain(row) for row in every(conflicts)],
        "superseded": [_plain(row) for row in every(superseded)],
        "comparisons": [
            {name: row._mapping[name] for name in row._fields if name in _OPINION}
            for row in every(comparisons)
        ],
    }


def _went_wrong(row: Any) -> dict[str, Any]:
    attempts, hosts = attempts_in(row.attempts)
    return {"attempts": attempts, "hosts": hosts}


def _at(table: sa.Table, study_id: str, place: Place) -> sa.Select[Any]:
    return sa.select(table).where(
        table.c.study_id == study_id, table.c.row == place[0], table.c.position == place[1]
    )


def _plain(row: Row[Any]) -> Mapping[str, Any]:
    """Return a result of any of the tables as JSON, without what the reader knows already."""
    found = {name: value for name, value in row._mapping.items() if name not in _KNOWN}
    return {**found, "worker": row.worker_id}
