"""A coordinator on a bad machine: `python bad_coordinator.py`.

SIGUSR1: its database's disk is full, until the next one. SIGUSR2: it is killed around its next
commit, the moment before or the moment after. CLOCK_OFFSET: seconds by which its clock is wrong.
"""

import os
import random
import signal
import time
from collections.abc import Sequence
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine

from server import app
from server.run import serve
from server.settings import Settings
from server.store.database.pipeline import Pipeline, Statement

#: What either database cannot do then, so that it says so in its own words.
TOO_MUCH = {
    "sqlite": "UPDATE alembic_version SET version_num = zeroblob(100000000)",
    "postgresql": """
        DO $$ BEGIN
            RAISE EXCEPTION 'could not extend file: No space left on device'
            USING ERRCODE = '53100';
        END $$
    """,
}


class BadMachine:
    """What goes wrong with the database of one process."""

    def __init__(self) -> None:
        self._full = False
        self._doomed = False
        signal.signal(signal.SIGUSR1, lambda *_: self._fill_or_free())
        signal.signal(signal.SIGUSR2, lambda *_: self._doom())

    def engine(self, url: str, **settings: Any) -> Engine:
        """Return an engine that suffers from it."""
        engine = SOUND(url, **settings)
        if engine.dialect.name == "sqlite":
            sa.event.listen(engine, "begin", self._free)
        sa.event.listen(engine, "commit", self._refuse)
        sa.event.listen(engine, "commit", self._die)
        return engine

    async def trip(self, pipeline: Pipeline, statements: Sequence[Statement]) -> list[Any]:
        """Do a turn's trip, which commits beside SQLAlchemy, and suffer."""
        if ("COMMIT", ()) in statements:
            if self._full:
                await TRIP(pipeline, [(TOO_MUCH["postgresql"], ())])
            if self._doomed:
                if random.random() < 0.5:
                    await TRIP(pipeline, statements)
                os.kill(os.getpid(), signal.SIGKILL)
        return await TRIP(pipeline, statements)

    def _fill_or_free(self) -> None:
        self._full = not self._full

    def _doom(self) -> None:
        self._doomed = True

    def _free(self, connection: Connection) -> None:
        driver: Any = connection.connection.dbapi_connection
        driver.execute(f"PRAGMA max_page_count = {2**30}")

    def _refuse(self, connection: Connection) -> None:
        if self._full and connection.get_execution_options().get("immediate"):
            if connection.dialect.name == "sqlite":
                # No fewer than there are, but no more either.
                connection.exec_driver_sql("PRAGMA max_page_count = 1")
            connection.exec_driver_sql(TOO_MUCH[connection.dialect.name])

    def _die(self, connection: Connection) -> None:
        if self._doomed and connection.get_execution_options().get("immediate"):
            if random.random() < 0.5:
                # It is in the database, and nobody will hear of it.
                connection.connection.commit()
            os.kill(os.getpid(), signal.SIGKILL)


SOUND = app.create_engine
TRIP = Pipeline.trip


def main() -> None:
    """Serve until something happens."""
    right, offset = time.time, float(os.environ.get("CLOCK_OFFSET", "0"))
    time.time = lambda: right() + offset  # type: ignore[assignment]
    machine = BadMachine()
    app.create_engine = machine.engine
    Pipeline.trip = lambda *of: machine.trip(*of)  # type: ignore[method-assign]
    serve(Settings())


if __name__ == "__main__":
    main()
