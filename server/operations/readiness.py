"""Could a lease be served? Found out by writing, and by how the last one went."""

import sqlite3
import threading
from math import inf
from time import monotonic

from sqlalchemy.engine import Engine
from sqlalchemy.exc import SQLAlchemyError

from server.errors import SchemaError
from server.store import require_current
from server.store.audit import write_nothing_new
from server.store.database.engine import writing

#: Seconds for which it is enough to have written once: strangers may ask.
GOOD_SECONDS = 1.0
#: Seconds after which a lease that failed says nothing any more; workers ask far more often.
FAILED_SECONDS = 60.0


class Readiness:
    """What keeps a coordinator from serving leases."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._lock = threading.Lock()
        self._written = -inf
        self._failed: tuple[float, str] | None = None

    def served(self) -> None:
        """Note that a worker was answered."""
        self._failed = None

    def failed(self, error: Exception) -> None:
        """Note that the database failed a worker that asked for a lease."""
        self._failed = (monotonic(), f"the last lease failed: {_said(error)}")

    def objection(self) -> str | None:
        """Say why a lease could not be served now; None if it could."""
        if self._failed is not None and monotonic() < self._failed[0] + FAILED_SECONDS:
            return self._failed[1]
        try:
            require_current(self._engine)
            with self._lock:
                if monotonic() >= self._written + GOOD_SECONDS:
                    with writing(self._engine) as connection:
                        write_nothing_new(connection)
                    self._written = monotonic()
        except (SchemaError, SQLAlchemyError, sqlite3.Error) as error:
            return _said(error)
        return None


def _said(error: Exception) -> str:
    return str(getattr(error, "orig", None) or error).splitlines()[0]
