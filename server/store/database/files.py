"""The files of SQLite databases, in which measured sessions of people are."""

import os
import sqlite3
import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

#: Seconds a transaction waits for another process to finish writing.
BUSY_SECONDS = 30
#: Pages (of 4 kB) of SQLite's write-ahead log. With its own 1000 a busy coordinator would wait for
#: the disk every hundredth transaction.
LOG_PAGES = 10_000
#: How its files begin.
_MAGIC = b"SQLite format 3\0"
#: Where Alembic keeps which schema it is, as it does for others.
_VERSION = "alembic_version"
#: Tables that every schema of rehyb has. Others have studies, too: Optuna, with a version beside.
_OURS = {_VERSION, "studies", "instances", "leases"}
#: Tables or views of somebody else's that are named.
_NAMED = 5


def make_private(path: Path) -> None:
    """Make a file that only its owner may read, unless it is there; SQLite's log is as its file.

    What keeps it from being made is said by whoever opens it then.
    """
    # One that is there is not even opened: to close it again would end SQLite's locks on it.
    with suppress(OSError):
        os.close(os.open(os.path.realpath(path), os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600))


def is_sqlite(path: Path) -> bool:
    """Whether a file says at its beginning that it is of SQLite, whole or not."""
    try:
        with path.open("rb") as file:
            return file.read(len(_MAGIC)) == _MAGIC
    except OSError:
        return False


class OpenedFile:
    """Notices that a database's file is no longer at its path, where the next start looks for it.

    SQLite goes on writing to a file that was moved or removed, and as this process ends all that
    is written there meanwhile is lost.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._opened: tuple[int, int] | None = None

    def make_ready(self) -> None:
        """Make a file that is not there yet; one that is gone is not to be replaced."""
        if self._opened is None:
            make_private(self._path)
        else:
            self.require_there()

    def note(self) -> None:
        """Note which file it is, once it is open."""
        if self._opened is None:
            self._opened = self._there()

    def require_there(self) -> None:
        """Raise sqlite3.OperationalError, as SQLite has it, if the file is not at its path."""
        if self._opened is None or self._there() == self._opened:
            return
        error = sqlite3.OperationalError(
            "its file was moved, removed or replaced since it was opened: put it back, or start "
            "again to use what is there now"
        )
        error.sqlite_errorcode = sqlite3.SQLITE_READONLY_DBMOVED
        raise error

    def _there(self) -> tuple[int, int] | None:
        try:
            found = self._path.stat()
        except OSError:
            return None
        return found.st_dev, found.st_ino


def open_sqlite(connection: Any, _record: Any) -> None:
    """Set up one SQLite connection."""
    # sqlite3 would open transactions by rules of its own; `engine` does it instead.
    connection.isolation_level = None
    connection.execute(f"PRAGMA busy_timeout = {BUSY_SECONDS * 1000}")
    # WAL stays with a file for good: one of somebody else's is left as it is.
    if not of_another_in_sqlite(connection):
        use_write_ahead_log(connection)
    # Losing power may lose the last commits, never consistency: their instances are leased again.
    connection.execute("PRAGMA synchronous = NORMAL")
    # The log is copied into the file, and the disk waited for, when it has so many pages.
    connection.execute(f"PRAGMA wal_autocheckpoint = {LOG_PAGES}")
    connection.execute("PRAGMA foreign_keys = ON")


def of_another(
    tables: Iterable[str], views: Iterable[str], numbers: Mapping[str, int] | None = None
) -> str:
    """Return in words what shows that a database is somebody else's; none if it is ours or empty.

    Args:
        tables: their names.
        views: theirs.
        numbers: by name, what a program may have put in a file's header; 0 if none has.
    """
    there = set(tables)
    if there >= _OURS:
        return ""
    for kind, names in (("tables", there - {_VERSION} or there), ("views", set(views))):
        if names:
            some = [*sorted(names)[:_NAMED], *["..."] * (len(names) > _NAMED)]
            return f"it holds other {kind} ({', '.join(some)})"
    for name, number in (numbers or {}).items():
        if number:
            return f"another program has put its number in it ({name} {number})"
    return ""


def of_another_in_sqlite(connection: Any) -> str:
    """Return `of_another` of what one SQLite connection has open."""
    listed = "SELECT type, name FROM sqlite_master WHERE name NOT LIKE 'sqlite_%'"
    found = connection.execute(listed).fetchall()
    marks = ("application_id", "user_version")
    return of_another(
        [name for kind, name in found if kind == "table"],
        [name for kind, name in found if kind == "view"],
        {mark: connection.execute(f"PRAGMA {mark}").fetchone()[0] for mark in marks},
    )


def use_write_ahead_log(connection: Any) -> None:
    """Switch to WAL; when several processes open a new file at once, SQLite does not wait here."""
    deadline = time.monotonic() + BUSY_SECONDS
    while True:
        try:
            connection.execute("PRAGMA journal_mode = WAL")
            return
        except sqlite3.OperationalError as error:
            if "locked" not in str(error) or time.monotonic() > deadline:
                raise
            time.sleep(0.02)
