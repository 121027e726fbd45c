"""Is the database whole? What the coordinator promises, counted anew from the tables."""

import hashlib
import sqlite3
from collections.abc import Iterator
from pathlib import Path

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine

from server.errors import ConflictError, NotFoundError
from server.logic.close_loops import FILES, CloseLoop
from server.logic.study import Study
from server.store import close_loops, sessions, studies
from server.store.engine import reading
from server.store.schema import close_loop_parts, comparisons, instances, leases, results


def faults(engine: Engine) -> list[str]:
    """Return what is wrong with the database, a sentence each; none if it is whole."""
    with reading(engine) as connection:
        found = list(_file_faults(connection))
        for job in close_loops.every(connection):
            found += [f"close-loop {job.id}: {f}" for f in _close_loop_faults(connection, job)]
        ids = connection.scalars(sa.text("SELECT id FROM studies ORDER BY created_at, id")).all()
        for study_id in ids:
            study = studies.find(connection, str(study_id))
            found += [f"study {study.id}: {fault}" for fault in _study_faults(connection, study)]
    return found + list(_session_faults(engine))


def back_up(engine: Engine, path: Path) -> None:
    """Copy a SQLite database while it is in use; the copy is as of one moment.

    Raises:
        ConflictError: the file exists, or the database is not SQLite.
    """
    if engine.dialect.name != "sqlite":
        raise ConflictError("this is a PostgreSQL database: back it up with pg_dump")
    if path.exists():
        raise ConflictError(f"{path} exists: name a new file")
    partial = path.with_name(path.name + ".partial")
    partial.unlink(missing_ok=True)
    source = engine.raw_connection()
    try:
        copy = sqlite3.connect(partial)
        with copy:
            driver = source.driver_connection
            assert isinstance(driver, sqlite3.Connection)
            driver.backup(copy)
        copy.close()
        partial.replace(path)
    finally:
        source.close()
        partial.unlink(missing_ok=True)


def _file_faults(connection: Connection) -> Iterator[str]:
    if connection.dialect.name != "sqlite":
        return
    for (said,) in connection.exec_driver_sql("PRAGMA integrity_check"):
        if said != "ok":
            yield f"the file is damaged: {said}"
    for row in connection.exec_driver_sql("PRAGMA foreign_key_check"):
        yield f"table {row[0]} refers to something in {row[2]} that is not there"


def _session_faults(engine: Engine) -> Iterator[str]:
    """Yield whose file is not what it was; read in parts, each in a transaction of its own."""
    for session in sessions.every(engine):
        digest = hashlib.sha256()
        try:
            for part in sessions.archive(engine, session):
                digest.update(part)
        except NotFoundError:
            # A part is missing, unless the session was deleted since it was listed.
            if sessions.by_digest(engine, session.sha256) is None:
                continue
        if digest.hexdigest() != session.sha256:
            yield f"session {session.id}: its file is not the one that was uploaded"


def _close_loop_faults(connection: Connection, job: CloseLoop) -> Iterator[str]:
    """Yield what contradicts: a job's state and its lease, its report and its files."""
    query = sa.select(close_loop_parts.c.file).where(close_loop_parts.c.close_loop_id == job.id)
    files = set(connection.scalars(query.distinct()))
    if files != (set(FILES) if job.state == "done" else set()):
        yield f"it is {job.state} with {len(files)} of {len(FILES)} files"
    for what, there, state in (
        ("an end of its lease", job.expires_at is not None, "running"),
        ("a verdict", job.verdict is not None, "done"),
        ("a fault", job.fault is not None, "failed"),
    ):
        if there != (job.state == state):
            yield f"it is {job.state} with{'' if there else 'out'} {what}"
    under_way = [attempt for attempt in job.attempts if attempt.ended is None]
    if len(under_way) != (job.state == "running"):
        yield f"it is {job.state} with {len(under_way)} attempts under way"


def _study_faults(connection: Connection, study: Study) -> Iterator[str]:
    """Yield what contradicts: counters and tables, instances and results."""
    of_study = instances.c.study_id == study.id
    states = {
        row.state: row.n
        for row in connection.execute(
            sa.select(instances.c.state, sa.func.count().label("n"))
            .where(of_study)
            .group_by(instances.c.state)
        )
    }
    count, ok, last = connection.execute(
        sa.select(
            sa.func.count(),
            sa.func.count().filter(results.c.outcome == "ok"),
            sa.func.max(results.c.seq),
        ).where(results.c.study_id == study.id)
    ).one()
    same_place = sa.and_(
        results.c.study_id == instances.c.study_id,
        results.c.row == instances.c.row,
        results.c.position == instances.c.position,
    )
    matched = connection.scalar(
        sa.select(sa.func.count())
        .select_from(instances.join(results, same_place))
        .where(of_study, instances.c.state == "done")
    )
    unheld = connection.scalar(
        sa.select(sa.func.count())
        .select_from(instances.outerjoin(leases, leases.c.id == instances.c.lease_id))
        .where(
            of_study,
            instances.c.state == "leased",
            sa.or_(leases.c.state.is_(None), leases.c.state != "open"),
        )
    )
    unasked = connection.scalar(
        sa.select(sa.func.count())
        .select_from(comparisons.outerjoin(leases, leases.c.id == comparisons.c.lease_id))
        .where(
            comparisons.c.study_id == study.id,
            comparisons.c.state == "leased",
            sa.or_(leases.c.state.is_(None), leases.c.state != "open"),
        )
    )
    mixed = sa.select(instances.c.row).where(of_study).group_by(instances.c.row)
    mixed = mixed.having(sa.func.count(instances.c.host_class.distinct()) > 1)
    for what, counted, expected in (
        ("instances of begun rows", sum(states.values()), study.handed_out),
        ("leased instances", states.get("leased", 0), study.leased),
        ("results", count, study.result_count),
        ("ok results", ok, study.ok_count),
        ("failed results", count - ok, sum(study.failures.values())),
        ("the last result's number", last or 0, study.result_count),
        ("instances that are done", states.get("done", 0), study.result_count),
        ("results of instances that are done", matched, study.result_count),
        ("instances held by a lease that has ended", unheld, 0),
        ("second opinions held by a lease that has ended", unasked, 0),
        ("rows shared by kinds of machines", len(connection.execute(mixed).all()), 0),
    ):
        if counted != expected:
            yield f"{what}: {counted}, where {expected} would be right"
    if (study.state == "complete") != (count == study.plan.instances) and (
        study.state != "cancelled"
    ):
        yield f"it is {study.state} with {count} of {study.plan.instances} results"
