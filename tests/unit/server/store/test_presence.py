"""What the log says of a database that goes, is back, or comes and goes."""

import sqlite3
import threading
from pathlib import Path

import pytest
from sqlalchemy.exc import OperationalError

from server.store.database.engine import create_engine
from server.store.database.presence import CALM_SECONDS, Presence, once_there

AWAY = "the database is away or full, and who asks is told to wait: database or disk is full"
BACK = "the database is back"


class Database:
    """A database at a time of its own, in which transactions end well or not."""

    def __init__(self) -> None:
        self.now = 1000.0
        self.presence = Presence(clock=lambda: self.now)

    def is_asked(self, *, full: bool = False) -> None:
        """Have one transaction end, a second later."""
        self.now += 1.0
        with self.presence.noting(lambda: None):
            if full:
                raise _disk_full()

    def fails(self) -> None:
        """Have one transaction find the disk full, a second later."""
        with pytest.raises(OperationalError):
            self.is_asked(full=True)


def _disk_full() -> OperationalError:
    error = sqlite3.OperationalError("database or disk is full")
    error.sqlite_errorcode = sqlite3.SQLITE_FULL
    return OperationalError("INSERT", {}, error)


def test_one_that_goes_is_said_to_go_once_and_to_be_back_at_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    database = Database()
    for _ in range(3):
        database.fails()
    for _ in range(3):
        database.is_asked()
    assert caplog.messages == [AWAY, BACK]


def test_a_full_disk_that_is_read_from_is_back_only_after_a_minute_without_a_failure(
    caplog: pytest.LogCaptureFixture,
) -> None:
    database = Database()
    for _ in range(100):
        database.fails()
        database.is_asked()
    assert caplog.messages == [AWAY, BACK, AWAY]
    for _ in range(int(CALM_SECONDS) - 2):
        database.is_asked()
    assert len(caplog.messages) == 3
    database.is_asked()
    assert caplog.messages[3:] == [BACK]


def test_one_that_goes_again_after_a_minute_is_a_new_story(
    caplog: pytest.LogCaptureFixture,
) -> None:
    database = Database()
    for _ in range(2):
        database.fails()
        database.is_asked()
        database.now += CALM_SECONDS
    assert caplog.messages == [AWAY, BACK] * 2


def test_nothing_is_said_while_somebody_else_waits_and_says_so(
    caplog: pytest.LogCaptureFixture,
) -> None:
    database = Database()
    with database.presence.left_to_others():
        database.fails()
    database.is_asked()
    assert caplog.messages == []
    database.fails()
    assert caplog.messages == [AWAY]


def test_who_starts_on_a_full_disk_waits_until_there_is_room(tmp_path: Path) -> None:
    tries = []

    def start() -> None:
        tries.append(None)
        if len(tries) < 2:
            raise _disk_full()

    once_there(create_engine(f"sqlite:///{tmp_path}/d.sqlite3"), start, stop=threading.Event())
    assert len(tries) == 2


def test_who_starts_on_a_file_that_is_no_database_does_not_wait(tmp_path: Path) -> None:
    def start() -> None:
        error = sqlite3.DatabaseError("file is not a database")
        error.sqlite_errorcode = sqlite3.SQLITE_NOTADB
        raise OperationalError("PRAGMA", {}, error)

    with pytest.raises(OperationalError, match="not a database"):
        once_there(create_engine(f"sqlite:///{tmp_path}/d.sqlite3"), start, stop=threading.Event())
