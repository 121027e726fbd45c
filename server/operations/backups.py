"""A backup goes in the place of a SQLite database."""

import fcntl
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from errno import ENOSPC
from pathlib import Path

from sqlalchemy.exc import DBAPIError

from server.errors import ConflictError, OtherDatabaseError, SchemaError, WrongPathError
from server.instance_lock import instance_lock
from server.operations.check import faults
from server.store import create_engine, has_schema, upgrade
from server.store.database.engine import of_known_kind
from server.store.database.files import is_sqlite, make_private

#: What SQLite keeps beside a file, and replays into whatever file it finds there.
_BESIDE = ("-wal", "-shm", "-journal")
#: What is restored.
_WANTED = "name a copy by `rehyb db backup`"
#: The byte of a `-shm` that every process locks as long as it has the database open.
_OPEN_BYTE = 128


def restore(url: str, backup: Path) -> Path:
    """Put a backup in the place of a SQLite database, and return where that is.

    The backup is checked, and brought to this version's schema, before anything is replaced. What
    is left of the old database's log goes first: SQLite would replay it into the new one.

    Raises:
        ConflictError: somebody has the database open, or the backup is not whole.
        WrongPathError: the backup is not there, or no database of rehyb.
        CoordinatorError: no database of ours has such a URL.
    """
    database = of_known_kind(url)
    if database.drivername != "sqlite":
        raise ConflictError("this is a PostgreSQL database: restore it with pg_restore")
    path = Path(os.path.realpath(str(database.database)))
    if not backup.is_file():
        raise WrongPathError(_no_file(backup))
    if path.exists() and path.samefile(backup):
        raise WrongPathError(f"{backup} is the database itself: name a backup")
    with _copied(backup, path) as copy:
        _make_current(copy, backup)
        with instance_lock(url):
            _refuse_others(path)
            # In this order: whatever ends it in between, no old log is beside the new file.
            for file in _beside(path):
                file.unlink(missing_ok=True)
            copy.replace(path)
    return path


def _no_file(backup: Path) -> str:
    if not backup.exists():
        return f"there is no backup {backup.absolute()}"
    return f"{backup} is {'a folder' if backup.is_dir() else 'no regular file'}: {_WANTED}"


@contextmanager
def _copied(backup: Path, path: Path) -> Iterator[Path]:
    """Yield a copy of a backup in the folder of `path`, whose owner may read it alone."""
    copy = path.with_name(path.name + ".partial")
    log = Path(f"{backup}-wal")
    if log.exists() and log.stat().st_size:
        raise ConflictError(
            f"{backup} is in use, or no copy by `rehyb db backup`: a part of it is in {log}"
        )
    try:
        try:
            copy.unlink(missing_ok=True)
            make_private(copy)
            shutil.copyfile(backup, copy)
        except OSError as error:
            raise (ConflictError if error.errno == ENOSPC else WrongPathError)(
                f"{backup} cannot be copied to the folder of {path}: {error.strerror}"
            ) from error
        if path.exists():
            before = path.stat()
            # Whoever restores it may be another than who serves it.
            with suppress(PermissionError):
                os.chown(copy, before.st_uid, before.st_gid)
        yield copy
    finally:
        for file in (copy, *_beside(copy)):
            # It may be what keeps it from being made.
            with suppress(OSError):
                file.unlink(missing_ok=True)


def _make_current(copy: Path, backup: Path) -> None:
    """Bring a copy of a backup to this version's schema; ConflictError if it is not whole then."""
    url = f"sqlite:///{copy}"
    engine = create_engine(url)
    try:
        # An empty file would become an empty database.
        if not has_schema(engine):
            raise WrongPathError(f"{backup} is no database of rehyb: {_WANTED}")
        upgrade(url)
        found = faults(engine)
    except OtherDatabaseError as error:
        why = f"{backup} is no database of rehyb ({error.found}): {_WANTED}; nothing is replaced"
        raise WrongPathError(why) from error
    except DBAPIError as error:
        if not is_sqlite(copy):
            why = f"{backup} is no SQLite database ({error.orig}): {_WANTED}; nothing is replaced"
            raise WrongPathError(why) from error
        raise ConflictError(
            f"{backup} cannot be used: {error.orig}; nothing is replaced"
        ) from error
    except SchemaError as error:
        raise ConflictError(f"{backup} cannot be used: {error}") from error
    finally:
        engine.dispose()
    if found:
        raise ConflictError(
            f"{backup} is not whole ({' '.join(found[0].split())}): nothing is replaced"
        )
    with copy.open("rb") as file:
        os.fsync(file.fileno())


def _refuse_others(path: Path) -> None:
    """Raise ConflictError if another process has the database open: it would keep the old one."""
    with suppress(FileNotFoundError), Path(f"{path}-shm").open("r+b") as file:
        try:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, _OPEN_BYTE)
        except (BlockingIOError, PermissionError):
            raise ConflictError(
                f"a process has {path} open, as `rehyb analysis` has: stop it first"
            ) from None


def _beside(path: Path) -> list[Path]:
    return [Path(f"{path}{ending}") for ending in _BESIDE]
