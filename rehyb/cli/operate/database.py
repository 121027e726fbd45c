"""Commands about the coordinator's database: `db upgrade`, `backup`, `restore`, `copy`, `check`."""

import logging
import os
import sqlite3
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rehyb.cli.answers import Answer, answering, file_written
from rehyb.errors import WRONG_PATHS, Invalid, RehybError, needs_extra

if TYPE_CHECKING:
    from sqlalchemy.engine import Engine
    from sqlalchemy.exc import SQLAlchemyError

log = logging.getLogger(__name__)

#: Seconds between two looks for a database that a coordinator has yet to make.
LOOK_SECONDS = 1.0

#: What a look for damage before an upgrade may take; that of a large file takes longer.
LOOK_FOR_DAMAGE_SECONDS = 10.0

#: What SQLite answers where it may not write, or cannot; it does not say to what.
_NOT_WRITABLE = (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY)
#: And of a file whose pages are damaged.
_DAMAGED = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)

#: What to do about it.
_WHAT_NOW = (
    "stop the coordinator and its analysis, and go back to a copy of `rehyb db backup` by "
    "`rehyb db restore`"
)

app = typer.Typer(help="The coordinator's database.", no_args_is_help=True)


class NoDatabaseError(Invalid):
    """There is no file of the database."""


@app.command()
@answering
def upgrade() -> Answer:
    """Bring the database at REHYB_DATABASE_URL to this version's schema."""
    with needs_extra("the database", "server"):
        from server.operations.check import refuse_damage
        from server.store import upgrade

    with in_one_sentence():
        refuse_damage(_url(), seconds=LOOK_FOR_DAMAGE_SECONDS)
        upgrade(_url())
    return Answer({"upgraded": True}, "the database has the schema of this version")


@app.command()
@answering
def backup(file: Annotated[Path, typer.Argument(help="The copy; must not exist.")]) -> Answer:
    """Copy the SQLite database at REHYB_DATABASE_URL, also while a coordinator uses it."""
    from server.operations import check as checks

    with opened() as engine:
        checks.back_up(engine, file)
    return file_written(file)


@app.command()
@answering
def restore(
    file: Annotated[Path, typer.Argument(help="From `rehyb db backup`.", metavar="BACKUP")],
) -> Answer:
    """Put a backup in the place of the SQLite database at REHYB_DATABASE_URL.

    It is checked first. Stop coordinator and analysis before: what they have open is replaced.
    """
    with needs_extra("the database", "server"):
        from server.operations import backups

    if "REHYB_DATABASE_URL" not in os.environ:
        # Who has not named a database means one that is there.
        _check_there(_url())
    with in_one_sentence():
        path = backups.restore(_url(), file)
    text = f"{file} is whole, and now is the database {path}; what was there is gone, with its log"
    return Answer({"database": str(path), "backup": str(file)}, text)


@app.command()
@answering
def check() -> Answer:
    """Count everything anew; exit status 1 if the database contradicts itself."""
    from server.operations import check as checks

    with opened() as engine:
        found = checks.faults(engine)
    text = "\n".join(found) or "the database is whole"
    if any(fault.startswith("the file is damaged") for fault in found):
        text += f"\n{_file(_url())}: {_WHAT_NOW}"
    return Answer({"faults": found}, text, status=1 if found else 0)


@app.command()
@answering
def copy(
    target: Annotated[
        str,
        typer.Argument(
            metavar="URL", help="An empty database: postgresql+psycopg://... or sqlite:///FILE."
        ),
    ],
) -> Answer:
    """Copy everything in the database at REHYB_DATABASE_URL into another one, and check that.

    So a study moves from SQLite to PostgreSQL. Stop the coordinators first; exit status 1 if the
    copy contradicts itself.
    """
    with needs_extra("the database", "server"):
        from server.instance_lock import instance_lock
        from server.operations import check as checks
        from server.store import create_engine, upgrade
        from server.store.copying import copy as copied
        from server.store.copying import others_at

    _check_there(_url())
    counts: dict[str, int] = {}
    with (
        in_one_sentence(),
        instance_lock(_url()),
        opened() as source,
        in_one_sentence(target),
        _refusing_damage(source),
        _undone(target),
    ):
        try:
            upgrade(target)
            engine = create_engine(target)
        except ModuleNotFoundError as error:
            raise Invalid(f"{target!r} needs the extra postgresql: {error}") from None
        try:
            others = others_at(source)
            copied(source, engine, counts.__setitem__)
            found = checks.faults(engine)
        finally:
            engine.dispose()
    rows = ", ".join(f"{count} {table}" for table, count in counts.items() if count)
    text = "\n".join(found) or f"copied and whole: {rows or 'nothing'}"
    if others:
        text += (
            f"\nsessions that had the database open meanwhile: {others}. What they wrote since the "
            "copy began is not in it: if a coordinator or an analysis is among them, stop it and "
            "copy again, into an empty database"
        )
    answer = {"rows": counts, "faults": found, "other_sessions": others}
    return Answer(answer, text, status=1 if found else 0)


@contextmanager
def _refusing_damage(source: "Engine") -> Iterator[None]:
    """Look for damage of a SQLite file before the block, which may find more."""
    from server.errors import DamagedError
    from server.store.audit import damage
    from server.store.database.engine import reading

    try:
        with reading(source) as connection:
            fault = damage(connection, seconds=inf)
        if fault is not None:
            raise DamagedError(" ".join(fault.split()))
        yield
    except DamagedError as error:
        raise RehybError(f"{_file(_url())} is damaged ({error}): {_WHAT_NOW}") from error


@contextmanager
def _undone(target: str) -> Iterator[None]:
    """Remove the SQLite file that a block made that fails."""
    file = _file(target)
    made = target.startswith("sqlite:///") and not file.exists()
    try:
        yield
    except BaseException:
        for ending in ("", "-wal", "-shm", "-journal") if made else ():
            with suppress(OSError):
                Path(f"{file}{ending}").unlink(missing_ok=True)
        raise


@contextmanager
def opened(*, stop: threading.Event | None = None) -> Iterator["Engine"]:
    """Open the database at REHYB_DATABASE_URL, for which no token is needed; never make one.

    Args:
        stop: if given, a server that is not there yet, and a coordinator that has yet to make the
            database or to bring it to this version, are waited for until it is set.

    Raises:
        RehybError: it is not there, cannot be used, or has another version's schema.
    """
    with needs_extra("the database", "server"):
        from server.store import create_engine, require_current

    url = _url()
    with in_one_sentence():
        engine = create_engine(url)
        try:
            if stop is None:
                _check_there(url)
                require_current(engine)
            else:
                _wait_until_current(engine, url, stop)
            yield engine
        finally:
            engine.dispose()


def _wait_until_current(engine: "Engine", url: str, stop: threading.Event) -> None:
    """Wait until the database has this version's schema; that, and its end, is logged once each.

    Whoever starts beside a coordinator may be quicker.

    Raises:
        SchemaError: a newer version has made it.
    """
    from server.errors import OldSchemaError
    from server.store import require_current
    from server.store.database.presence import once_there

    waits = False
    while not stop.is_set():
        try:
            # To open a file that is not there would make it.
            _check_there(url)
            once_there(engine, partial(require_current, engine), stop=stop)
            if waits:
                log.warning("the database is there")
            return
        except (NoDatabaseError, OldSchemaError) as error:
            if not waits:
                log.warning("a coordinator's start is waited for: %s", error)
            waits = True
        stop.wait(LOOK_SECONDS)


def _check_there(url: str) -> None:
    """Raise NoDatabaseError if a SQLite database is nowhere: opening it would make an empty one."""
    file = url.removeprefix("sqlite:///")
    if file not in (url, ":memory:") and not Path(file).exists():
        raise NoDatabaseError(
            f"there is no database {Path(file).absolute()}: set REHYB_DATABASE_URL, as in "
            "sqlite:///.rehyb/rehyb.sqlite3, where `rehyb up` keeps it"
        )


def _url() -> str:
    from server.settings import Settings

    default: str = Settings.model_fields["database_url"].default
    return os.environ.get("REHYB_DATABASE_URL", default)


def _file(url: str) -> Path:
    return Path(url.removeprefix("sqlite:///")).absolute()


@contextmanager
def in_one_sentence(url: str | None = None) -> Iterator[None]:
    """Turn what the server raises at start into this command's errors.

    Args:
        url: of the database that is opened; default: the one at REHYB_DATABASE_URL.
    """
    from sqlalchemy.exc import SQLAlchemyError

    from server.errors import (
        BadSettingError,
        CoordinatorError,
        OtherDatabaseError,
        WrongPathError,
    )

    try:
        yield
    except OtherDatabaseError as error:
        named = "by REHYB_DATABASE_URL" if url is None else "as the target"
        raise Invalid(f"{error} {named}") from error
    except (BadSettingError, WrongPathError, *WRONG_PATHS) as error:
        raise Invalid(str(error)) from error
    except (CoordinatorError, OSError) as error:
        raise RehybError(str(error)) from error
    except SQLAlchemyError as error:
        raise _said(error, _file(url or _url())) from error


def _said(error: "SQLAlchemyError", file: Path) -> RehybError:
    """Return what SQLAlchemy raised of the database, which `file` is if it is SQLite's."""
    from server.store.database.files import is_sqlite

    orig = getattr(error, "orig", None)
    cause = str(orig or error).splitlines()[0]
    code = getattr(orig, "sqlite_errorcode", 0)
    if code & 0xFF in _DAMAGED:
        if is_sqlite(file):
            return RehybError(f"{file} is damaged ({cause}): {_WHAT_NOW}")
        return Invalid(f"{file} is no SQLite database of rehyb ({cause}): name another file")
    if code & 0xFF in _NOT_WRITABLE and code != sqlite3.SQLITE_READONLY_DBMOVED:
        why = f"{cause}; SQLite writes beside a file that it reads, too"
        if file.is_dir():
            why = "is a folder; name a file"
        elif not file.parent.is_dir():
            why = f"there is no folder {file.parent}"
        return Invalid(f"the database cannot be used: {file}: {why}")
    return RehybError(f"the database cannot be used: {cause}")
