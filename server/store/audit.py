"""What the tables hold, counted anew; and SQLite's own word on its file."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from time import monotonic

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine
from sqlalchemy.exc import DBAPIError

from server.states import ComparisonState, InstanceState, LeaseState, Outcome
from server.store.database.files import make_private
from server.store.database.presence import waited_for_lock
from server.store.database.schema import (
    OF_INSTANCE,
    comparisons,
    instances,
    leases,
    loop_workers,
    models,
    results,
    studies,
    tokens,
    workers,
)

#: Milliseconds that a look waits for a lock: a migration or a vacuum may be about to let go of it.
LOOK_MILLISECONDS = 500
#: What workers' requests change, and what they read besides. Not the other tables, whose locks cost
#: no worker anything, while a coordinator that is not ready is taken from all.
_CHANGED = (studies, workers, leases, instances, results, comparisons)
_READ = (tokens, loop_workers, models)


def studies_by_age(connection: Connection) -> list[str]:
    """Return the ids of all studies, whatever else of them can be read."""
    query = sa.select(studies.c.id).order_by(studies.c.created_at, studies.c.id)
    return list(connection.scalars(query))


def count(connection: Connection, study_id: str) -> dict[str, int]:
    """Count what a study's tables hold.

    "begun", "leased" and "done" instances; "results", "ok" ones among them and the "last" one's
    number; results "matched" by an instance that is done; instances "unheld" and second opinions
    "unasked", that is held by a lease that has ended; rows "mixed", that is shared by kinds of
    machines.
    """
    of_study = instances.c.study_id == study_id
    states = sa.select(instances.c.state, sa.func.count()).where(of_study)
    found, ok, last = connection.execute(
        sa.select(
            sa.func.count(),
            sa.func.count().filter(results.c.outcome == Outcome.OK),
            sa.func.max(results.c.seq),
        ).where(results.c.study_id == study_id)
    ).one()
    matched = (
        sa.select(sa.func.count())
        .select_from(instances.join(results, OF_INSTANCE))
        .where(of_study, instances.c.state == InstanceState.DONE)
    )
    mixed = sa.select(instances.c.row).where(of_study).group_by(instances.c.row)
    mixed = mixed.having(sa.func.count(instances.c.host_class.distinct()) > 1)
    by_state: dict[str, int] = dict(connection.execute(states.group_by(instances.c.state)).all())
    return {
        "begun": sum(by_state.values()),
        "leased": by_state.get(InstanceState.LEASED, 0),
        "done": by_state.get(InstanceState.DONE, 0),
        "results": found,
        "ok": ok,
        "last": last or 0,
        "matched": connection.scalar(matched) or 0,
        "unheld": _held_by_none(connection, instances, study_id, InstanceState.LEASED),
        "unasked": _held_by_none(connection, comparisons, study_id, ComparisonState.LEASED),
        "mixed": len(connection.execute(mixed).all()),
    }


def _held_by_none(connection: Connection, table: sa.Table, study_id: str, state: str) -> int:
    """Return how many rows of a table are leased under no open lease."""
    query = (
        sa.select(sa.func.count())
        .select_from(table.outerjoin(leases, leases.c.id == table.c.lease_id))
        .where(
            table.c.study_id == study_id,
            table.c.state == state,
            sa.or_(leases.c.state.is_(None), leases.c.state != LeaseState.OPEN),
        )
    )
    return connection.scalar(query) or 0


def file_faults(connection: Connection) -> Iterator[str]:
    """Yield what SQLite finds wrong with its file, a sentence each; nothing elsewhere."""
    if connection.dialect.name != "sqlite":
        return
    for (said,) in connection.exec_driver_sql("PRAGMA integrity_check"):
        if said != "ok":
            yield f"the file is damaged: {said}"
    for row in connection.exec_driver_sql("PRAGMA foreign_key_check"):
        yield f"table {row[0]} refers to something in {row[2]} that is not there"


def damage(connection: Connection, *, seconds: float) -> str | None:
    """Return the first that SQLite finds wrong with its file in so many seconds; None: nothing."""
    if connection.dialect.name != "sqlite":
        return None
    deadline = monotonic() + seconds
    driver = connection.connection.driver_connection
    assert isinstance(driver, sqlite3.Connection)
    # So often as to cost nothing, and yet many times a second.
    driver.set_progress_handler(lambda: monotonic() > deadline, 1_000)
    try:
        said = _first_fault(driver)
    finally:
        driver.set_progress_handler(None, 0)
    return None if said is not None and "interrupted" in said else said


def _first_fault(driver: sqlite3.Connection) -> str | None:
    try:
        said = str(driver.execute("PRAGMA quick_check(1)").fetchone()[0])
    except sqlite3.DatabaseError as error:
        said = str(error)
    return None if said == "ok" else said


def what_is_locked(connection: Connection) -> str | None:
    """Say that somebody keeps tables locked that workers need; None: nobody does.

    By taking, until the transaction ends, the locks that writing or reading a row takes on its
    table. They hinder nobody who only does that. Of SQLite's one lock whoever may write knows
    already.
    """
    if connection.dialect.name == "sqlite":
        return None
    connection.exec_driver_sql(f"SET LOCAL lock_timeout = {LOOK_MILLISECONDS}")
    for tables, mode in ((_CHANGED, "ROW EXCLUSIVE"), (_READ, "ACCESS SHARE")):
        names = ", ".join(table.name for table in tables)
        try:
            with connection.begin_nested():
                connection.exec_driver_sql(f"LOCK TABLE {names} IN {mode} MODE")
        except DBAPIError as error:
            if not waited_for_lock(error):
                raise
            return f"another session keeps a table locked ({names})"
    return None


def write_nothing_new(connection: Connection) -> None:
    """Write what is there already, which takes a page of the disk as anything else does."""
    connection.exec_driver_sql("UPDATE alembic_version SET version_num = version_num")


def copy(engine: Engine, path: Path) -> None:
    """Copy a SQLite database to `path` while it is in use; the copy is as of one moment.

    Raises:
        sqlite3.DatabaseError: it has damaged pages, which a copy would have, too; none is kept.
        OSError, sqlite3.OperationalError: the copy cannot be written.
    """
    partial = path.with_name(path.name + ".partial")
    partial.unlink(missing_ok=True)
    source = engine.raw_connection()
    try:
        make_private(partial)
        target = sqlite3.connect(partial)
        with closing(target):
            driver = source.driver_connection
            assert isinstance(driver, sqlite3.Connection)
            driver.backup(target)
            fault = _first_fault(target)
        if fault is not None:
            raise sqlite3.DatabaseError(fault)
        partial.replace(path)
    finally:
        source.close()
        partial.unlink(missing_ok=True)
