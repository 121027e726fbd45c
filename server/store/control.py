"""What an operator does with a study under way: pause, drain, resume, extend, prefer, delete."""

from collections.abc import Callable
from dataclasses import replace

import sqlalchemy as sa
from sqlalchemy.engine import Engine

from server.errors import ConflictError
from server.logic.study import Study, drained, extended, objection_to_extension
from server.store.engine import writing
from server.store.schema import (
    comparisons,
    conflicts,
    estimator_states,
    goals,
    instances,
    leases,
    results,
    snapshots,
    superseded,
)
from server.store.schema import studies as studies_table
from server.store.studies import find, save


def pause(engine: Engine, study_id: str) -> Study:
    """Hand out nothing of a study for a while; results under way are taken.

    Raises:
        NotFoundError: there is no study of that id.
        ConflictError: the study is complete or cancelled.
    """
    return _change(engine, study_id, lambda study: _switch(study, "paused"))


def drain(engine: Engine, study_id: str) -> Study:
    """Finish the rows that were begun and begin no other, then pause; raises as `pause` does."""
    return _change(engine, study_id, lambda study: drained(_switch(study, "draining")))


def resume(engine: Engine, study_id: str) -> Study:
    """Go on with a paused or draining study; raises as `pause` does."""
    return _change(engine, study_id, lambda study: _switch(study, "running"))


def prioritise(engine: Engine, study_id: str, priority: int) -> Study:
    """Serve a study before all of lower priority; NotFoundError if there is none of that id."""
    return _change(engine, study_id, lambda study: replace(study, priority=priority))


def extend(engine: Engine, study_id: str, rows: int) -> Study:
    """Give a study more rows; what there is stays, and a complete study runs again.

    Args:
        engine: where.
        study_id: which study.
        rows: how many it is to have in all, so that asking twice changes nothing.

    Raises:
        NotFoundError: there is no study of that id.
        ConflictError: it is cancelled, or cannot have that many.
    """

    def change(study: Study) -> Study:
        if (objection := objection_to_extension(study, rows)) is not None:
            raise ConflictError(f"study {study_id} cannot have {rows} rows: {objection}")
        return extended(study, rows)

    return _change(engine, study_id, change)


def delete(engine: Engine, study_id: str) -> None:
    """Remove a study and everything that belongs to it.

    Raises:
        NotFoundError: there is no study of that id.
        ConflictError: it still runs.
    """
    with writing(engine) as connection:
        study = find(connection, study_id, lock=True)
        if study.state in ("running", "draining"):
            raise ConflictError(f"study {study_id} is {study.state}: pause or cancel it first")
        for table in (
            goals,
            snapshots,
            estimator_states,
            conflicts,
            comparisons,
            superseded,
            results,
            instances,
            leases,
        ):
            connection.execute(sa.delete(table).where(table.c.study_id == study_id))
        connection.execute(sa.delete(studies_table).where(studies_table.c.id == study_id))


def _change(engine: Engine, study_id: str, change: Callable[[Study], Study]) -> Study:
    with writing(engine) as connection:
        before = find(connection, study_id, lock=True)
        after = change(before)
        if after != before:
            save(connection, after)
    return after


def _switch(study: Study, state: str) -> Study:
    """Return the study in `state`, unless it has ended."""
    if study.state in ("complete", "cancelled"):
        raise ConflictError(f"study {study.id} is {study.state}: it cannot become {state}")
    return replace(study, state=state)
