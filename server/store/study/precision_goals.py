"""The precision goals of studies."""

from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from server.records import PrecisionGoal
from server.states import StudyState
from server.store.database.engine import insert
from server.store.database.schema import estimator_states, goals, studies


def put(connection: Connection, study_id: str, goal: PrecisionGoal) -> None:
    """Write a locked study's goal in place of any it had."""
    steps = [dict(step) for step in goal.steps]
    values = {**vars(goal), "steps": steps, "study_id": study_id}
    connection.execute(
        insert(connection, goals)
        .values(values)
        .on_conflict_do_update(index_elements=["study_id"], set_=values)
    )


def delete(connection: Connection, study_id: str) -> None:
    """Forget a study's goal."""
    connection.execute(sa.delete(goals).where(goals.c.study_id == study_id))


def find(connection: Connection, study_id: str) -> PrecisionGoal | None:
    """Return a study's goal and what was done for it; None if it has none."""
    row = connection.execute(sa.select(goals).where(goals.c.study_id == study_id)).one_or_none()
    return None if row is None else _goal(row)


def every(connection: Connection) -> dict[str, PrecisionGoal]:
    """Return the goals of all studies that have one, by study."""
    return {row.study_id: _goal(row) for row in connection.execute(sa.select(goals))}


def due(connection: Connection) -> list[str]:
    """Return the complete studies whose goal is open and whose results are all in a snapshot."""
    query = (
        sa.select(studies.c.id)
        .join(goals)
        .join(estimator_states, estimator_states.c.study_id == studies.c.id)
        .where(
            studies.c.state == StudyState.COMPLETE,
            studies.c.result_count == estimator_states.c.cursor,
            sa.or_(goals.c.judged.is_(None), goals.c.judged != studies.c.edition),
        )
        .order_by(studies.c.created_at, studies.c.id)
    )
    return list(connection.scalars(query))


def _goal(row: Any) -> PrecisionGoal:
    values = {name: value for name, value in row._mapping.items() if name != "study_id"}
    return PrecisionGoal(**{**values, "steps": tuple(row.steps)})
