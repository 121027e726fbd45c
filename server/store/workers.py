"""Who works for this coordinator."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.engine import Connection, Engine

from server.logic.hosts import host_class
from server.store.engine import reading
from server.store.prepared import Prepared, as_text
from server.store.schema import leases, workers

# Built once: see `server.store.ledger`.
_HOSTS_AT_WORK = Prepared(
    sa.select(workers.c.host)
    .select_from(leases.join(workers, workers.c.id == leases.c.worker_id))
    .where(
        leases.c.state == sa.literal_column("'open'"),
        leases.c.study_id == sa.bindparam("of_study"),
        leases.c.expires_at > sa.bindparam("now"),
        workers.c.host_class == sa.bindparam("of_class"),
    )
    .distinct(),
    "of_study",
    "now",
    "of_class",
)
#: What a worker tells each time.
_TOLD = ("host", "versions", "host_class", "tags", "last_seen")
_INTRODUCE = {
    dialect: Prepared(
        statement.on_conflict_do_update(
            index_elements=["id"],
            set_={
                **{name: statement.excluded[name] for name in _TOLD},
                "instances_done": workers.c.instances_done + statement.excluded.instances_done,
            },
        ),
        "id",
        "instances_done",
        *_TOLD,
    )
    for dialect, statement in (
        ("sqlite", sqlite.insert(workers)),
        ("postgresql", postgresql.insert(workers)),
    )
}
_HEARD_FROM = Prepared(
    sa.update(workers)
    .where(workers.c.id == sa.bindparam("of_worker"))
    .values(
        last_seen=sa.bindparam("now"),
        instances_done=workers.c.instances_done + sa.bindparam("done"),
    ),
    "of_worker",
    "now",
    "done",
)


@dataclass(frozen=True, kw_only=True)
class Worker:
    """A process that evaluates instances."""

    id: str
    host: str
    #: What decides whether two machines compute the same bits.
    versions: Mapping[str, str]
    #: Seconds, UTC epoch.
    last_seen: float
    #: Instances whose final result it reported.
    instances_done: int
    #: Machines of one class compute the same bits; None if it last asked before there were any.
    host_class: str | None
    #: What it says it is good for.
    tags: Sequence[str]


def every(engine: Engine) -> list[Worker]:
    """Return all workers ever seen, the latest first."""
    query = sa.select(workers).order_by(workers.c.last_seen.desc(), workers.c.id)
    with reading(engine) as connection:
        return [Worker(**row._mapping) for row in connection.execute(query)]


def introduce(
    connection: Connection,
    worker: str,
    *,
    host: str,
    versions: Mapping[str, str],
    tags: Sequence[str],
    done: int = 0,
    now: float,
) -> None:
    """Remember a worker, or what it now says of itself, and how many final results it brought."""
    _INTRODUCE[connection.dialect.name].execute(
        connection,
        worker,
        done,
        host,
        as_text(dict(versions)),
        host_class(versions),
        as_text(list(tags)),
        now,
    )


def hosts_at_work(
    connection: Connection, study_id: str, *, host_class: str | None, now: float
) -> set[str]:
    """Return the hosts of a class that work on a study now."""
    found = _HOSTS_AT_WORK.execute(connection, study_id, now, host_class)
    return {host for (host,) in found}


def heard_from(connection: Connection, worker: str, *, done: int = 0, now: float) -> None:
    """Note that a worker was in touch and how many final results it brought."""
    _HEARD_FROM.execute(connection, worker, now, done)
