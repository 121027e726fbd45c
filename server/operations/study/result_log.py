"""What the analysis reads and writes: the log of a study's results, and what it makes of them."""

from contextlib import AbstractContextManager, suppress
from typing import Any

from sqlalchemy.engine import Engine

from analysis.sensitivity.records import LoggedResult, StudyPlan
from server.errors import NoStudyError, NotFoundError
from server.logic.study.points import for_analysis, instance_id
from server.operations.study import precision_goals
from server.records import Study
from server.store.database.engine import alone_at, reading, writing
from server.store.fleet import results
from server.store.study import snapshots, studies


class StoreResultLog:
    """The coordinator's database as a `ResultLog` (`analysis.sensitivity.service` says of what)."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        #: Edition of each study when its plan was last asked for: what was made of an older one is
        #: refused, since its results may have been taken back, or its rows be more.
        self._editions: dict[str, int] = {}

    def alone(self) -> AbstractContextManager[bool]:
        return alone_at(self._engine, "analysis")

    def studies_with_news(self) -> list[str]:
        with reading(self._engine) as connection:
            return snapshots.studies_with_news(connection)

    def plan(self, study_id: str) -> StudyPlan:
        try:
            with reading(self._engine) as connection:
                study = studies.find(connection, study_id)
        except NotFoundError as error:
            raise NoStudyError(str(error)) from error
        self._editions[study_id] = study.edition
        return for_analysis(study)

    def load(self, study_id: str) -> tuple[int, bytes | None]:
        with reading(self._engine) as connection:
            return snapshots.state(connection, study_id)

    def results_after(self, study_id: str, cursor: int, limit: int) -> list[LoggedResult]:
        with suppress(NotFoundError), reading(self._engine) as connection:
            if self._is_unchanged(studies.find(connection, study_id)):
                return [
                    LoggedResult(
                        seq=seq,
                        instance=instance_id(study_id, row, position),
                        row=row,
                        position=position,
                        outcome=outcome,
                        outputs=outputs or {},
                    )
                    for seq, row, position, outcome, outputs in results.logged(
                        connection, study_id, after=cursor, limit=limit
                    )
                ]
        return []

    def commit(
        self,
        study_id: str,
        *,
        expected_cursor: int,
        cursor: int,
        state: bytes,
        snapshot: dict[str, Any],
    ) -> bool:
        with suppress(NotFoundError), writing(self._engine) as connection:
            # Locked, so that no re-run comes between.
            if self._is_unchanged(studies.find(connection, study_id, lock=True)) and (
                snapshots.advance(
                    connection, study_id, expected=expected_cursor, cursor=cursor, state=state
                )
            ):
                snapshots.publish(connection, study_id, snapshot)
                return True
        return False

    def act_on_precision_goals(self) -> None:
        for study_id in precision_goals.due(self._engine):
            # One that was deleted since it was listed needs nothing.
            with suppress(NotFoundError):
                precision_goals.act_on(self._engine, study_id)

    def snapshot(self, study_id: str) -> dict[str, Any] | None:
        """Return the snapshot last committed; None before the first commit."""
        with reading(self._engine) as connection:
            return snapshots.find(connection, study_id)

    def _is_unchanged(self, study: Study) -> bool:
        return self._editions.get(study.id, study.edition) == study.edition
