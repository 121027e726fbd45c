"""Goals of studies: kept, shown, and acted on when a study is complete."""

from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine

from analysis.sensitivity.stopping import Goal
from server.errors import ConflictError
from server.logic.goals import Pursuit, pursued
from server.store.engine import insert, reading, writing
from server.store.schema import estimator_states, goals, snapshots, studies
from server.store.studies import find, save


def put(engine: Engine, study_id: str, goal: Goal) -> None:
    """Give a study a goal in place of any it had.

    Raises:
        NotFoundError: there is no study of that id.
        ConflictError: it is cancelled.
    """
    with writing(engine) as connection:
        if find(connection, study_id, lock=True).state == "cancelled":
            raise ConflictError(f"study {study_id} is cancelled: it has all the rows it will have")
        add(connection, study_id, goal)


def add(connection: Connection, study_id: str, goal: Goal) -> None:
    """Write a goal within the transaction that makes or has locked its study."""
    values = {**_row(Pursuit(goal=goal)), "study_id": study_id}
    connection.execute(
        insert(connection, goals)
        .values(values)
        .on_conflict_do_update(index_elements=["study_id"], set_=values)
    )


def remove(engine: Engine, study_id: str) -> None:
    """Let a study be as it is; NotFoundError if there is no study of that id."""
    with writing(engine) as connection:
        find(connection, study_id, lock=True)
        connection.execute(sa.delete(goals).where(goals.c.study_id == study_id))


def of(engine: Engine, study_id: str) -> Pursuit | None:
    """Return a study's goal and what was done for it; None if it has none."""
    with reading(engine) as connection:
        return _find(connection, study_id)


def every(engine: Engine) -> dict[str, Pursuit]:
    """Return the goals of all studies that have one, by study."""
    with reading(engine) as connection:
        return {row.study_id: _pursuit(row) for row in connection.execute(sa.select(goals))}


def due(engine: Engine) -> list[str]:
    """Return the complete studies whose goal is open and whose results are all in a snapshot."""
    query = (
        sa.select(studies.c.id)
        .join(goals)
        .join(estimator_states, estimator_states.c.study_id == studies.c.id)
        .where(
            studies.c.state == "complete",
            studies.c.result_count == estimator_states.c.cursor,
            sa.or_(goals.c.judged.is_(None), goals.c.judged != studies.c.edition),
        )
        .order_by(studies.c.created_at, studies.c.id)
    )
    with reading(engine) as connection:
        return list(connection.scalars(query))


def pursue(engine: Engine, study_id: str) -> bool:
    """Do what a study's goal asks for now: extend it, or note that it is over.

    Several processes may ask at once: one of them finds something to do.

    Returns:
        Whether there was anything to do.

    Raises:
        NotFoundError: there is no study of that id.
    """
    with writing(engine) as connection:
        study = find(connection, study_id, lock=True)
        pursuit = _find(connection, study_id)
        seen = connection.execute(
            sa.select(snapshots.c.snapshot, estimator_states.c.cursor)
            .join(estimator_states, estimator_states.c.study_id == snapshots.c.study_id)
            .where(snapshots.c.study_id == study_id)
        ).one_or_none()
        if pursuit is None or seen is None or seen.cursor != study.result_count:
            return False
        if (changed := pursued(study, pursuit, seen.snapshot)) is None:
            return False
        after, pursuit = changed
        if after != study:
            save(connection, after)
        connection.execute(
            sa.update(goals).where(goals.c.study_id == study_id).values(_row(pursuit))
        )
    return True


def _find(connection: Connection, study_id: str) -> Pursuit | None:
    row = connection.execute(sa.select(goals).where(goals.c.study_id == study_id)).one_or_none()
    return None if row is None else _pursuit(row)


def _pursuit(row: Any) -> Pursuit:
    goal = Goal(output=row.output, target=row.target, up_to=row.up_to)
    return Pursuit(goal=goal, judged=row.judged, steps=tuple(row.steps))


def _row(pursuit: Pursuit) -> dict[str, Any]:
    goal = pursuit.goal
    return {
        "output": goal.output,
        "target": goal.target,
        "up_to": goal.up_to,
        "judged": pursuit.judged,
        "steps": [dict(step) for step in pursuit.steps],
    }
