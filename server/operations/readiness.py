"""Could a worker be served? Found out by writing, and by how the last ones fared."""

import asyncio
import sqlite3
from concurrent.futures import Future, ThreadPoolExecutor
from math import inf
from time import monotonic

from sqlalchemy.engine import Engine
from sqlalchemy.exc import SQLAlchemyError

from server.errors import SchemaError
from server.store import require_current
from server.store.audit import what_is_locked, write_nothing_new
from server.store.database.engine import writing

#: Seconds for which it is enough to have written once: strangers may ask.
GOOD_SECONDS = 1.0
#: Seconds after which what failed a worker says nothing any more; workers ask far more often.
FAILED_SECONDS = 60.0
#: Seconds that a look may take: whoever asks waits no longer, and takes silence for a no.
LOOK_SECONDS = 2.0


class Readiness:
    """What keeps a coordinator from serving workers.

    Args:
        engine: its database.
        look_seconds: that a look may take.
    """

    def __init__(self, engine: Engine, look_seconds: float = LOOK_SECONDS) -> None:
        self._engine = engine
        self._look_seconds = look_seconds
        # Of its own: while all requests hang, so do the threads that they have.
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="readiness")
        self._look: Future[str | None] | None = None
        self._written = -inf
        #: What failed last, and when, by what was asked for.
        self._failed: dict[str, tuple[float, str]] = {}

    def served(self, *what: str) -> None:
        """Note that a worker was given what it asked for."""
        for one in what:
            self._failed.pop(one, None)

    def failed(self, what: str, error: Exception) -> None:
        """Note that the database failed a worker that asked for something."""
        self._failed[what] = (monotonic(), f"the last {what} failed: {_said(error)}")

    async def objection(self) -> str | None:
        """Say why a worker could not be served now; None if it could."""
        for failed_at, said in [*self._failed.values()]:
            if monotonic() < failed_at + FAILED_SECONDS:
                return said
        # However many ask, one looks.
        if self._look is None or self._look.done():
            self._look = self._thread.submit(self._objection)
        look = asyncio.wrap_future(self._look)
        # Not cancelled when it is late: the next who asks may hear of it.
        done, _ = await asyncio.wait([look], timeout=self._look_seconds)
        return look.result() if done else f"it did not answer within {self._look_seconds:g} s"

    def close(self) -> None:
        """Look no more."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    def _objection(self) -> str | None:
        try:
            require_current(self._engine)
            if monotonic() < self._written + GOOD_SECONDS:
                return None
            with writing(self._engine) as connection:
                locked = what_is_locked(connection)
                if locked is None:
                    write_nothing_new(connection)
        except (SchemaError, SQLAlchemyError, sqlite3.Error) as error:
            return _said(error)
        if locked is None:
            self._written = monotonic()
        return locked


def _said(error: Exception) -> str:
    return str(getattr(error, "orig", None) or error).splitlines()[0]
