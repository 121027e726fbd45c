"""Statements that every request of a worker executes, without what SQLAlchemy does each time.

To look at a statement, its parameters and their types takes SQLAlchemy longer than executing it
takes SQLite. These are compiled once for each kind of database, and JSON goes in as text.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Dialect
from sqlalchemy.engine.default import DefaultDialect
from sqlalchemy.exc import DBAPIError
from sqlalchemy.sql.compiler import SQLCompiler


@dataclass(frozen=True, kw_only=True)
class _Compiled:
    """A statement in the words of one kind of database."""

    text: str
    #: Its parameters in the order of their places in the text.
    names: tuple[str, ...]
    #: The values of those that are always the same.
    constants: Mapping[str, Any]
    #: Puts the values of a tuple, which come in the order of `Prepared`, in their places.
    arrange: Callable[[tuple[Any, ...]], tuple[Any, ...]]


class Prepared:
    """A statement that writes, to be executed often.

    Args:
        statement: what to do.
        names: of its parameters.
    """

    def __init__(self, statement: sa.Insert | sa.Update, names: Sequence[str]) -> None:
        self._statement = statement
        self._names = tuple(names)
        self._compiled: dict[str, _Compiled] = {}

    def execute(self, connection: Connection, values: Mapping[str, Any]) -> Any:
        """Execute it once, within a transaction; return the driver's cursor.

        Raises:
            sqlalchemy.exc.DBAPIError: the database refuses.
        """
        known = self._in_words_of(connection.dialect)
        given = {**known.constants, **values}
        ordered = [given[name] for name in known.names]
        driver: Any = connection.connection.dbapi_connection
        kind = connection.dialect.loaded_dbapi.Error
        try:
            return driver.execute(known.text, ordered)
        except kind as error:
            raise DBAPIError.instance(
                known.text, ordered, error, kind, dialect=connection.dialect
            ) from error

    def execute_many(self, connection: Connection, rows: Sequence[tuple[Any, ...]]) -> None:
        """Execute it with each of `rows`: values of the parameters in their order."""
        if rows:
            known = self._in_words_of(connection.dialect)
            connection.exec_driver_sql(known.text, [known.arrange(row) for row in rows])

    def _in_words_of(self, dialect: Dialect) -> _Compiled:
        if dialect.name not in self._compiled:
            by_place: Any = "qmark" if dialect.name == "sqlite" else "format"
            kind: type[DefaultDialect] = type(dialect)  # type: ignore[assignment]
            found = self._statement.compile(
                dialect=kind(paramstyle=by_place), column_keys=self._names
            )
            assert isinstance(found, SQLCompiler)
            names = tuple(found.positiontup or ())
            constants = {name: found.params[name] for name in names if name not in self._names}
            every = (*self._names, *constants)
            places = itemgetter(*(every.index(name) for name in names))
            self._compiled[dialect.name] = _Compiled(
                text=found.string,
                names=names,
                constants=constants,
                arrange=lambda row: places((*row, *constants.values())),
            )
        return self._compiled[dialect.name]
