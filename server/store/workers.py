"""Who works for this coordinator."""

from collections.abc import Mapping
from dataclasses import dataclass

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine

from server.store.engine import insert, reading
from server.store.schema import workers


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


def every(engine: Engine) -> list[Worker]:
    """Return all workers ever seen, the latest first."""
    query = sa.select(workers).order_by(workers.c.last_seen.desc(), workers.c.id)
    with reading(engine) as connection:
        return [Worker(**row._mapping) for row in connection.execute(query)]


def introduce(
    connection: Connection, worker: str, *, host: str, versions: Mapping[str, str], now: float
) -> None:
    """Remember a worker, or what it now says of itself."""
    told = {"host": host, "versions": dict(versions), "last_seen": now}
    connection.execute(
        insert(connection, workers)
        .values(id=worker, instances_done=0, **told)
        .on_conflict_do_update(index_elements=["id"], set_=told)
    )


def heard_from(connection: Connection, worker: str, *, done: int = 0, now: float) -> None:
    """Note that a worker was in touch and how many final results it brought."""
    connection.execute(
        sa.update(workers)
        .where(workers.c.id == worker)
        .values(last_seen=now, instances_done=workers.c.instances_done + done)
    )
