"""A real PostgreSQL server for every test that wants one, started by the suite itself.

Where tests run on several cores, each of pytest-xdist's processes starts one.
"""

import gc
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from uuid import uuid4

import pytest
import sqlalchemy as sa

from rehyb.threads import limit_threads
from tests.testbed.coordinators.postgresql import serving

limit_threads()

#: Names a running server instead, with a role that may make databases.
VARIABLE = "REHYB_TEST_POSTGRES_URL"
#: Nothing in it is to survive anything, so that it may be fast.
OPTIONS = ("fsync=off", "synchronous_commit=off", "full_page_writes=off", "max_connections=200")
#: Ends every other connection to the database, whatever a test has left open.
OTHERS_LEAVE = (
    "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
    "WHERE datname = current_database() AND pid <> pg_backend_pid()"
)


def pytest_sessionstart() -> None:
    """Look for no garbage in libraries and tests, which stay to the end."""
    gc.disable()


def pytest_collection_finish() -> None:
    """Look for garbage among what tests make."""
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session")
def empty_database(postgresql_server: str) -> Iterator[Callable[[], str]]:
    """Empty the one database that the tests share, one after the other; returns its URL."""
    with _own_database(postgresql_server) as own:

        def empty() -> str:
            # A database for each test would be cleaner, but takes ten times as long as most.
            with own.connect() as connection:
                connection.exec_driver_sql(OTHERS_LEAVE)
                connection.exec_driver_sql("DROP SCHEMA public CASCADE")
                connection.exec_driver_sql("CREATE SCHEMA public")
            return own.url.render_as_string(hide_password=False)

        yield empty


@pytest.fixture(scope="session")
def upgraded_database(postgresql_server: str) -> Iterator[Callable[[], str]]:
    """As `empty_database`, of one with the current schema, whose tables are emptied."""
    # Only tests that want a database load what it needs.
    from server.store import upgrade

    with _own_database(postgresql_server) as own:
        url = own.url.render_as_string(hide_password=False)
        upgrade(url)
        with own.connect() as connection:
            inspected = sa.inspect(connection)
            # Those that refer to others come first, so that each may be emptied by itself.
            tables = [name for name, _ in inspected.get_sorted_table_and_fkc_names() if name]
            names = [name for name in reversed(tables) if name != "alembic_version"]
            counters = inspected.get_sequence_names()
            emptied = [f"DELETE FROM {name}" for name in names]
            emptied += [f"ALTER SEQUENCE {name} RESTART" for name in counters]
            version = connection.exec_driver_sql("SELECT version_num FROM alembic_version").scalar()

        def empty() -> str:
            # Every migration again would take longer than most tests.
            with own.connect() as connection:
                connection.exec_driver_sql(OTHERS_LEAVE)
                # To truncate makes new files of every table and index: fifteen times as long.
                connection.exec_driver_sql("; ".join(emptied))
                # A test may have pretended another.
                connection.exec_driver_sql(f"UPDATE alembic_version SET version_num = '{version}'")
            return url

        yield empty


@contextmanager
def _own_database(postgresql_server: str) -> Iterator[sa.Engine]:
    name = f"rehyb_{uuid4().hex}"
    server = sa.create_engine(postgresql_server, isolation_level="AUTOCOMMIT")
    with server.connect() as connection:
        connection.exec_driver_sql(f"CREATE DATABASE {name}")
    # Some tests cut every connection to it.
    own = sa.create_engine(
        server.url.set(database=name), isolation_level="AUTOCOMMIT", pool_pre_ping=True
    )
    yield own
    own.dispose()
    if VARIABLE in os.environ:
        with server.connect() as connection:
            connection.exec_driver_sql(f"DROP DATABASE {name} WITH (FORCE)")
    server.dispose()


@pytest.fixture(scope="session")
def postgresql_server() -> Iterator[str]:
    """The URL of a database of a PostgreSQL server in which databases may be made."""
    if url := os.environ.get(VARIABLE):
        yield url
        return
    with serving(OPTIONS) as server:
        yield server.url
