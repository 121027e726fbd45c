"""A database that fails between any two statements of the coordinator, when a test wants it to."""

import sqlite3
from typing import Any

import psycopg
import sqlalchemy as sa
from sqlalchemy.engine import Engine


class Faults:
    """When the database of an engine fails."""

    def __init__(self) -> None:
        self._left: int | None = None
        self._lasting = False
        #: Whether it has failed since it was armed.
        self.struck = False

    def arm(self, statements: int, *, lasting: bool) -> None:
        """Let so many more statements and commits pass, and fail at the next one.

        `lasting`: and at all after it, until `disarm`.
        """
        self._left, self._lasting, self.struck = statements, lasting, False

    def disarm(self) -> None:
        """Let everything pass again."""
        self._left = None

    def due(self) -> bool:
        """Say whether the statement that is about to be executed fails."""
        if self._left is None:
            return False
        if self._left > 0:
            self._left -= 1
            return False
        if not self._lasting:
            self._left = None
        self.struck = True
        return True

    def watch(self, engine: Engine) -> None:
        """Have all connections fail that an engine opens from now on."""
        engine.dispose()
        connect = _sqlite if engine.dialect.name == "sqlite" else _postgresql
        kind = connect(self)

        @sa.event.listens_for(engine, "do_connect")
        def _connect(_dialect: Any, _record: Any, given: Any, named: Any) -> Any:
            return kind(*given, **named)


def _sqlite(faults: Faults) -> Any:
    def strike() -> None:
        if faults.due():
            raise sqlite3.OperationalError("disk I/O error")

    class Cursor(sqlite3.Cursor):
        def execute(self, *given: Any) -> Any:
            strike()
            return super().execute(*given)

        def executemany(self, *given: Any) -> Any:
            strike()
            return super().executemany(*given)

    class Connected(sqlite3.Connection):
        def cursor(self, factory: Any = Cursor) -> Any:
            return super().cursor(factory)

        def execute(self, *given: Any) -> Any:
            strike()
            return super().execute(*given)

        def commit(self) -> None:
            strike()
            super().commit()

    return lambda *given, **named: sqlite3.connect(*given, **named, factory=Connected)


def _postgresql(faults: Faults) -> Any:
    def strike(connection: Any) -> None:
        if faults.due():
            # As when the server goes away: whatever was open there is rolled back.
            connection.close()
            raise psycopg.OperationalError("the connection is lost")

    class Cursor(psycopg.Cursor[Any]):
        def execute(self, *given: Any, **named: Any) -> Any:
            strike(self.connection)
            return super().execute(*given, **named)

        def executemany(self, *given: Any, **named: Any) -> None:
            strike(self.connection)
            super().executemany(*given, **named)

    class Connected(psycopg.Connection[Any]):
        def commit(self) -> None:
            strike(self)
            super().commit()

    return lambda *given, **named: Connected.connect(*given, **named, cursor_factory=Cursor)
