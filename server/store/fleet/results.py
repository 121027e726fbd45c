"""Final results, each numbered in its study's log, and results that contradict one."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields
from typing import Any

import sqlalchemy as sa
from pydantic_core import from_json
from sqlalchemy.engine import Connection, Dialect

from models.curves import packed, unpacked
from server.records import Place, Result
from server.store.database.prepared import Prepared, Statement, as_text, text
from server.store.database.schema import conflicts, results, workers

#: What a result is made of.
_RESULT = [field.name for field in fields(Result)]
#: The results of one row, as `result_of` takes them.
OF_ROW = Prepared(
    sa.select(
        *(text(results.c[n]) if n in ("outputs", "state") else results.c[n] for n in _RESULT)
    ).where(
        results.c.study_id == sa.bindparam("of_study"), results.c.row == sa.bindparam("at_row")
    ),
)
_APPEND = Prepared(
    sa.insert(results).inline(),
    *("study_id", "received_at", "worker_id", "seq", "row", "position"),
    *("outcome", "outputs", "reason", "state", "wall_seconds"),
)
_CONFLICT = Prepared(
    sa.insert(conflicts).inline(),
    *("study_id", "worker_id", "received_at", "row", "position", "outcome", "outputs", "reason"),
)


def one(dialect: Dialect, about: tuple[str, float], row: tuple[Any, ...]) -> Statement:
    """Return what appends one final result.

    Args:
        dialect: of the database.
        about: study and when it came.
        row: worker, number, and values of `Result` in their order, JSON not yet as text.
    """
    *first, outputs, reason, state, wall_seconds = row
    given = (None if outputs is None else as_text(outputs)), reason, (state and as_text(state))
    return _APPEND.statement(dialect, *about, *first, *given, wall_seconds)


def conflict(dialect: Dialect, study_id: str, worker: str, now: float, found: Result) -> Statement:
    """Return what keeps a result that contradicts a final one."""
    outputs = None if found.outputs is None else as_text(packed(found.outputs))
    told = (found.row, found.position, found.outcome, outputs, found.reason)
    return _CONFLICT.statement(dialect, study_id, worker, now, *told)


def result_of(row: Sequence[Any]) -> Result:
    """Return the result that a row of `OF_ROW` holds."""
    found = dict(zip(_RESULT, row, strict=True))
    for name in ("outputs", "state"):
        if found[name] is not None:
            found[name] = from_json(found[name])
    if found["outputs"] is not None:
        found["outputs"] = unpacked(found["outputs"])
    return Result(**found)


def at(connection: Connection, study_id: str, places: Collection[Place]) -> dict[Place, Result]:
    """Return the final results at `places`, leaving out those that have none."""
    if not places:
        return {}
    query = sa.select(results).where(
        results.c.study_id == study_id, results.c.row.in_({row for row, _ in places})
    )
    found = {(row.row, row.position): _result(row) for row in connection.execute(query)}
    return {place: found[place] for place in places if place in found}


def page(
    connection: Connection, study_id: str, *, after: Place, limit: int
) -> list[tuple[Result, str]]:
    """Return up to `limit` results beyond `after` and who reported each, by row and position."""
    query = (
        sa.select(results)
        .where(
            results.c.study_id == study_id,
            sa.tuple_(results.c.row, results.c.position) > sa.tuple_(*after),
        )
        .order_by(results.c.row, results.c.position)
        .limit(limit)
    )
    return [(_result(row), row.worker_id) for row in connection.execute(query)]


def arrivals(connection: Connection, study_id: str, numbers: Collection[int]) -> dict[int, float]:
    """Return when the results of these numbers arrived, by number."""
    query = sa.select(results.c.seq, results.c.received_at).where(
        results.c.study_id == study_id, results.c.seq.in_(numbers)
    )
    return {row.seq: row.received_at for row in connection.execute(query)}


def latest_failed(
    connection: Connection, study_id: str, outcome: str, *, limit: int
) -> list[dict[str, Any]]:
    """Return the latest results with this outcome, which is not "ok", with worker and host."""
    log = results.c
    query = (
        sa.select(
            log.seq,
            log.row,
            log.position,
            log.outcome,
            log.reason,
            log.state,
            log.worker_id,
            log.received_at,
            workers.c.host,
        )
        .join(workers, workers.c.id == log.worker_id)
        .where(log.study_id == study_id, log.outcome == outcome, _FAILED)
        .order_by(log.seq.desc())
        .limit(limit)
    )
    return [dict(row._mapping) for row in connection.execute(query)]


#: As the index of failures says it, or no database would know that it may be used.
_FAILED = results.c.outcome != sa.literal_column("'ok'")


def good_ones(connection: Connection, study_id: str, numbers: Collection[int]) -> list[Place]:
    """Return where those of these numbers are that are "ok", in the order of the numbers."""
    log = results.c
    query = (
        sa.select(log.row, log.position)
        .where(log.study_id == study_id, log.seq.in_(numbers), log.outcome == "ok")
        .order_by(log.seq)
    )
    return [(row.row, row.position) for row in connection.execute(query)]


def mean_seconds(connection: Connection, study_id: str, *, after: int) -> float | None:
    """Return how long an evaluation took on average, of the results beyond number `after`."""
    query = sa.select(sa.func.avg(results.c.wall_seconds)).where(
        results.c.study_id == study_id, results.c.seq > after, results.c.outcome == "ok"
    )
    found: float | None = connection.scalar(query)
    return found


def tempo(connection: Connection, study_id: str, *, after: int) -> tuple[int, float, int]:
    """Return how many results came after the first of those beyond number `after`.

    Also the seconds in which they came, and how many workers they came from.
    """
    log = results.c
    beyond = (log.study_id == study_id, log.seq > after)
    first = sa.select(sa.func.min(log.received_at)).where(*beyond).scalar_subquery()
    came = sa.func.count().filter(log.received_at > first)
    seconds = sa.func.max(log.received_at) - first
    query = sa.select(came, seconds, sa.func.count(log.worker_id.distinct())).where(*beyond)
    count, took, whose = connection.execute(query).one()
    return count, took or 0.0, whose


def first_of_rows(
    connection: Connection, study_id: str, *, rows: int
) -> dict[int, tuple[str, Mapping[str, float] | None]]:
    """Return outcome and outputs at position 0 of the first rows, by row, where there are any."""
    query = sa.select(results.c.row, results.c.outcome, results.c.outputs).where(
        results.c.study_id == study_id, results.c.row < rows, results.c.position == 0
    )
    return {row.row: (row.outcome, row.outputs) for row in connection.execute(query)}


def logged(
    connection: Connection, study_id: str, *, after: int, limit: int
) -> list[tuple[int, int, int, str, Mapping[str, float] | None]]:
    """Return up to `limit` results with a number beyond `after`, in order.

    Each as its number, row, position, outcome and outputs.
    """
    log = results.c
    query = (
        sa.select(log.seq, log.row, log.position, log.outcome, log.outputs)
        .where(log.study_id == study_id, log.seq > after)
        .order_by(log.seq)
        .limit(limit)
    )
    return list(connection.execute(query))


def _result(row: Any) -> Result:
    return Result(**{name: getattr(row, name) for name in _RESULT})
