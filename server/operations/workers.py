"""Who works for this coordinator."""

from sqlalchemy.engine import Engine

from server.records import Worker
from server.store import workers
from server.store.database.engine import reading


def every(engine: Engine) -> list[Worker]:
    """Return all workers ever seen, the latest first."""
    with reading(engine) as connection:
        return workers.every(connection)
