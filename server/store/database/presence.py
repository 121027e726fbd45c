"""Is the database there? Told apart from other failures, waited for, and said once."""

import logging
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from math import inf

from sqlalchemy.engine import Engine
from sqlalchemy.exc import DBAPIError, InterfaceError, OperationalError, SQLAlchemyError
from sqlalchemy.exc import TimeoutError as NoConnectionError

from analysis.sensitivity.service import patiently
from server.errors import DatabaseAwayError

log = logging.getLogger(__name__)

#: Seconds a server may take to say that it is there.
PING_SECONDS = 5
#: Seconds without a failure after which one that comes and goes is back.
CALM_SECONDS = 60.0

#: PostgreSQL's codes of a lock that was not had in time, and of a server that takes no writes, as a
#: standby that is not promoted yet (its documentation, appendix A).
_LOCK_TIMEOUT, _READ_ONLY = "55P03", "25006"
#: Kinds of SQLite's errors that pass without another request: disk full or failing, file in use.
_PASSING = frozenset({sqlite3.SQLITE_BUSY, sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR})


def is_away(error: DBAPIError) -> bool:
    """Say whether a request failed because the database is away, full or overrun.

    SQLite is a file: what counts is that its disk is full or fails, that another process has it, or
    that it is not where it was.
    """
    if isinstance(error.orig, sqlite3.Error):
        code = getattr(error.orig, "sqlite_errorcode", 0)
        # The low byte is the kind, the others say more (sqlite.org/rescode.html).
        return code & 0xFF in _PASSING or code == sqlite3.SQLITE_READONLY_DBMOVED
    return isinstance(error, OperationalError | InterfaceError) or takes_no_writes(error)


def takes_no_writes(error: Exception) -> bool:
    """Say whether a request failed since the server only reads, as it may while another takes over.

    So does what is connected to it until it is connected anew.
    """
    return isinstance(error, DBAPIError) and _code_of(error) == _READ_ONLY


def why_away(error: Exception) -> str | None:
    """Return in a sentence why the database is away, or the connection lost; None: it is not.

    A connection that its server cuts for its own reasons fails in ways of its own.
    """
    if isinstance(error, DBAPIError) and (error.connection_invalidated or is_away(error)):
        return str(error.orig).partition("\n")[0]
    if isinstance(error, NoConnectionError):
        return "all connections are in use"
    return None


def waited_for_lock(error: Exception) -> bool:
    """Say whether a request gave up since another one keeps what it needs."""
    return isinstance(error, DBAPIError) and _code_of(error) == _LOCK_TIMEOUT


def is_busy(error: Exception) -> bool:
    """Say whether a request gave up since another one writes to SQLite's file."""
    code: int = getattr(getattr(error, "orig", None), "sqlite_errorcode", 0)
    return code & 0xFF == sqlite3.SQLITE_BUSY


def _code_of(error: DBAPIError) -> str | None:
    return getattr(error.orig, "sqlstate", None)


def is_silent(error: Exception) -> bool:
    """Say whether a request failed after its server was silent for long, as the next one would."""
    return isinstance(error, DBAPIError) and getattr(error.orig, "is_silent", False)


def require_answer(engine: Engine) -> None:
    """Raise DatabaseAwayError if no server is there, or it takes nobody yet or any more.

    The driver's errors tell that from a wrong password in words only, of the server's language. One
    that answers may still refuse, which goes on until somebody changes something.
    """
    if engine.dialect.name == "sqlite":
        return
    from psycopg import pq
    from psycopg.conninfo import make_conninfo

    _, named = engine.dialect.create_connect_args(engine.url)
    named.pop("context", None)
    # Signals are heard between two of them.
    asked = make_conninfo(**{"connect_timeout": PING_SECONDS, **named})
    answer = pq.PGconn.ping(asked.encode())
    if answer == pq.Ping.NO_RESPONSE:
        raise DatabaseAwayError("its server does not answer")
    if answer == pq.Ping.REJECT:
        raise DatabaseAwayError("its server starts up or shuts down")


def once_there(engine: Engine, act: Callable[[], object], *, stop: threading.Event) -> None:
    """Do something as soon as a server is there, which may refuse us for good then.

    That it is waited for is logged, and when it is there; nothing is done if `stop` is set before.
    One that goes in the midst is waited for again, and all is done anew.

    Raises:
        SQLAlchemyError: the server is there and refuses.
    """

    def look() -> bool:
        require_answer(engine)
        try:
            act()
        except SQLAlchemyError as error:
            require_answer(engine)
            if takes_no_writes(error):
                engine.dispose()
                raise DatabaseAwayError("its server takes no writes") from error
            if engine.dialect.name == "sqlite":
                # A full disk, as a rule, on which the coordinator was started again.
                if (why := why_away(error)) is not None:
                    raise DatabaseAwayError(why) from error
                raise
            # It went meanwhile, and is back; or it is there and refuses, as it does again then.
            _again(act, error)
        return True

    def said(error: Exception) -> str | None:
        return str(error) if isinstance(error, DatabaseAwayError) else None

    presence: Presence | None = engine.get_execution_options()["presence"]
    with nullcontext() if presence is None else presence.left_to_others():
        patiently(look, stop=stop, why_away=said)


def _again(act: Callable[[], object], first: SQLAlchemyError) -> None:
    """Do what has failed once more; DatabaseAwayError if the connection gets lost again."""
    try:
        act()
    except DBAPIError as error:
        if error.connection_invalidated:
            raise DatabaseAwayError(f"the connection is lost: {why_away(error)}") from first
        raise


class Presence:
    """Says in the log, once each, when the database goes and when it is back.

    One that goes again within a minute comes and goes, as a full disk does that still is read from:
    from then on it is back only after a minute without a failure. What else fails meanwhile because
    of that need not say so again: `is_told`.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._lock = threading.Lock()
        self._clock = clock
        self._away = self._silent = self._unsteady = False
        #: When it failed last, and was said to be back.
        self._failed_at = self._back_at = -inf

    @contextmanager
    def left_to_others(self) -> Iterator[None]:
        """Say nothing in the block, in which somebody else waits for the database and says so."""
        self._silent = True
        try:
            yield
        finally:
            self._silent = self._away = False

    @contextmanager
    def noting(self, renew: Callable[[], object]) -> Iterator[None]:
        """Take note of how the transaction in the block ends.

        `renew`: has the next one connected anew; called if this one met a server that only reads.
        """
        try:
            yield
        except Exception as error:
            if takes_no_writes(error):
                renew()
            if waited_for_lock(error):
                log.warning("a request waited in vain for what another one keeps locked")
            elif (why := why_away(error)) is not None:
                self._goes(why)
            raise
        if self._away:
            self._answers()

    def _goes(self, why: str) -> None:
        with self._lock:
            self._failed_at = self._clock()
            new, self._away = not self._away, True
            if new:
                self._unsteady = self._failed_at < self._back_at + CALM_SECONDS
        if new and not self._silent:
            log.warning("the database is away or full, and who asks is told to wait: %s", why)

    def _answers(self) -> None:
        with self._lock:
            now = self._clock()
            back = self._away and (not self._unsteady or now >= self._failed_at + CALM_SECONDS)
            if back:
                self._away, self._back_at = False, now
        if back and not self._silent:
            log.warning("the database is back")


def is_told(error: BaseException | None) -> bool:
    """Say whether an error is nothing but that the database is away, which `Presence` tells."""
    while error is not None:
        if isinstance(error, Exception) and why_away(error) is not None:
            return True
        error = error.__cause__ or error.__context__
    return False
