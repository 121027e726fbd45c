"""Statements that every request of a worker executes, without what SQLAlchemy does each time.

To look at a statement, its parameters, its rows and their types takes SQLAlchemy many times longer
than executing it takes SQLite. These are compiled once for each dialect; JSON goes in and
comes out as text, and rows are plain tuples.
"""

import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import sqlalchemy as sa
from pydantic_core import to_json
from sqlalchemy.engine import Connection, Dialect
from sqlalchemy.engine.default import DefaultDialect
from sqlalchemy.exc import DBAPIError
from sqlalchemy.sql.compiler import SQLCompiler

#: Rows of one INSERT: enough to gain by it, few enough to know a statement for each number of them.
ROWS = 20
#: How SQLite is given values: by number, each once however often it is used. Early versions of
#: Python 3.12 take numbers for names, and warn.
_SQLITE_STYLE = "qmark" if sys.version_info[:2] == (3, 12) else "numeric"
#: A parameter as SQLAlchemy numbers it.
_NUMBER = re.compile(r":(\d+)")


@dataclass(frozen=True, kw_only=True)
class _Compiled:
    """A statement in the SQL of one dialect."""

    text: str
    #: Puts the values of a tuple, which come in the order of `Prepared`, in their places.
    arrange: Callable[[tuple[Any, ...]], tuple[Any, ...]]


#: A statement as a driver takes it, and the values in their places.
Statement = tuple[str, Sequence[Any]]


class Prepared:
    """A statement to be executed often.

    Args:
        statement: what to do; of a column of JSON it selects the `text`.
        names: of its parameters, in the order in which values are given. Default: those that it
            binds, as they stand in the SQL: first those of SET, in the table's order.
        index: by which SQLite is to find what is selected from the one table. It keeps no
            statistics by itself, and may choose one that finds far too much.
    """

    def __init__(
        self,
        statement: sa.Insert | sa.Update | sa.Select[Any] | sa.CompoundSelect[Any],
        *names: str,
        index: str | None = None,
    ) -> None:
        self._statement = statement
        self._names = names
        self._index = index
        self._compiled: dict[str, _Compiled] = {}

    def execute(self, connection: Connection, *values: Any) -> Any:
        """Execute it once, within a transaction; return the driver's cursor.

        Raises:
            sqlalchemy.exc.DBAPIError: the database refuses.
        """
        known = self._in_sql_of(connection.dialect)
        arranged = known.arrange(values)
        driver: Any = connection.connection.dbapi_connection
        try:
            return driver.execute(known.text, arranged)
        except connection.dialect.loaded_dbapi.Error as error:
            raise failure(error, connection.dialect, known.text, arranged) from error

    def execute_many(self, connection: Connection, rows: Sequence[tuple[Any, ...]]) -> None:
        """Execute it with each of `rows`: values of the parameters in their order."""
        if not rows:
            return
        known = self._in_sql_of(connection.dialect)
        arranged = list(map(known.arrange, rows))
        driver: Any = connection.connection.dbapi_connection
        try:
            driver.cursor().executemany(known.text, arranged)
        except connection.dialect.loaded_dbapi.Error as error:
            raise failure(error, connection.dialect, known.text, arranged) from error

    def statement(self, dialect: Dialect, *values: Any) -> Statement:
        """Return it as the driver takes it, with the values in their places."""
        known = self._in_sql_of(dialect)
        return known.text, known.arrange(values)

    def _in_sql_of(self, dialect: Dialect) -> _Compiled:
        return self._compiled.get(dialect.name) or self._compile(dialect)

    def _compile(self, dialect: Dialect) -> _Compiled:
        by_place: Any = _SQLITE_STYLE if dialect.name == "sqlite" else "format"
        own: type[DefaultDialect] = type(dialect)  # type: ignore[assignment]
        writes = not isinstance(self._statement, sa.Select | sa.CompoundSelect)
        found = self._statement.compile(
            dialect=own(paramstyle=by_place), column_keys=self._names or None if writes else None
        )
        assert isinstance(found, SQLCompiler)
        places = found.positiontup or ()
        # The values of those that are always the same follow those that are given.
        given = self._names or dict.fromkeys(n for n in places if found.binds[n].required)
        constants = {name: found.params[name] for name in places if name not in given}
        every = (*given, *constants)
        sql = found.string
        if dialect.name == "sqlite":
            # Python takes `:1` for a name.
            sql = _NUMBER.sub(r"?\1", sql)
            if self._index is not None:
                sql = sql.replace("\nWHERE", f"INDEXED BY {self._index}\nWHERE", 1)
        compiled = self._compiled[dialect.name] = _Compiled(
            text=sql,
            arrange=_arranging(
                [every.index(name) for name in places], [*constants.values()], len(given)
            ),
        )
        return compiled


def text(column: sa.Column[Any]) -> sa.ColumnElement[str]:
    """Return a column of JSON as the text that is stored, to be selected under its own name."""
    return sa.cast(column, sa.Text).label(column.name)


def as_text(value: Any) -> str:
    """Return what a column of JSON is to store, in which nothing is infinite or no number.

    In a fifth of the time that Python's own encoder takes for small values; characters beyond ASCII
    are left as they are.
    """
    return to_json(value).decode()


def failure(error: Exception, dialect: Dialect, text: str, values: Sequence[Any]) -> Exception:
    """Return a driver's error as SQLAlchemy has it."""
    base = dialect.loaded_dbapi.Error
    return DBAPIError.instance(text, values, error, base, dialect=dialect)


def _arranging(
    places: Sequence[int], constants: Sequence[Any], count: int
) -> Callable[[tuple[Any, ...]], tuple[Any, ...]]:
    """Return what takes the values at `places` from a tuple of `count` and then `constants`."""
    if [*places] == [*range(count)]:
        return tuple
    if len(places) < 2:
        return lambda values: tuple((*values, *constants)[place] for place in places)
    pick = itemgetter(*places)
    if not constants:
        return pick
    return lambda values: pick((*values, *constants))
