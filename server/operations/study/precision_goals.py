"""Precision goals of studies: kept, and acted on when a study is complete."""

import logging
from collections.abc import Mapping
from typing import Any

from sqlalchemy.engine import Engine

from server.errors import ConflictError
from server.logic.study.precision_goals import next_extension, unjudged
from server.records import PrecisionGoal, Study
from server.states import StudyState
from server.store.database.engine import alone_reading, writing
from server.store.study import precision_goals, snapshots, studies

log = logging.getLogger(__name__)

of = alone_reading(precision_goals.find)
every = alone_reading(precision_goals.every)
due = alone_reading(precision_goals.due)


def put(engine: Engine, study_id: str, goal: PrecisionGoal) -> None:
    """Give a study a goal in place of any it had.

    Raises:
        ConflictError: it is cancelled.
    """
    with writing(engine) as connection:
        if studies.find(connection, study_id, lock=True).state == StudyState.CANCELLED:
            raise ConflictError(f"study {study_id} is cancelled: it has all the rows it will have")
        precision_goals.put(connection, study_id, goal)


def remove(engine: Engine, study_id: str) -> None:
    """Extend a study no more; NotFoundError if there is no study of that id."""
    with writing(engine) as connection:
        studies.find(connection, study_id, lock=True)
        precision_goals.delete(connection, study_id)


def act_on(engine: Engine, study_id: str) -> bool:
    """Do what a study's goal asks for now: extend it, or note that it is over.

    Several processes may ask at once: one of them finds something to do.

    Returns:
        Whether there was anything to do.
    """
    with writing(engine) as connection:
        study = studies.find(connection, study_id, lock=True)
        goal = precision_goals.find(connection, study_id)
        snapshot = snapshots.find(connection, study_id)
        cursor, _ = snapshots.state(connection, study_id)
        if goal is None or snapshot is None or cursor != study.result_count:
            return False
        if (changed := _changed(study, goal, snapshot)) is None:
            return False
        after, goal = changed
        if after != study:
            studies.save(connection, after)
        precision_goals.put(connection, study_id, goal)
    return True


def _changed(
    study: Study, goal: PrecisionGoal, snapshot: Mapping[str, Any]
) -> tuple[Study, PrecisionGoal] | None:
    """Return as `next_extension`; a study that it fails at is told so and left as it is."""
    try:
        return next_extension(study, goal, snapshot)
    except Exception:
        # Whatever it is: the process that judges is that of all studies.
        log.exception("study %s cannot be judged, an error of rehyb: please report it", study.id)
        return study, unjudged(study, goal)
