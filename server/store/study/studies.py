"""Studies, and how far each has come."""

import json
from collections.abc import Sequence
from dataclasses import fields
from functools import lru_cache
from operator import attrgetter
from typing import Any

import sqlalchemy as sa
from pydantic_core import from_json
from sqlalchemy.engine import Connection

from analysis.designs.dependence import Dependence
from analysis.designs.distributions import Distribution
from models.curves import Curve
from server.errors import NotFoundError
from server.records import Plan, Study
from server.states import StudyState
from server.store.database.engine import insert
from server.store.database.prepared import Prepared, as_text, text
from server.store.database.schema import metadata, studies

#: What a study is read from: its plan's columns first, then its own.
_OF_PLAN = [field.name for field in fields(Plan)]
_OWN = [field.name for field in fields(Study) if field.name != "plan"]
#: The columns that change while a study runs, besides rows and instances of its plan.
_COURSE = [name for name in _OWN if name not in ("id", "created_at", "tags")]
#: Those of them that count instances; and what takes these from a study.
_COUNTS = ("handed_out", "leased", "result_count", "ok_count", "rows_complete")
_COUNTS_OF = attrgetter(*_COUNTS)
#: What a list tells of a study: nothing whose length depends on how many factors it has.
LISTED = (
    *("id", "name", "model", "method", "sampling", "rows", "seed"),
    *("state", "instances", "created_at", "priority", "tags"),
)
_STATES = {state.value: state for state in StudyState}

# Built once: building a statement takes SQLAlchemy longer than executing it takes the database.
_EVERY = sa.select(
    *(
        text(studies.c[name]) if isinstance(studies.c[name].type, sa.JSON) else studies.c[name]
        for name in (*_OF_PLAN, *_OWN)
    )
)
_ONE = _EVERY.where(studies.c.id == sa.bindparam("of_study"))
# Without SKIP LOCKED: a worker that skipped the only study with work would leave without any.
FIND, FIND_LOCKED = Prepared(_ONE), Prepared(_ONE.with_for_update())
_TAKEN = studies.c.result_count + studies.c.leased
_WAITING = sa.case(
    (studies.c.state == StudyState.RUNNING, studies.c.instances - _TAKEN),
    (studies.c.state == StudyState.DRAINING, studies.c.handed_out - _TAKEN),
    else_=0,
)
_WORK = sa.select(sa.func.sum(_WAITING), sa.func.sum(studies.c.leased))
_SERVED = _EVERY.where(_WAITING > 0)
_ONE_TO_SAVE = sa.update(studies).where(studies.c.id == sa.bindparam("of_study"))
_SAVE = Prepared(_ONE_TO_SAVE, "of_study", "rows", "instances", *_COURSE)
_SAVE_COUNTS = Prepared(_ONE_TO_SAVE, "of_study", *_COUNTS)


def add(connection: Connection, study: Study, *, key: str | None, digest: str) -> bool:
    """Store a new study; False if there is one with the same idempotency key."""
    plan = study.plan
    values = {
        **{name: getattr(plan, name) for name in _OF_PLAN},
        **{name: getattr(study, name) for name in _OWN},
        # A list, because the order of the factors is the order of the design's columns.
        "groups": [[name, list(members)] for name, members in plan.groups.items()],
        "curves": {name: curve.as_json() for name, curve in plan.curves.items()},
        "distributions": [[name, d.to_json()] for name, d in plan.distributions.items()],
        "dependence": plan.dependence and plan.dependence.to_json(),
        "instances": plan.instances,
        "idempotency_key": key,
        "request_digest": digest,
    }
    statement = insert(connection, studies).values(values)
    statement = statement.on_conflict_do_nothing(index_elements=["idempotency_key"])
    # Not every driver counts inserted rows, but all return them.
    return connection.scalar(statement.returning(studies.c.id)) is not None


def of_key(connection: Connection, key: str | None) -> tuple[Study, str]:
    """Return the study with an idempotency key, and the digest of its request."""
    query = _EVERY.add_columns(studies.c.request_digest)
    *row, digest = connection.execute(query.where(studies.c.idempotency_key == key)).one()
    return study_of(row), digest


def every(connection: Connection) -> list[Study]:
    """Return all studies, oldest first."""
    found = connection.execute(_EVERY.order_by(studies.c.created_at, studies.c.id))
    return [study_of(row) for row in found]


def listed(
    connection: Connection, *, after: tuple[float, str] | None, limit: int
) -> list[dict[str, Any]]:
    """Return `LISTED` of so many studies, oldest first.

    Args:
        after: when the last one of the page before was made, and its id.
    """
    query = sa.select(*(studies.c[name] for name in LISTED))
    if after is not None:
        query = query.where(sa.tuple_(studies.c.created_at, studies.c.id) > after)
    query = query.order_by(studies.c.created_at, studies.c.id).limit(limit)
    return [dict(row) for row in connection.execute(query).mappings()]


def find(connection: Connection, study_id: str, *, lock: bool = False) -> Study:
    """Return a study; NotFoundError if there is none of that id.

    `lock`: every other transaction that locks this study waits until this one ends.
    """
    query = FIND_LOCKED if lock else FIND
    row = query.execute(connection, study_id).fetchone()
    if row is None:
        raise NotFoundError(f"there is no study {study_id!r}")
    return study_of(row)


def work(connection: Connection) -> tuple[int, int]:
    """Return how many instances could be handed out now, and how many workers have."""
    waiting, under_way = connection.execute(_WORK).one()
    return int(waiting or 0), int(under_way or 0)


def served(connection: Connection) -> list[Study]:
    """Return the studies of which instances could be handed out now."""
    return [study_of(row) for row in connection.execute(_SERVED)]


def save(connection: Connection, study: Study, *, counted: bool = False) -> None:
    """Write back how far a study is, which was read, locked, in the same transaction.

    `counted`: that nothing has changed but how many of its instances are where. What is the same is
    not written then, least of all its state, for which an index is written too.
    """
    statement, values = saving(study, counted=counted)
    statement.execute(connection, *values)


def saving(study: Study, *, counted: bool) -> tuple[Prepared, tuple[Any, ...]]:
    """Return the statement of `save`, and its values."""
    if counted:
        return _SAVE_COUNTS, (study.id, *_COUNTS_OF(study))
    course = {name: getattr(study, name) for name in _COURSE}
    for name in ("failures", "identity"):
        course[name] = None if course[name] is None else as_text(course[name])
    return _SAVE, (study.id, study.plan.rows, study.plan.instances, *course.values())


def delete(connection: Connection, study_id: str) -> None:
    """Remove a locked study and everything that belongs to it."""
    for table in metadata.tables.values():
        if "study_id" in table.c:
            connection.execute(sa.delete(table).where(table.c.study_id == study_id))
    connection.execute(sa.delete(studies).where(studies.c.id == study_id))


def study_of(row: Sequence[Any]) -> Study:
    """Return the study that a row of `_EVERY` holds."""
    own = dict(zip(_OWN, row[len(_OF_PLAN) :], strict=True))
    own["state"] = _STATES[own["state"]]
    own["failures"] = from_json(own["failures"])
    own["tags"] = tuple(from_json(own["tags"]))
    if own["identity"] is not None:
        own["identity"] = from_json(own["identity"])
    return Study(plan=_plan(*row[: len(_OF_PLAN)]), **own)


@lru_cache(maxsize=256)
def _plan(*row: Any) -> Plan:
    """Return a stored plan; to check its distributions takes longer than all else of reading it."""
    plan = dict(zip(_OF_PLAN, row, strict=True))
    distributions = json.loads(plan["distributions"])
    plan["distributions"] = {name: Distribution.from_json(d) for name, d in distributions}
    plan["fixed"] = json.loads(plan["fixed"])
    plan["outputs"] = tuple(json.loads(plan["outputs"]))
    plan["groups"] = {name: tuple(members) for name, members in json.loads(plan["groups"])}
    curves = json.loads(plan["curves"])
    plan["curves"] = {name: Curve.from_json(curve) for name, curve in curves.items()}
    if plan["dependence"] is not None:
        plan["dependence"] = Dependence.from_json(json.loads(plan["dependence"]))
    return Plan(**plan)
