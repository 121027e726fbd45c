"""Studies: making, finding and cancelling them."""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from operator import attrgetter
from typing import Any
from uuid import uuid4

import sqlalchemy as sa
from pydantic_core import from_json
from sqlalchemy.engine import Connection, Engine

from analysis.designs.distributions import Distribution
from server.errors import ConflictError, NotFoundError
from server.logic.progress import block_ends, window_start
from server.logic.study import Plan, Study
from server.store.engine import insert, reading, writing
from server.store.prepared import Prepared, as_text, text
from server.store.schema import leases, results, studies

# Built once: see `server.store.ledger`.
_EVERY = sa.select(
    studies.c.id,
    studies.c.name,
    studies.c.model,
    studies.c.method,
    studies.c.sampling,
    studies.c.rows,
    studies.c.seed,
    text(studies.c.distributions),
    text(studies.c.fixed),
    text(studies.c.outputs),
    studies.c.state,
    studies.c.created_at,
    studies.c.finished_at,
    studies.c.handed_out,
    studies.c.leased,
    studies.c.result_count,
    studies.c.ok_count,
    studies.c.rows_complete,
    text(studies.c.failures),
    studies.c.priority,
    text(studies.c.tags),
    text(studies.c.identity),
    studies.c.edition,
)
_ONE = _EVERY.where(studies.c.id == sa.bindparam("of_study"))
_FIND, _FIND_LOCKED = Prepared(_ONE, "of_study"), Prepared(_ONE.with_for_update(), "of_study")
_TAKEN = studies.c.result_count + studies.c.leased
_WITH_WORK = Prepared(
    sa.select(studies.c.id, studies.c.model)
    .where(
        sa.or_(
            sa.and_(studies.c.state == "running", studies.c.instances > _TAKEN),
            sa.and_(studies.c.state == "draining", studies.c.handed_out > _TAKEN),
        )
    )
    .order_by(studies.c.priority.desc(), studies.c.created_at, studies.c.id)
)
#: The columns that change while a study runs.
_COURSE = (
    "state",
    "finished_at",
    "handed_out",
    "leased",
    "result_count",
    "ok_count",
    "rows_complete",
    "failures",
    "rows",
    "instances",
    "priority",
    "identity",
    "edition",
)
#: Those of them that count instances; and what takes these from a study.
_COUNTS = ("handed_out", "leased", "result_count", "ok_count", "rows_complete")
_COUNTS_OF = attrgetter(*_COUNTS)
_ONE_TO_SAVE = sa.update(studies).where(studies.c.id == sa.bindparam("of_study"))
_SAVE, _SAVE_COUNTS = (
    Prepared(_ONE_TO_SAVE, "of_study", *_COURSE),
    Prepared(_ONE_TO_SAVE, "of_study", *_COUNTS),
)


@dataclass(frozen=True, kw_only=True)
class Standing:
    """A study and what else its progress is told from."""

    study: Study
    #: When the result from which on the rate is counted arrived (seconds, UTC epoch).
    window_opened_at: float
    #: When the results arrived between which the rate's spread is taken.
    passed_at: tuple[float, ...]
    #: Workers that hold a lease of this study now.
    workers: int


def create(
    engine: Engine,
    plan: Plan,
    *,
    key: str | None,
    digest: str,
    now: float,
    priority: int = 0,
    tags: Sequence[str] = (),
    within: Callable[[Connection, str], None] = lambda connection, study_id: None,
) -> tuple[Study, bool]:
    """Store a new study, whatever its size, in constant time.

    Args:
        engine: where.
        plan: what the study is to evaluate.
        key: idempotency key of the request; a key that was used before makes no second study.
        digest: digest of the request, to tell a repeated request from another under the same key.
        now: seconds, UTC epoch.
        priority: of two studies with work, the higher one is served.
        tags: what a worker must call itself to be given any of it.
        within: called with the id of a new study, to write what else there is in its transaction.

    Returns:
        The study, and whether it is new.

    Raises:
        ConflictError: the key was used for a different request.
    """
    study = Study(
        id=uuid4().hex[:12],
        plan=plan,
        state="running",
        created_at=now,
        finished_at=None,
        handed_out=0,
        leased=0,
        result_count=0,
        ok_count=0,
        rows_complete=0,
        failures={},
        priority=priority,
        tags=tuple(tags),
    )
    values = {**_row(study), "idempotency_key": key, "request_digest": digest}
    with writing(engine) as connection:
        statement = insert(connection, studies).values(values)
        statement = statement.on_conflict_do_nothing(index_elements=["idempotency_key"])
        # Not every driver counts inserted rows, but all return them.
        if connection.scalar(statement.returning(studies.c.id)) is not None:
            within(connection, study.id)
            return study, True
        of_key = _EVERY.add_columns(studies.c.request_digest).where(
            studies.c.idempotency_key == key
        )
        *first, first_digest = connection.execute(of_key).one()
    if first_digest != digest:
        raise ConflictError(f"the idempotency key {key!r} was used for a different study")
    return _study(first), False


def get(engine: Engine, study_id: str) -> Study:
    """Return a study; NotFoundError if there is none of that id."""
    with reading(engine) as connection:
        return find(connection, study_id)


def every(engine: Engine) -> list[Study]:
    """Return all studies, oldest first."""
    with reading(engine) as connection:
        found = connection.execute(_EVERY.order_by(studies.c.created_at, studies.c.id))
        return [_study(row) for row in found]


def standing(engine: Engine, study_id: str, *, now: float) -> Standing:
    """Return a study and how it has been going; NotFoundError if there is none of that id."""
    with reading(engine) as connection:
        study = find(connection, study_id)
        opening, ends = window_start(study.result_count), block_ends(study.result_count)
        arrivals = connection.execute(
            sa.select(results.c.seq, results.c.received_at).where(
                results.c.study_id == study_id, results.c.seq.in_([opening, *ends])
            )
        )
        arrived_at = {0: study.created_at} | {row.seq: row.received_at for row in arrivals}
        workers = connection.scalar(
            sa.select(sa.func.count(leases.c.worker_id.distinct())).where(
                leases.c.study_id == study_id,
                leases.c.state == "open",
                leases.c.expires_at > now,
            )
        )
    return Standing(
        study=study,
        window_opened_at=arrived_at[opening],
        passed_at=tuple(arrived_at[number] for number in ends),
        workers=workers or 0,
    )


def cancel(engine: Engine, study_id: str, *, now: float) -> Study:
    """Stop handing out a study's instances; results of those already out are still taken.

    Raises:
        NotFoundError: there is no study of that id.
        ConflictError: the study is already complete.
    """
    with writing(engine) as connection:
        study = find(connection, study_id, lock=True)
        if study.state == "complete":
            raise ConflictError(f"study {study_id} is already complete")
        if study.state != "cancelled":
            study = replace(study, state="cancelled", finished_at=now)
            save(connection, study)
    return study


def find(connection: Connection, study_id: str, *, lock: bool = False) -> Study:
    """Return a study within a transaction; NotFoundError if there is none of that id.

    Args:
        connection: the transaction.
        study_id: which study.
        lock: make every other transaction that locks this study wait until this one ends.
    """
    query = _FIND_LOCKED if lock else _FIND
    row = query.execute(connection, study_id).fetchone()
    if row is None:
        raise NotFoundError(f"there is no study {study_id!r}")
    return _study(row)


def locked(connection: Connection, study: Study) -> Study:
    """Return a study read before in the same transaction, as it is now and stays until its end."""
    if connection.dialect.name == "sqlite":
        # Whoever writes is alone: nothing has changed since.
        return study
    return find(connection, study.id, lock=True)


def with_work(
    connection: Connection, models: Sequence[str], *, known: Study | None = None
) -> Iterator[Study]:
    """Yield the running studies of `models` with something to hand out, first to serve first.

    Args:
        connection: a transaction.
        models: the models that may be asked for.
        known: a study as it is now, if the transaction knows one.
    """
    for study_id, model in _WITH_WORK.execute(connection).fetchall():
        if model not in models:
            continue
        if known is not None and known.id == study_id:
            yield known
        # Only what somebody looks at is read whole, and may be gone by then.
        elif (row := _FIND.execute(connection, study_id).fetchone()) is not None:
            yield _study(row)


def save(connection: Connection, study: Study, *, counted: bool = False) -> None:
    """Write back how far a study is, which was read, locked, in the same transaction.

    `counted`: that nothing has changed but how many of its instances are where. What is the same is
    not written then, least of all its state, for which an index is written too.
    """
    if counted:
        _SAVE_COUNTS.execute(connection, study.id, *_COUNTS_OF(study))
        return
    course = _course(study)
    for name in ("failures", "identity"):
        course[name] = None if course[name] is None else as_text(course[name])
    _SAVE.execute(connection, study.id, *course.values())


def _row(study: Study) -> dict[str, Any]:
    plan = study.plan
    return {
        "id": study.id,
        "name": plan.name,
        "model": plan.model,
        "method": plan.method,
        "sampling": plan.sampling,
        "seed": plan.seed,
        # A list, because the order of the factors is the order of the design's columns.
        "distributions": [[name, d.to_json()] for name, d in plan.distributions.items()],
        "fixed": dict(plan.fixed),
        "outputs": list(plan.outputs),
        "created_at": study.created_at,
        "tags": list(study.tags),
        **_course(study),
    }


def _course(study: Study) -> dict[str, Any]:
    """Return the values of `_COURSE`."""
    return {
        "state": study.state,
        "finished_at": study.finished_at,
        "handed_out": study.handed_out,
        "leased": study.leased,
        "result_count": study.result_count,
        "ok_count": study.ok_count,
        "rows_complete": study.rows_complete,
        "failures": dict(study.failures),
        "rows": study.plan.rows,
        "instances": study.plan.instances,
        "priority": study.priority,
        "identity": None if study.identity is None else dict(study.identity),
        "edition": study.edition,
    }


def _study(row: Sequence[Any]) -> Study:
    """Return the study that a row of `_EVERY` holds."""
    (
        study_id,
        *described,
        state,
        created_at,
        finished_at,
        handed_out,
        leased,
        result_count,
        ok_count,
        rows_complete,
        failures,
        priority,
        tags,
        identity,
        edition,
    ) = row
    return Study(
        id=study_id,
        plan=_plan(*described),
        state=state,
        created_at=created_at,
        finished_at=finished_at,
        handed_out=handed_out,
        leased=leased,
        result_count=result_count,
        ok_count=ok_count,
        rows_complete=rows_complete,
        failures=from_json(failures),
        priority=priority,
        tags=tuple(from_json(tags)),
        identity=None if identity is None else from_json(identity),
        edition=edition,
    )


@lru_cache(maxsize=256)
def _plan(
    name: str,
    model: str,
    method: str,
    sampling: str,
    rows: int,
    seed: int,
    distributions: str,
    fixed: str,
    outputs: str,
) -> Plan:
    """Return a stored plan; to check its distributions takes longer than all else of reading it."""
    return Plan(
        name=name,
        model=model,
        method=method,
        sampling=sampling,
        rows=rows,
        seed=seed,
        distributions={n: Distribution.from_json(d) for n, d in json.loads(distributions)},
        fixed=json.loads(fixed),
        outputs=tuple(json.loads(outputs)),
    )
