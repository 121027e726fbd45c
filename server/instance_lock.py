"""One coordinator per SQLite file: a second one would take the first one's silence for its own."""

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from server.errors import ConflictError, WrongPathError
from server.store.database.engine import of_known_kind
from server.store.database.files import make_private


@contextmanager
def instance_lock(url: str) -> Iterator[None]:
    """Lock a SQLite database's file, by whatever name or link; does nothing for another database.

    The kernel drops the lock when the process ends, however it ends. It is another kind than those
    that SQLite takes on the file, and holds nobody else up. When the file is closed SQLite's own
    are lost with it: in the block, and in no other process, may it be open.

    Raises:
        ConflictError: another process holds it.
        WrongPathError: the file cannot be opened.
        CoordinatorError: no database of ours has such a URL.
    """
    database = of_known_kind(url)
    if database.drivername != "sqlite":
        yield
        return
    path = Path(str(database.database))
    make_private(path)
    try:
        file = path.open("ab")
    except OSError as error:
        raise WrongPathError(f"the database cannot be used: {path}: {error.strerror}") from error
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ConflictError(
                f"a coordinator, or a `rehyb db` command, is at work on {database.database}: stop "
                "it first, or set REHYB_DATABASE_URL to another database"
            ) from None
        yield
