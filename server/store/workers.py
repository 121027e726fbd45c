"""Who works for this coordinator."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine

from server.logic.hosts import host_class
from server.store.engine import insert, reading
from server.store.schema import leases, workers


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
    now: float,
) -> None:
    """Remember a worker, or what it now says of itself."""
    told = {
        "host": host,
        "versions": dict(versions),
        "host_class": host_class(versions),
        "tags": list(tags),
        "last_seen": now,
    }
    connection.execute(
        insert(connection, workers)
        .values(id=worker, instances_done=0, **told)
        .on_conflict_do_update(index_elements=["id"], set_=told)
    )


def host_of(connection: Connection, worker: str) -> str | None:
    """Return the machine a worker runs on; None if it never said so."""
    host: str | None = connection.scalar(sa.select(workers.c.host).where(workers.c.id == worker))
    return host


def others_at_work(
    connection: Connection, study_id: str, *, host: str, host_class: str, now: float
) -> bool:
    """Say whether another host of the same class works on a study now."""
    query = (
        sa.select(sa.literal(1))
        .select_from(leases.join(workers, workers.c.id == leases.c.worker_id))
        .where(
            leases.c.state == "open",
            leases.c.study_id == study_id,
            leases.c.expires_at > now,
            workers.c.host != host,
            workers.c.host_class == host_class,
        )
    )
    return connection.scalar(query.limit(1)) is not None


def heard_from(connection: Connection, worker: str, *, done: int = 0, now: float) -> None:
    """Note that a worker was in touch and how many final results it brought."""
    connection.execute(
        sa.update(workers)
        .where(workers.c.id == worker)
        .values(last_seen=now, instances_done=workers.c.instances_done + done)
    )
