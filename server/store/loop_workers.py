"""Workers that can close loops: who is there, so that a job can wait for another host."""

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine

from server.store.engine import insert, reading
from server.store.gauges import GONE_SECONDS
from server.store.schema import loop_workers, workers

#: Of a worker that asks in vain it is written down only so often (seconds) that it is there.
NOTED_SECONDS = GONE_SECONDS / 4.0


def is_noted(connection: Connection, worker: str, *, now: float) -> bool:
    """Say whether it was written down lately that a worker is there."""
    query = sa.select(loop_workers.c.last_seen).where(loop_workers.c.worker_id == worker)
    noted: float | None = connection.scalar(query)
    return noted is not None and noted <= now < noted + NOTED_SECONDS


def note(connection: Connection, worker: str, *, now: float) -> None:
    """Write down that a worker is there, which was introduced before."""
    statement = insert(connection, loop_workers).values(worker_id=worker, last_seen=now)
    connection.execute(
        statement.on_conflict_do_update(index_elements=["worker_id"], set_={"last_seen": now})
    )


def others_at_work(connection: Connection, *, host: str, now: float) -> bool:
    """Say whether a worker of another host could take a job now."""
    joined = loop_workers.join(workers, workers.c.id == loop_workers.c.worker_id)
    query = sa.select(sa.literal(1)).select_from(joined)
    query = query.where(loop_workers.c.last_seen > now - GONE_SECONDS, workers.c.host != host)
    return connection.scalar(query.limit(1)) is not None


def at_work(engine: Engine, *, now: float) -> int:
    """Return how many workers were heard from lately."""
    query = sa.select(sa.func.count()).where(loop_workers.c.last_seen > now - GONE_SECONDS)
    with reading(engine) as connection:
        return connection.scalar(query) or 0
