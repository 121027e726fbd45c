"""Where the analysis of every study stands, and what it last published."""

from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from server.states import StudyState
from server.store.database.engine import insert
from server.store.database.schema import estimator_states, snapshots, studies


def studies_with_news(connection: Connection) -> list[str]:
    """Return the studies of which the analysis has more to say than its snapshot, oldest first.

    They have results beyond its cursor. While a study runs, those of rows that are incomplete wait:
    no index changes by them, and a snapshot costs as much as one of a thousand results.
    """
    shown = snapshots.c.snapshot["rows_complete"].as_integer()
    query = (
        sa.select(studies.c.id)
        .outerjoin(estimator_states)
        .outerjoin(snapshots)
        .where(studies.c.result_count > sa.func.coalesce(estimator_states.c.cursor, 0))
        .where(
            sa.or_(
                studies.c.state != StudyState.RUNNING,
                snapshots.c.study_id.is_(None),
                shown.is_distinct_from(studies.c.rows_complete),
            )
        )
        .order_by(studies.c.created_at, studies.c.id)
    )
    return list(connection.scalars(query))


def seen(connection: Connection, study_id: str, *, of: int) -> tuple[int, int]:
    """Return how many results the analysis has taken in, and how many complete rows it shows.

    Not the rows (0) if it has taken in all `of` the results: a snapshot is large, and one of a
    finished study would be read at every look for nothing.
    """
    behind = sa.and_(snapshots.c.study_id == study_id, estimator_states.c.cursor < of)
    query = (
        sa.select(estimator_states.c.cursor, snapshots.c.snapshot["rows_complete"].as_integer())
        .outerjoin_from(estimator_states, snapshots, behind)
        .where(estimator_states.c.study_id == study_id)
    )
    row = connection.execute(query).one_or_none()
    return (0, 0) if row is None else (row[0], row[1] or 0)


def state(connection: Connection, study_id: str) -> tuple[int, bytes | None]:
    """Return the cursor and the state last committed; (0, None) before the first commit."""
    query = sa.select(estimator_states).where(estimator_states.c.study_id == study_id)
    row = connection.execute(query).one_or_none()
    return (0, None) if row is None else (row.cursor, row.state)


def advance(
    connection: Connection, study_id: str, *, expected: int, cursor: int, state: bytes
) -> bool:
    """Replace cursor and state; False if the cursor is not as expected."""
    advanced = {"cursor": cursor, "state": state}
    statement = sa.update(estimator_states).where(
        estimator_states.c.study_id == study_id, estimator_states.c.cursor == expected
    )
    if connection.execute(statement.values(advanced)).rowcount == 1:
        return True
    if expected != 0:
        return False
    first = insert(connection, estimator_states).values(study_id=study_id, **advanced)
    first = first.on_conflict_do_nothing()
    return connection.scalar(first.returning(estimator_states.c.study_id)) is not None


def publish(connection: Connection, study_id: str, snapshot: dict[str, Any]) -> None:
    """Replace a study's snapshot."""
    connection.execute(
        insert(connection, snapshots)
        .values(study_id=study_id, snapshot=snapshot)
        .on_conflict_do_update(index_elements=["study_id"], set_={"snapshot": snapshot})
    )


def find(connection: Connection, study_id: str) -> dict[str, Any] | None:
    """Return the snapshot last published; None before the first commit."""
    query = sa.select(snapshots.c.snapshot).where(snapshots.c.study_id == study_id)
    found: dict[str, Any] | None = connection.scalar(query)
    return found


def forget(connection: Connection, study_id: str) -> None:
    """Let the analysis of a study start over."""
    for table in (estimator_states, snapshots):
        connection.execute(sa.delete(table).where(table.c.study_id == study_id))
