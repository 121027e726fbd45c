"""The schema and how it comes to be."""

import sqlite3
import threading
from collections.abc import Callable

import pytest
import sqlalchemy as sa
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from sqlalchemy.engine import Engine

from server.errors import OtherDatabaseError, SchemaError
from server.store import create_engine, require_current, upgrade
from server.store.database.engine import writing
from server.store.database.files import use_write_ahead_log
from server.store.database.schema import metadata


def test_the_migrations_make_the_tables_that_the_queries_use(engine: Engine) -> None:
    with engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        assert compare_metadata(context, metadata) == []


def test_upgrading_twice_changes_nothing(url: str) -> None:
    upgrade(url)
    upgrade(url)
    engine = create_engine(url)
    require_current(engine)
    engine.dispose()


def test_several_processes_may_upgrade_at_once(url: str) -> None:
    failures: list[Exception] = []

    def run() -> None:
        try:
            upgrade(url)
        except Exception as error:
            failures.append(error)

    threads = [threading.Thread(target=run) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failures == []


def test_a_database_without_a_schema_is_refused(url: str) -> None:
    engine = create_engine(url)
    with pytest.raises(SchemaError, match=r"has schema none, .* run `rehyb db upgrade`"):
        require_current(engine)
    engine.dispose()


@pytest.mark.parametrize("version", [None, "0001", "4f2c"], ids=["plain", "as_ours", "alembic"])
def test_a_database_of_somebody_else_is_refused_and_left_alone(
    version: str | None, url: str
) -> None:
    tables = ["foo"] if version is None else ["alembic_version", "foo"]
    own = sa.create_engine(url)
    with own.begin() as connection:
        connection.exec_driver_sql("CREATE TABLE foo (x INTEGER)")
        if version is not None:
            connection.exec_driver_sql("CREATE TABLE alembic_version (version_num VARCHAR(32))")
            connection.exec_driver_sql(f"INSERT INTO alembic_version VALUES ('{version}')")
    engine = create_engine(url)
    for attempt in (lambda: upgrade(url), lambda: require_current(engine)):
        with pytest.raises(OtherDatabaseError, match=r"holds other tables \(foo\); name another"):
            attempt()
    engine.dispose()
    assert sorted(sa.inspect(own).get_table_names()) == tables
    if own.dialect.name == "sqlite":
        with own.connect() as connection:
            assert connection.exec_driver_sql("PRAGMA journal_mode").scalar() == "delete"
    own.dispose()


def test_tables_of_another_schema_of_postgresql_are_nobodys_business(
    empty_database: Callable[[], str],
) -> None:
    url = empty_database()
    own = sa.create_engine(url)
    try:
        with own.begin() as connection:
            connection.exec_driver_sql("CREATE SCHEMA theirs")
            connection.exec_driver_sql("CREATE TABLE theirs.foo (x INTEGER)")
        upgrade(url)
    finally:
        with own.begin() as connection:
            connection.exec_driver_sql("DROP SCHEMA theirs CASCADE")
        own.dispose()


def test_a_newer_schema_is_refused_and_left_alone(url: str) -> None:
    # Not the database that tests share: they would find this schema in it.
    upgrade(url)
    engine = create_engine(url)
    with writing(engine) as connection:
        connection.exec_driver_sql("UPDATE alembic_version SET version_num = '9999'")
    for attempt in (lambda: upgrade(url), lambda: require_current(engine)):
        with pytest.raises(SchemaError, match=r"schema 9999, .* made by a newer version"):
            attempt()
    with engine.connect() as connection:
        assert connection.exec_driver_sql("SELECT * FROM alembic_version").scalar() == "9999"
    engine.dispose()


def test_a_failed_migration_leaves_no_half_made_schema(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise RuntimeError("power cut")

    with monkeypatch.context() as patched:
        patched.setattr("alembic.op.create_index", fail)
        with pytest.raises(RuntimeError, match="power cut"):
            upgrade(url)
    engine = create_engine(url)
    assert sa.inspect(engine).get_table_names() == []
    engine.dispose()


def test_opening_a_file_that_others_just_make_is_tried_again() -> None:
    class Busy:
        """A connection that finds the file locked twice."""

        def __init__(self, error: str) -> None:
            self.error = error
            self.asked = 0

        def execute(self, _statement: str) -> None:
            self.asked += 1
            if self.asked < 3:
                raise sqlite3.OperationalError(self.error)

    busy, damaged = Busy("database is locked"), Busy("file is not a database")
    use_write_ahead_log(busy)
    assert busy.asked == 3
    with pytest.raises(sqlite3.OperationalError, match="not a database"):
        use_write_ahead_log(damaged)
    assert damaged.asked == 1
