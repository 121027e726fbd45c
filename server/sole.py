"""One coordinator per SQLite file: a second one would take the first one's silence for its own."""

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import sqlalchemy as sa

from server.errors import ConflictError


@contextmanager
def sole_coordinator(url: str) -> Iterator[None]:
    """Hold the lock file beside a SQLite database; does nothing for another.

    The kernel drops the lock when the process ends, however it ends.

    Raises:
        ConflictError: another process holds it.
        OSError: the folder cannot be written to.
    """
    database = sa.make_url(url)
    if database.get_backend_name() != "sqlite" or not database.database:
        yield
        return
    path = Path(f"{database.database}.lock")
    with path.open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ConflictError(
                f"another coordinator serves {database.database}: stop it first, or set "
                "REHYB_DATABASE_URL to another database"
            ) from None
        yield
