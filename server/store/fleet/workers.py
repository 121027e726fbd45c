"""Who works for this coordinator, and who of them can close loops and interpret."""

from collections.abc import Sequence
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from server.records import Worker
from server.store.database.engine import insert
from server.store.database.prepared import Prepared
from server.store.database.schema import leases, loop_workers, studies, workers

#: Who finished one of so many latest leases and still speaks is at work, between two of them, too.
#: Not who gives them back: an instance would wait for ever for a host that does no more.
_LATEST_LEASES = 1000

# Built once: see `server.store.study.studies`.
_HOSTS = (
    sa.select(workers.c.host)
    .select_from(leases.join(workers, workers.c.id == leases.c.worker_id))
    .where(
        leases.c.study_id == sa.bindparam("of_study"),
        leases.c.host_class == sa.bindparam("of_class"),
    )
)
_OTHERS = leases.alias("others")
_NOW: sa.BindParameter[Any] = sa.bindparam("now")
HOSTS_AT_WORK = Prepared(
    sa.union(
        # As the index has it: see `server.store.study.instances`.
        _HOSTS.where(leases.c.state == sa.literal_column("'open'"), leases.c.expires_at > _NOW),
        _HOSTS.where(
            leases.c.state == sa.literal_column("'finished'"),
            leases.c.fence
            > sa.select(sa.func.max(_OTHERS.c.fence)).scalar_subquery() - _LATEST_LEASES,
            workers.c.last_seen > sa.bindparam("heard_after"),
            # Who is at work on another study may be so for long.
            ~sa.exists().where(
                _OTHERS.c.worker_id == workers.c.id,
                _OTHERS.c.state == sa.literal_column("'open'"),
                _OTHERS.c.expires_at > _NOW,
                _OTHERS.c.study_id != sa.bindparam("of_study"),
            ),
        ),
    ),
    "of_study",
    "now",
    "of_class",
    "heard_after",
)
_HEARD_FROM = Prepared(
    sa.update(workers)
    .where(workers.c.id == sa.bindparam("of_worker"))
    .values(last_seen=sa.bindparam("now"))
)


def latest(connection: Connection) -> float:
    """Return when the last worker was heard from or the last study made; 0 if there was none."""
    seen = (workers.c.last_seen, loop_workers.c.last_seen, studies.c.created_at)
    return max(connection.scalar(sa.select(sa.func.max(column))) or 0.0 for column in seen)


def every(connection: Connection) -> list[Worker]:
    """Return all workers ever seen, the latest first."""
    query = sa.select(workers).order_by(workers.c.last_seen.desc(), workers.c.id)
    return [_worker(row) for row in connection.execute(query)]


def heard(connection: Connection, *, after: float, most: int | None = None) -> list[Worker]:
    """Return the workers that were heard from since then, or the `most` last ones of them."""
    query = sa.select(workers).where(workers.c.last_seen > after)
    if most is not None:
        query = query.order_by(workers.c.last_seen.desc()).limit(most)
    return [_worker(row) for row in connection.execute(query)]


def latest_of(connection: Connection, beginning: str, *, most: int) -> list[Worker]:
    """Return the workers with ids that begin so who were heard from last."""
    # Not LIKE, for which SQLite takes "LAB" for "lab".
    begins = sa.func.substr(workers.c.id, 1, len(beginning)) == beginning
    query = sa.select(workers).where(begins)
    query = query.order_by(workers.c.last_seen.desc(), workers.c.id).limit(most)
    return [_worker(row) for row in connection.execute(query)]


def find(connection: Connection, worker: str) -> Worker | None:
    """Return a worker as it last introduced itself; None if it never did."""
    found = connection.execute(sa.select(workers).where(workers.c.id == worker)).one_or_none()
    return None if found is None else _worker(found)


def any_has(connection: Connection, model: str, *, heard_after: float, now: float) -> bool:
    """Say whether a worker that is there has a model, "name@digest".

    A worker is there that was heard from since `heard_after`, or that holds a lease: one that is
    busy need not say a word in between.
    """
    holding = sa.select(leases.c.worker_id).where(
        leases.c.state == sa.literal_column("'open'"), leases.c.expires_at > now
    )
    there = sa.or_(workers.c.last_seen > heard_after, workers.c.id.in_(holding))
    return any(
        model in models for models in connection.scalars(sa.select(workers.c.models).where(there))
    )


def any_holds_a_lease(connection: Connection, *, now: float) -> bool:
    """Say whether any worker is busy, and will look for new models when it is not."""
    query = sa.select(leases.c.id).where(
        leases.c.state == sa.literal_column("'open'"), leases.c.expires_at > now
    )
    return connection.scalar(query.limit(1)) is not None


def heard_from(connection: Connection, worker: str, *, now: float) -> None:
    """Note that a worker was in touch."""
    _HEARD_FROM.execute(connection, now, worker)


def note_close_loops(
    connection: Connection, worker: str, *, bank: str | None = None, now: float
) -> None:
    """Note that a worker, which was introduced before, is there to close loops.

    With a bank it interprets, too; without one what it has is not forgotten.
    """
    known = {"last_seen": now} | ({} if bank is None else {"bank": bank})
    statement = insert(connection, loop_workers).values(worker_id=worker, **known)
    connection.execute(statement.on_conflict_do_update(index_elements=["worker_id"], set_=known))


def close_loops_noted(connection: Connection, worker: str) -> float | None:
    """Return when it was last noted that a worker is there to close loops; None: never."""
    query = sa.select(loop_workers.c.last_seen).where(loop_workers.c.worker_id == worker)
    noted: float | None = connection.scalar(query)
    return noted


def closing_loops(connection: Connection, *, heard_after: float, but_on: str | None = None) -> int:
    """Return how many workers that can close loops were heard from since then.

    `but_on`: without those on this host.
    """
    return len(_at_loops(connection, heard_after, but_on))


def banks(connection: Connection, *, heard_after: float, but_on: str | None = None) -> list[str]:
    """Return the banks of workers that interpret, and were heard from since then, one of each.

    `but_on`: without those on this host.
    """
    return [bank for bank in _at_loops(connection, heard_after, but_on) if bank is not None]


def _at_loops(
    connection: Connection, heard_after: float, but_on: str | None
) -> Sequence[str | None]:
    joined = loop_workers.join(workers, workers.c.id == loop_workers.c.worker_id)
    query = sa.select(loop_workers.c.bank).select_from(joined)
    query = query.where(loop_workers.c.last_seen > heard_after)
    if but_on is not None:
        query = query.where(workers.c.host != but_on)
    return connection.scalars(query).all()


def _worker(row: sa.Row[Any]) -> Worker:
    values = dict(row._mapping)
    # Before there were canaries, names alone were told.
    models = values["models"]
    return Worker(
        **values | {"models": models if isinstance(models, dict) else dict.fromkeys(models, "")}
    )
