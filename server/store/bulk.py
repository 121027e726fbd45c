"""Many rows in one statement, without SQLAlchemy's look at every value of every row."""

from collections.abc import Callable, Sequence
from operator import itemgetter
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Dialect
from sqlalchemy.engine.default import DefaultDialect
from sqlalchemy.sql.compiler import SQLCompiler

_Arrange = Callable[[tuple[Any, ...]], tuple[Any, ...]]


class Bulk:
    """A statement to be executed with one tuple of values after the other.

    Args:
        statement: what to do; it is compiled once for each kind of database.
        names: of its parameters, in the order of a tuple's values. JSON goes in as text.
    """

    def __init__(self, statement: sa.Insert | sa.Update, names: Sequence[str]) -> None:
        self._statement = statement
        self._names = tuple(names)
        self._compiled: dict[str, tuple[str, _Arrange]] = {}

    def __call__(self, connection: Connection, rows: Sequence[tuple[Any, ...]]) -> None:
        """Execute it with each of `rows`, within a transaction."""
        if not rows:
            return
        text, arrange = self._in_words_of(connection.dialect)
        connection.exec_driver_sql(text, [arrange(row) for row in rows])

    def _in_words_of(self, dialect: Dialect) -> tuple[str, _Arrange]:
        """Return the statement's text, and what puts a tuple's values in its order."""
        if dialect.name not in self._compiled:
            by_place: Any = "qmark" if dialect.name == "sqlite" else "format"
            kind: type[DefaultDialect] = type(dialect)  # type: ignore[assignment]
            compiled = self._statement.compile(
                dialect=kind(paramstyle=by_place), column_keys=self._names
            )
            assert isinstance(compiled, SQLCompiler)
            order = [self._names.index(name) for name in compiled.positiontup or ()]
            self._compiled[dialect.name] = (compiled.string, itemgetter(*order))
        return self._compiled[dialect.name]
