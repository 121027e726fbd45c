"""Statements compiled once write what SQLAlchemy would, and fail as it would."""

from collections.abc import Iterator
from typing import Any

import pytest
import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine
from sqlalchemy.exc import DBAPIError

from server.store.database.engine import reading, writing
from server.store.database.prepared import ROWS, Prepared, text
from server.store.fleet.turn_statements import SetStatement
from server.store.fleet.turns import at_once, turn_within

TABLE = sa.Table(
    "things",
    sa.MetaData(),
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("row", sa.BigInteger),
    sa.Column("what", sa.JSON),
    sa.Column("state", sa.String(16)),
)
INSERT = Prepared(sa.insert(TABLE), "id", "row", "what", "state")
#: A condition that is always the same, between parameters that are not.
CLOSE = Prepared(
    sa.update(TABLE)
    .where(TABLE.c.state == "open", TABLE.c.row == sa.bindparam("at_row"))
    .values(state=sa.bindparam("to_state")),
    "at_row",
    "to_state",
)

#: Adds rows of which some columns are the same in all.
ADD = SetStatement(
    "INSERT INTO things (state, row, id, what) SELECT %s, %s, id, what FROM {told}",
    id="int",
    what="json",
)


@pytest.fixture
def things(engine: Engine) -> Iterator[Engine]:
    """A database with a table of things."""
    with writing(engine) as connection:
        TABLE.create(connection)
    yield engine
    with writing(engine) as connection:
        TABLE.drop(connection)


def rows(engine: Engine) -> list[tuple[Any, ...]]:
    with reading(engine) as connection:
        return [tuple(row) for row in connection.execute(sa.select(TABLE).order_by(TABLE.c.id))]


def add(connection: Connection, *values: Any) -> None:
    at_once(turn_within(connection).trip(ADD.statements(connection.dialect, *values)))


def test_what_is_written_once_or_often_is_read_as_it_was_meant(things: Engine) -> None:
    with writing(things) as connection:
        INSERT.execute_many(connection, [(1, 10, '{"x": [1, 2]}', "open"), (2, 2**40, None, None)])
        INSERT.execute(connection, 3, 10, '"ü"', "it's %s ?")
    assert rows(things) == [
        (1, 10, {"x": [1, 2]}, "open"),
        (2, 2**40, None, None),
        (3, 10, "ü", "it's %s ?"),
    ]


def test_nothing_at_all_may_be_written_often(things: Engine) -> None:
    with writing(things) as connection:
        INSERT.execute_many(connection, [])
    assert rows(things) == []


@pytest.mark.parametrize("count", [0, 1, 2, ROWS, ROWS + 1, 3 * ROWS])
def test_rows_are_added_as_they_are_given_however_many(things: Engine, count: int) -> None:
    with writing(things) as connection:
        add(connection, None, 2**40, [(n, {"n": n}) for n in range(count)])
        add(connection, "it's %s ?", None, [(count, None)])
    assert rows(things) == [
        *((n, 2**40, {"n": n}, None) for n in range(count)),
        (count, None, None, "it's %s ?"),
    ]


def test_of_rows_one_of_which_is_refused_none_is_added(things: Engine) -> None:
    with pytest.raises(DBAPIError), writing(things) as connection:
        add(connection, None, None, [(1, None), (2, None), (1, None)])
    assert rows(things) == []


def test_a_constant_of_a_statement_keeps_its_place_among_the_parameters(things: Engine) -> None:
    with writing(things) as connection:
        INSERT.execute_many(
            connection, [(1, 7, None, "open"), (2, 7, None, "shut"), (3, 8, None, "open")]
        )
        closed = CLOSE.execute(connection, 7, "closed")
        assert closed.rowcount == 1
        CLOSE.execute_many(connection, [(8, "gone"), (9, "never")])
    assert [row[3] for row in rows(things)] == ["closed", "shut", "gone"]


def test_it_returns_what_the_statement_returns(things: Engine) -> None:
    add = Prepared(sa.insert(TABLE).returning(TABLE.c.id), "row")
    with writing(things) as connection:
        found = [add.execute(connection, number).fetchone()[0] for number in (5, 6)]
    assert found == [row[0] for row in rows(things)]


def test_what_the_database_refuses_is_an_error_that_everybody_knows(things: Engine) -> None:
    with pytest.raises(DBAPIError), writing(things) as connection:
        INSERT.execute(connection, 1, 1, None, None)
        INSERT.execute(connection, 1, 1, None, None)
    assert rows(things) == []


def test_rows_are_read_as_tuples_and_json_as_text(things: Engine) -> None:
    find = Prepared(
        sa.select(TABLE.c.id, text(TABLE.c.what))
        .where(TABLE.c.row == sa.bindparam("of_row"), TABLE.c.state == "open")
        .order_by(TABLE.c.id),
        "of_row",
    )
    with writing(things) as connection:
        INSERT.execute_many(
            connection, [(2, 7, "[1]", "open"), (1, 7, None, "open"), (3, 7, "2", "shut")]
        )
        assert find.execute(connection, 7).fetchall() == [(1, None), (2, "[1]")]
        assert find.execute(connection, 8).fetchall() == []


def test_sqlite_takes_the_index_it_is_told_to(things: Engine) -> None:
    of_row = sa.select(TABLE.c.id).where(TABLE.c.row == sa.bindparam("of_row"))
    find = Prepared(of_row, "of_row", index="things_by_row")
    with writing(things) as connection:
        INSERT.execute(connection, 1, 7, None, None)
        if connection.dialect.name == "sqlite":
            with pytest.raises(DBAPIError, match="no such index: things_by_row"):
                find.execute(connection, 7)
        connection.exec_driver_sql("CREATE INDEX things_by_row ON things (row)")
        assert find.execute(connection, 7).fetchall() == [(1,)]
