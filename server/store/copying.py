"""Everything that a database holds, into another one: from SQLite to PostgreSQL, or back.

Values go over as they are stored: numbers with all their bits, JSON as the text that it is.
"""

import sqlite3
from collections.abc import Callable, Iterator
from typing import Any

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql
from sqlalchemy.engine import Connection, Engine
from sqlalchemy.exc import OperationalError

from server.errors import ConflictError, DamagedError
from server.store.database.engine import reading, writing
from server.store.database.prepared import text
from server.store.database.schema import leases, metadata

#: Rows read and written at a time.
PAGE = 1000


def copy(source: Engine, target: Engine, on_table: Callable[[str, int], None]) -> None:
    """Copy every table, in one transaction of the target and one state of the source.

    Args:
        target: with the same schema, and nothing in it.
        on_table: is told each table and its rows when they are copied.

    Raises:
        ConflictError: the target holds something.
        DamagedError: a table of the source cannot be read.
    """
    with reading(source) as old, writing(target) as new:
        for table in metadata.sorted_tables:
            if new.scalar(sa.select(sa.func.count()).select_from(table)):
                raise ConflictError(f"the target is not empty: it has {table.name}")
        for table in metadata.sorted_tables:
            on_table(table.name, _copy_table(old, new, table))
        _go_on_counting(old, new)


def others_at(source: Engine) -> int:
    """Return how many other sessions have a database open; of SQLite 0, where a lock tells.

    Coordinators and an analysis keep theirs open, idle or not. Whose they are PostgreSQL does not
    know.
    """
    if source.dialect.name == "sqlite":
        return 0
    with reading(source) as connection:
        # The server's own, as of a vacuum, are nobody's.
        query = (
            "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database() "
            "AND pid <> pg_backend_pid() AND usename IS NOT NULL"
        )
        return int(connection.scalar(sa.text(query)) or 0)


def _copy_table(old: Connection, new: Connection, table: sa.Table) -> int:
    count = 0
    statement = _adding(table, new.dialect.name)
    for page in _pages(old, table):
        new.execute(statement, page)
        count += len(page)
    return count


def _adding(table: sa.Table, dialect: str) -> sa.Insert:
    """Return what adds a row whose JSON is text, as SQLite keeps it and PostgreSQL does not."""

    def value(column: sa.Column[Any]) -> sa.ColumnElement[Any]:
        if not isinstance(column.type, sa.JSON):
            return sa.bindparam(column.name, type_=column.type)
        given = sa.bindparam(column.name, type_=sa.Text)
        return given if dialect == "sqlite" else sa.cast(given, postgresql.JSON)

    return sa.insert(table).values({column.name: value(column) for column in table.c})


def _pages(old: Connection, table: sa.Table) -> Iterator[list[dict[str, Any]]]:
    columns = [text(column) if isinstance(column.type, sa.JSON) else column for column in table.c]
    try:
        # The server keeps what was not asked for yet: a study may have millions of results.
        found = old.execution_options(yield_per=PAGE).execute(sa.select(*columns))
        for page in found.partitions():
            yield [dict(row._mapping) for row in page]
    except sqlite3.OperationalError as error:
        raise _unreadable(table, error) from error
    except OperationalError as error:
        if old.dialect.name != "sqlite":
            raise
        raise _unreadable(table, error.orig) from error


def _unreadable(table: sa.Table, error: BaseException | None) -> DamagedError:
    # What cannot be decoded is quoted by SQLite, and is somebody's.
    why, _, _ = " ".join(str(error).split()).partition(" with text ")
    return DamagedError(f"table {table.name}: {why}")


def _go_on_counting(old: Connection, new: Connection) -> None:
    """Have the target number new rows after those that the source has ever had."""
    for table in metadata.sorted_tables:
        (*key,) = table.primary_key.columns
        if len(key) != 1 or not isinstance(key[0].type, sa.Integer) or not key[0].autoincrement:
            continue
        last = new.scalar(sa.select(sa.func.max(key[0]))) or 0
        if table is leases:
            # A fence is given once, also if its lease went with its study.
            last = max(last, _last_fence(old))
        if not last:
            continue
        if new.dialect.name == "postgresql":
            sequence = sa.func.pg_get_serial_sequence(table.name, key[0].name)
            new.execute(sa.select(sa.func.setval(sequence, last)))
        elif table is leases:
            new.execute(
                sa.text("UPDATE sqlite_sequence SET seq = :last WHERE name = 'leases'"),
                {"last": last},
            )


def _last_fence(old: Connection) -> int:
    if old.dialect.name == "sqlite":
        query = "SELECT seq FROM sqlite_sequence WHERE name = 'leases'"
    else:
        query = "SELECT last_value FROM leases_fence_seq"
    return int(old.scalar(sa.text(query)) or 0)
