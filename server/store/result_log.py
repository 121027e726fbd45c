"""What the analysis reads and writes: the log of a study's results, and what it makes of them."""

from contextlib import suppress
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Engine

from analysis.sensitivity.records import LoggedResult, StudyPlan
from server.errors import NoStudyError, NotFoundError
from server.logic.study import for_analysis, instance_id
from server.store import goals, studies
from server.store.engine import insert, reading, writing
from server.store.schema import estimator_states, results, snapshots
from server.store.schema import studies as studies_table


class StoreResultLog:
    """The coordinator's database as an `analysis.sensitivity.service.ResultLog`."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        #: Edition of each study when its plan was last asked for: what was made of an older one is
        #: refused, since its results may have been taken back, or its rows be more.
        self._editions: dict[str, int] = {}

    def studies_with_news(self) -> list[str]:
        """Return the studies that have results beyond the analysis's cursor, oldest first."""
        query = (
            sa.select(studies_table.c.id)
            .outerjoin(estimator_states)
            .where(studies_table.c.result_count > sa.func.coalesce(estimator_states.c.cursor, 0))
            .order_by(studies_table.c.created_at, studies_table.c.id)
        )
        with reading(self._engine) as connection:
            return list(connection.scalars(query))

    def plan(self, study_id: str) -> StudyPlan:
        """Return what a study set out to do; NoStudyError if there is none of that id."""
        try:
            study = studies.get(self._engine, study_id)
        except NotFoundError as error:
            raise NoStudyError(str(error)) from error
        self._editions[study_id] = study.edition
        return for_analysis(study)

    def load(self, study_id: str) -> tuple[int, bytes | None]:
        """Return the cursor and the state last committed; (0, None) before the first commit."""
        query = sa.select(estimator_states).where(estimator_states.c.study_id == study_id)
        with reading(self._engine) as connection:
            row = connection.execute(query).one_or_none()
        return (0, None) if row is None else (row.cursor, row.state)

    def results_after(self, study_id: str, cursor: int, limit: int) -> list[LoggedResult]:
        """Return up to `limit` results with seq > `cursor`, in order of seq."""
        query = (
            sa.select(
                results.c.seq,
                results.c.row,
                results.c.position,
                results.c.outcome,
                results.c.outputs,
            )
            .where(
                results.c.study_id == study_id,
                results.c.seq > cursor,
                sa.exists().where(self._unchanged(study_id)),
            )
            .order_by(results.c.seq)
            .limit(limit)
        )
        with reading(self._engine) as connection:
            return [
                LoggedResult(
                    seq=row.seq,
                    instance=instance_id(study_id, row.row, row.position),
                    row=row.row,
                    position=row.position,
                    outcome=row.outcome,
                    outputs=row.outputs or {},
                )
                for row in connection.execute(query)
            ]

    def commit(
        self,
        study_id: str,
        *,
        expected_cursor: int,
        cursor: int,
        state: bytes,
        snapshot: dict[str, Any],
    ) -> bool:
        """Replace cursor, state and snapshot at once.

        False if another process was first, or the study has changed since `plan` was asked for.
        """
        advanced = {"cursor": cursor, "state": state}
        statement = sa.update(estimator_states).where(
            estimator_states.c.study_id == study_id,
            estimator_states.c.cursor == expected_cursor,
        )
        with writing(self._engine) as connection:
            # Locked, so that no re-run comes between.
            same = sa.select(studies_table.c.id).where(self._unchanged(study_id))
            if connection.scalar(same.with_for_update()) is None:
                return False
            taken = connection.execute(statement.values(advanced)).rowcount == 1
            if not taken and expected_cursor == 0:
                first = insert(connection, estimator_states).values(study_id=study_id, **advanced)
                first = first.on_conflict_do_nothing()
                key = connection.scalar(first.returning(estimator_states.c.study_id))
                taken = key is not None
            if not taken:
                return False
            connection.execute(
                insert(connection, snapshots)
                .values(study_id=study_id, snapshot=snapshot)
                .on_conflict_do_update(index_elements=["study_id"], set_={"snapshot": snapshot})
            )
        return True

    def pursue_goals(self) -> None:
        """Extend the complete studies that are less precise than they were to be."""
        for study_id in goals.due(self._engine):
            # One that was deleted since it was listed needs nothing.
            with suppress(NotFoundError):
                goals.pursue(self._engine, study_id)

    def _unchanged(self, study_id: str) -> sa.ColumnElement[bool]:
        return sa.and_(
            studies_table.c.id == study_id,
            studies_table.c.edition == self._editions.get(study_id, studies_table.c.edition),
        )

    def snapshot(self, study_id: str) -> dict[str, Any] | None:
        """Return the snapshot last committed; None before the first commit."""
        query = sa.select(snapshots.c.snapshot).where(snapshots.c.study_id == study_id)
        with reading(self._engine) as connection:
            found: dict[str, Any] | None = connection.scalar(query)
        return found
