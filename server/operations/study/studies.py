"""Studies: making them, and what an operator does with one under way."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from uuid import uuid4

from sqlalchemy.engine import Connection, Engine

from server.errors import ConflictError
from server.logic.fleet.hosts import GONE_SECONDS
from server.logic.fleet.unserved import Patience, why_it_waits, why_its_rows_wait, why_refused
from server.logic.study import studies as life
from server.logic.study.points import parameters
from server.logic.study.progress import (
    UNSEEN_SECONDS,
    Pace,
    block_ends,
    first_left,
    pace,
    window_start,
)
from server.records import Plan, PrecisionGoal, Study
from server.states import StudyState
from server.store import models
from server.store.database.engine import alone_reading, reading, writing
from server.store.fleet import leases, results, workers
from server.store.study import instances, precision_goals, snapshots, studies

get = alone_reading(studies.find)
every = alone_reading(studies.every)
listed = alone_reading(studies.listed)

#: Workers that are looked at for why a study waits.
MOST_ASKED = 100


@dataclass(frozen=True, kw_only=True)
class Standing:
    """A study and what else its progress is told from."""

    study: Study
    goal: PrecisionGoal | None
    #: When the result from which on the rate is counted arrived (seconds, UTC epoch).
    window_opened_at: float
    #: When the results arrived between which the rate's spread is taken.
    passed_at: tuple[float, ...]
    #: Workers that hold a lease of this study now.
    workers: int
    #: Its model, "name@digest", if no worker has it; None if one has, or nothing is left to do.
    waits_for: str | None
    #: Why nobody holds any of it, in a sentence; None if a worker may. If its model is missing:
    #: why workers refuse it.
    why_it_waits: str | None
    #: Results that no analysis has taken in, though it should have for a while.
    left_by_analysis: int

    def pace(self, now: float) -> Pace:
        """Return how fast results come."""
        return pace(
            self.study,
            window_opened_at=self.window_opened_at,
            now=now,
            passed_at=self.passed_at,
            at_work=self.workers > 0,
        )


def make_ready(engine: Engine) -> None:
    """Draw a row of each sampling that leases will draw from.

    To import what that takes needs a second, in which an event loop would stand still.
    """
    served = {one.plan.sampling: one.plan for one in every(engine) if one.state.is_served}
    for plan in served.values():
        parameters(plan, 0)


def create(
    engine: Engine,
    plan: Plan,
    *,
    key: str | None,
    digest: str,
    now: float,
    priority: int = 0,
    tags: Sequence[str] = (),
    goal: PrecisionGoal | None = None,
) -> tuple[Study, bool]:
    """Store a new study, whatever its size, in constant time.

    Args:
        key: idempotency key of the request; a key that was used before makes no second study.
        digest: digest of the request, to tell a repeated request from another under the same key.

    Returns:
        The study, and whether it is new.

    Raises:
        ConflictError: the key was used for a different request.
    """
    study = Study(
        id=uuid4().hex[:12],
        plan=plan,
        state=StudyState.RUNNING,
        created_at=now,
        priority=priority,
        tags=tuple(tags),
    )
    with writing(engine) as connection:
        if studies.add(connection, study, key=key, digest=digest):
            if goal is not None:
                precision_goals.put(connection, study.id, goal)
            return study, True
        first, first_digest = studies.of_key(connection, key)
    if first_digest != digest:
        raise ConflictError(f"the idempotency key {key!r} was used for a different study")
    return first, False


def standing(engine: Engine, study_id: str, *, now: float, patience: Patience) -> Standing:
    """Return a study and how it has been going."""
    with reading(engine) as connection:
        study = studies.find(connection, study_id)
        opening, ends = window_start(study.result_count), block_ends(study.result_count)
        cursor, rows_seen = snapshots.seen(connection, study_id, of=study.result_count)
        left = first_left(study, cursor=cursor, rows_seen=rows_seen)
        wanted = [opening, *ends] if left is None else [opening, *ends, left]
        arrivals = results.arrivals(connection, study_id, wanted)
        arrived_at = {0: study.created_at} | arrivals
        holding = leases.workers_of(connection, study_id, now=now)
        missing = _waits_for(connection, study, now)
        idle = study.state.is_served and study.pending and not holding
        return Standing(
            study=study,
            goal=precision_goals.find(connection, study_id),
            window_opened_at=arrived_at[opening],
            passed_at=tuple(arrived_at[number] for number in ends),
            workers=holding,
            waits_for=missing,
            why_it_waits=_why_it_waits(connection, study, missing, now, patience) if idle else None,
            left_by_analysis=study.result_count - cursor
            if left is not None and now > arrived_at[left] + UNSEEN_SECONDS
            else 0,
        )


def _waits_for(connection: Connection, study: Study, now: float) -> str | None:
    model = study.plan.model
    # Every worker has rehyb's own models, which studies call without a digest.
    if "@" not in model or not study.state.is_served or not study.pending:
        return None
    if workers.any_has(connection, model, heard_after=now - GONE_SECONDS, now=now):
        return None
    found = models.find(connection, model)
    # Every worker can have an uploaded model; one that is busy looks for new ones when it is not.
    if found is not None and found.size and workers.any_holds_a_lease(connection, now=now):
        return None
    return model


def _why_it_waits(
    connection: Connection, study: Study, missing: str | None, now: float, patience: Patience
) -> str | None:
    # Of ten thousand workers the last few tell as much as all.
    alive = workers.heard(connection, after=now - GONE_SECONDS, most=MOST_ASKED)
    if missing is not None:
        return why_refused(missing, alive)
    why = why_it_waits(study, alive, now - patience.since)
    return why or _why_its_rows_wait(connection, study, now, patience)


def _why_its_rows_wait(
    connection: Connection, study: Study, now: float, patience: Patience
) -> str | None:
    if not study.returned:
        return None
    return why_its_rows_wait(
        study,
        instances.waiting_by_class(connection, study.id),
        workers.heard(connection, after=now - patience.seconds),
        now=now,
        patience=patience,
    )


why_rows_wait = alone_reading(_why_its_rows_wait)


def cancel(engine: Engine, study_id: str, *, now: float) -> Study:
    """Stop handing out a study's instances; results of those already out are still taken.

    Raises:
        ConflictError: the study is already complete.
    """
    return _change(engine, study_id, lambda study: life.cancelled(study, now))


def switch(engine: Engine, study_id: str, state: StudyState) -> Study:
    """Pause, drain or resume a study; results under way are taken.

    Raises:
        ConflictError: the study is complete or cancelled.
    """
    return _change(engine, study_id, lambda study: life.switched(study, state))


def prioritise(engine: Engine, study_id: str, priority: int) -> Study:
    """Serve a study before all of lower priority."""
    return _change(engine, study_id, lambda study: replace(study, priority=priority))


def extend(engine: Engine, study_id: str, rows: int) -> Study:
    """Give a study more rows; what there is stays, and a complete study runs again.

    `rows`: how many it has then in all, so that asking twice changes nothing.

    Raises:
        InvalidStudyError: no study can have that many.
        ConflictError: it is cancelled, or has more.
    """
    return _change(engine, study_id, lambda study: life.extended(study, rows))


def delete(engine: Engine, study_id: str) -> None:
    """Remove a study and everything that belongs to it.

    Raises:
        ConflictError: it still runs.
    """
    with writing(engine) as connection:
        study = studies.find(connection, study_id, lock=True)
        if study.state.is_served:
            raise ConflictError(f"study {study_id} is {study.state}: pause or cancel it first")
        studies.delete(connection, study_id)


def _change(engine: Engine, study_id: str, change: Callable[[Study], Study]) -> Study:
    with writing(engine) as connection:
        before = studies.find(connection, study_id, lock=True)
        after = change(before)
        if after != before:
            studies.save(connection, after)
    return after
