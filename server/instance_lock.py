"""One coordinator per SQLite file: a second one would take the first one's silence for its own."""

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import sqlalchemy as sa

from server.errors import ConflictError


@contextmanager
def instance_lock(url: str) -> Iterator[None]:
    """Hold the lock file beside a SQLite database; does nothing for another.

    The kernel drops the lock when the process ends, however it ends.

    Raises:
        ConflictError: another process holds it, or there is no place for it.
    """
    database = sa.make_url(url)
    if database.get_backend_name() != "sqlite" or not database.database:
        yield
        return
    path = Path(f"{database.database}.lock")
    try:
        file = path.open("w")
    except OSError as error:
        raise ConflictError(f"the database cannot be used: {path}: {error.strerror}") from error
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ConflictError(
                f"another coordinator serves {database.database}: stop it first, or set "
                "REHYB_DATABASE_URL to another database"
            ) from None
        yield
