"""Connections and transactions, on SQLite and on PostgreSQL."""

import hashlib
import json
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from functools import wraps
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.engine import Connection, Engine
from sqlalchemy.exc import ArgumentError

from server.errors import BadSettingError
from server.store.database.files import OpenedFile, open_sqlite
from server.store.database.prepared import failure
from server.store.database.presence import Presence

P = ParamSpec("P")
T = TypeVar("T")

#: Of databases, as SQLAlchemy's URLs call them.
KINDS = ("sqlite", "postgresql+psycopg")
#: Options of libpq that are whole numbers.
_WHOLE_NUMBERS = {
    "connect_timeout",
    "keepalives",
    "keepalives_idle",
    "keepalives_interval",
    "keepalives_count",
    "tcp_user_timeout",
}
#: Writes what goes into columns of JSON: `json.dumps` would make a new encoder for every value.
JSON = json.JSONEncoder(allow_nan=False, separators=(",", ":"))
#: Seconds that a request waits for a row that another one changes, or for SQLite's file: a worker
#: waits 30 s for an answer, and hears so before.
LOCK_SECONDS = 20
_IMMEDIATELY = "BEGIN IMMEDIATE"


def create_engine(
    url: str, *, durability: str = "normal", presence: Presence | None = None
) -> Engine:
    """Return an engine whose transactions are opened with `reading` and `writing` only.

    Args:
        url: sqlite:///FILE or postgresql+psycopg://...; the file need not exist yet.
        durability: "full": a commit waits until the disk has it. SQLite does not by itself;
            PostgreSQL does unless its `synchronous_commit` is off.
        presence: is told how transactions end; with one, requests wait for them, and none waits
            for a lock for longer than `LOCK_SECONDS`.

    Raises:
        BadSettingError: there is no such kind of database, or the URL is none, names no file, or
            has options that no such database takes.
    """
    found = of_known_kind(url)
    file = OpenedFile(Path(str(found.database))) if found.drivername == "sqlite" else None
    engine = sa.create_engine(
        found,
        json_serializer=JSON.encode,
        execution_options={"writer": threading.Lock(), "presence": presence, "file": file},
        pool_size=10,
        max_overflow=40,
        # The connection that wrote last knows the pages that the next one will want.
        pool_use_lifo=True,
        # One that was cut while nobody used it is no reason to fail a request. The connections of
        # the turns stay out of the pool, and SQLite's are not cut.
        pool_pre_ping=not url.startswith("sqlite"),
    )
    if engine.dialect.name == "postgresql":
        _check_server(engine)
    _close_what_comes_back_late(engine)
    if file is not None:
        sa.event.listen(engine, "do_connect", lambda *_: file.make_ready())
        sa.event.listen(engine, "connect", open_sqlite)
        sa.event.listen(engine, "connect", lambda *_: file.note())
        if durability == "full":
            sa.event.listen(
                engine, "connect", lambda driver, _: driver.execute("PRAGMA synchronous = FULL")
            )
    else:
        sa.event.listen(engine, "do_connect", _connect_watched)
        if durability == "full":
            sa.event.listen(engine, "connect", _wait_for_the_disk)
        if presence is not None:
            sa.event.listen(engine, "connect", _wait_for_no_lock_in_vain)
    return engine


def of_known_kind(url: str) -> sa.URL:
    """Return the URL of a database that a coordinator can have; BadSettingError if it is none."""
    with suppress(ArgumentError, ValueError):
        found = sa.make_url(url)
        if found.drivername == "sqlite":
            return _of_a_file(found)
        if found.drivername in KINDS:
            return found
    kind = url.partition("://")[0]
    raise BadSettingError(
        "the database's URL must be sqlite:///FILE or postgresql+psycopg://USER@HOST:PORT/NAME; "
        f"the one that begins with {kind[:40]!r} cannot be used"
    )


def _of_a_file(url: sa.URL) -> sa.URL:
    """Return a URL of SQLite that names a file; one in memory would be gone with its connection."""
    # What follows two slashes is a host.
    if url.host is not None or url.database in (None, "", ":memory:"):
        raise BadSettingError(
            "the database's URL names no file: sqlite:///FILE has three slashes, and a fourth "
            "before a path from the root"
        )
    if url.query:
        raise BadSettingError(
            f"sqlite:///FILE takes no options: leave out ?{next(iter(url.query))}"
        )
    return url


def _check_server(engine: Engine) -> None:
    """Raise BadSettingError unless a URL's options are libpq's: a wrong one looks like no answer.

    libpq finds out only when it connects, and then nobody could tell it from a server that is away.
    """
    from psycopg import ProgrammingError
    from psycopg.conninfo import make_conninfo

    _, given = engine.dialect.create_connect_args(engine.url)
    options = {name: str(value) for name, value in given.items() if name != "context"}
    try:
        make_conninfo(**options)
    except ProgrammingError as error:
        raise BadSettingError(f"the database's URL: {str(error).strip()}") from None
    for name in _WHOLE_NUMBERS & options.keys():
        # Below zero, a time has no end.
        if not _is_whole(options[name].removeprefix("-")):
            raise BadSettingError(
                f"the database's URL: {name} is a whole number, not {options[name]!r}"
            )
    for port in options.get("port", "").split(","):
        if port and not (_is_whole(port) and 0 < int(port) < 65536):
            raise BadSettingError(f"the database's URL: a port is 1 to 65535, not {port!r}")


def _is_whole(text: str) -> bool:
    return text.isascii() and text.isdigit()


@contextmanager
def reading(engine: Engine) -> Iterator[Connection]:
    """Open a transaction that sees one consistent state and writes nothing."""
    with noted(engine), engine.connect() as connection:
        if connection.dialect.name == "postgresql":
            connection = connection.execution_options(isolation_level="REPEATABLE READ")
        with connection.begin():
            _begin(connection, "BEGIN")
            yield connection


@contextmanager
def writing(engine: Engine) -> Iterator[Connection]:
    """Open a transaction that may write; it is committed unless an exception leaves the block.

    SQLite has one writer at a time. The threads of this process queue on a lock, which wakes the
    next one at once; SQLite's own busy handler sleeps and polls, and is left for other processes.
    """
    with _queued(engine) as until, noted(engine), engine.connect() as connection:
        connection = connection.execution_options(immediate=True)
        with connection.begin():
            # It takes the write lock now and need never start again.
            try:
                _begin(connection, _IMMEDIATELY, until)
            except sqlite3.Error as error:
                raise failure(error, connection.dialect, _IMMEDIATELY, ()) from error
            yield connection
            _require_there(engine)


def _require_there(engine: Engine) -> None:
    """Raise an error before what is to be committed would go to a file that nobody finds again."""
    file: OpenedFile | None = engine.get_execution_options()["file"]
    if file is not None:
        try:
            file.require_there()
        except sqlite3.Error as error:
            raise failure(error, engine.dialect, "COMMIT", ()) from error


@contextmanager
def _queued(engine: Engine) -> Iterator[float | None]:
    """Keep other threads from writing to SQLite; yields until when another process is waited for.

    That is one time to wait for both: the thread before may have waited for the other process, too.
    None: as long as the connection says.
    """
    if engine.dialect.name != "sqlite":
        yield None
        return
    options = engine.get_execution_options()
    lock: threading.Lock = options["writer"]
    seconds = -1 if options["presence"] is None else LOCK_SECONDS
    until = time.monotonic() + seconds
    if not lock.acquire(timeout=seconds):
        late = sqlite3.OperationalError("database is locked")
        late.sqlite_errorcode = sqlite3.SQLITE_BUSY
        raise failure(late, engine.dialect, _IMMEDIATELY, ())
    try:
        yield None if seconds < 0 else until
    finally:
        lock.release()


def noted(engine: Engine) -> AbstractContextManager[None]:
    """Return a context whose end is told to whom the engine was made to tell, if to anybody."""
    presence: Presence | None = engine.get_execution_options()["presence"]
    return nullcontext() if presence is None else presence.noting(engine.dispose)


@contextmanager
def alone_at(engine: Engine, what: str) -> Iterator[bool]:
    """Yield whether this is the only one of several processes to do something until the block ends.

    On PostgreSQL several coordinators and analyses may be at work: an advisory lock decides, which
    goes with the connection of whoever dies. SQLite has one coordinator, and each may do all.
    """
    if engine.dialect.name == "sqlite":
        yield True
        return
    key = {"key": int.from_bytes(hashlib.blake2b(what.encode(), digest_size=7).digest(), "big")}
    with engine.connect().execution_options(isolation_level="AUTOCOMMIT") as connection:
        mine = bool(connection.scalar(sa.text("SELECT pg_try_advisory_lock(:key)"), key))
        try:
            yield mine
        finally:
            if mine:
                connection.execute(sa.text("SELECT pg_advisory_unlock(:key)"), key)


def server_time(engine: Engine) -> float:
    """Return what time it is by the database server, seconds UTC; this machine's on SQLite."""
    if engine.dialect.name == "sqlite":
        return time.time()
    with reading(engine) as connection:
        found = connection.scalar(sa.text("SELECT extract(epoch FROM clock_timestamp())"))
    return float(found)


def alone_reading(
    read: Callable[Concatenate[Connection, P], T],
) -> Callable[Concatenate[Engine, P], T]:
    """Return what does `read` in a transaction of its own."""

    @wraps(read)
    def alone(engine: Engine, /, *given: P.args, **named: P.kwargs) -> T:
        with reading(engine) as connection:
            return read(connection, *given, **named)

    return alone


class ImmediateWriter:
    """Opens transactions as `writing` does, but waits for nobody and nothing; for one thread.

    It keeps a connection of its own: to take one from the pool and put it back costs as much as a
    short transaction. Its commits leave SQLite's log to others, since to copy it into the file is
    to wait for the disk.
    """

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._connection: Connection | None = None

    @contextmanager
    def __call__(self) -> Iterator[Connection]:
        """Open a transaction; it is committed unless an exception leaves the block.

        Raises:
            BlockingIOError: another thread of this process writes.
            sqlite3.OperationalError: another process does.
        """
        lock: threading.Lock = self._engine.get_execution_options()["writer"]
        if not lock.acquire(blocking=False):
            raise BlockingIOError("another thread writes")
        try:
            connection = self._connected()
            with connection.begin():
                _begin(connection, _IMMEDIATELY)
                yield connection
                _require_there(self._engine)
        except BaseException:
            # A transaction whose commit failed would still be open.
            self.close()
            raise
        finally:
            lock.release()

    def close(self) -> None:
        """Close its connection."""
        if self._connection is not None:
            # Not to the pool: it is not what others expect.
            self._connection.invalidate()
            self._connection.close()
            self._connection = None

    def _connected(self) -> Connection:
        if self._connection is None:
            self._connection = self._engine.connect().execution_options(immediate=True)
            driver: Any = self._connection.connection.dbapi_connection
            driver.execute("PRAGMA busy_timeout = 0")
            driver.execute("PRAGMA wal_autocheckpoint = 0")
        return self._connection


def insert(connection: Connection, table: sa.Table) -> postgresql.Insert | sqlite.Insert:
    """Return an INSERT that has `on_conflict_do_nothing` and `on_conflict_do_update`."""
    if connection.dialect.name == "sqlite":
        return sqlite.insert(table)
    return postgresql.insert(table)


def _close_what_comes_back_late(engine: Engine) -> None:
    """Close each connection that comes back after the pool that it is of was given up.

    `Engine.dispose` closes those that nobody uses. Others went back to a pool that nobody knows
    any more, and stayed open until it was found among the garbage.
    """

    def note(_driver: Any, record: Any) -> None:
        record.info["pool"] = engine.pool

    def look(_driver: Any, record: Any) -> None:
        if record.info.get("pool") is not engine.pool:
            record.close()

    sa.event.listen(engine, "connect", note)
    sa.event.listen(engine, "checkin", look)


def _connect_watched(
    _dialect: Any, _record: Any, given: Sequence[Any], named: Mapping[str, Any]
) -> Any:
    """Open a PostgreSQL connection on which nobody waits for ever; what the URL says goes first."""
    # Its driver is there only where PostgreSQL is used.
    from server.store.database.silence import connect

    return connect(*given, **named)


def _wait_for_no_lock_in_vain(connection: Any, _record: Any) -> None:
    connection.execute(f"SET lock_timeout = '{LOCK_SECONDS}s'")
    connection.commit()


def _wait_for_the_disk(connection: Any, _record: Any) -> None:
    """Have one PostgreSQL connection's commits wait, unless they wait for more than that."""
    connection.execute(
        "SELECT set_config('synchronous_commit', 'on', false) "
        "WHERE current_setting('synchronous_commit') = 'off'"
    )
    connection.commit()


def _begin(connection: Connection, command: str, until: float | None = None) -> None:
    """Begin a transaction on SQLite; PostgreSQL's driver does so by itself.

    No listener to SQLAlchemy's own event, since with one every statement looks for listeners; and
    straight to the driver, since what SQLAlchemy does besides costs ten times as much.
    """
    if connection.dialect.name == "sqlite":
        raw: Any = connection.connection.dbapi_connection
        if until is not None:
            left = max(int((until - time.monotonic()) * 1000), 0)
            raw.execute(f"PRAGMA busy_timeout = {left}")
        raw.execute(command)
