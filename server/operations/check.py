"""Is the database whole? What the coordinator promises, counted anew from the tables."""

import hashlib
import sqlite3
from collections.abc import Iterator
from errno import ENOSPC
from pathlib import Path

from sqlalchemy.engine import Connection, Engine
from sqlalchemy.exc import DBAPIError

from analysis.closeloop.contract import REPORT_FILES
from analysis.interpretation.contract import REPORT_FILES as INTERPRETATION_FILES
from server.errors import ConflictError, DamagedError, NotFoundError, WrongPathError
from server.records import CloseLoopJob, Study
from server.states import CloseLoopState, JobKind, StudyState
from server.store import audit, close_loops, sessions
from server.store.database.engine import create_engine, reading
from server.store.study import studies


def faults(engine: Engine) -> list[str]:
    """Return what is wrong with the database, a sentence each; none if it is whole."""
    with reading(engine) as connection:
        found = list(audit.file_faults(connection))
        for job in close_loops.every(connection):
            found += [f"{job.kind} {job.id}: {f}" for f in _close_loop_faults(connection, job)]
        for study_id in audit.studies_by_age(connection):
            study = studies.find(connection, study_id)
            found += [f"study {study.id}: {fault}" for fault in _study_faults(connection, study)]
    return found + list(_session_faults(engine))


def refuse_damage(url: str, *, seconds: float) -> None:
    """Look for damaged pages of a SQLite file, for so many seconds at most.

    Raises:
        DamagedError: there is one.
    """
    engine = create_engine(url)
    try:
        with reading(engine) as connection:
            found = audit.damage(connection, seconds=seconds)
    except DBAPIError as error:
        # It is too badly damaged to be looked at.
        found = str(error.orig)
        if "malformed" not in found:
            raise
    finally:
        engine.dispose()
    if found is not None:
        raise DamagedError(
            f"the file of the database is damaged ({' '.join(found.split())}): `rehyb db check` "
            "looks at all of it; go back to a copy of `rehyb db backup` by `rehyb db restore`"
        )


def back_up(engine: Engine, path: Path) -> None:
    """Copy a SQLite database while it is in use; the copy is as of one moment.

    Raises:
        ConflictError: the database is not SQLite, or there is no room.
        WrongPathError: the file exists, or cannot be where it is to be.
        DamagedError: it has damaged pages.
    """
    if engine.dialect.name != "sqlite":
        raise ConflictError("this is a PostgreSQL database: back it up with pg_dump")
    if path.exists():
        raise WrongPathError(
            f"{path} is a folder: name a file in it"
            if path.is_dir()
            else f"{path} exists: name a new file"
        )
    try:
        audit.copy(engine, path)
    except (OSError, sqlite3.OperationalError) as error:
        full = getattr(error, "errno", None) == ENOSPC or "full" in str(error)
        raise (ConflictError if full else WrongPathError)(
            f"the copy {path.absolute()} cannot be written ({error}): name a file in a folder that "
            "is there, where you may write and room is"
        ) from error
    except sqlite3.DatabaseError as error:
        raise DamagedError(
            f"the file of the database is damaged ({' '.join(str(error).split())}), as its copy "
            "would be: none is kept; go back to an earlier one by `rehyb db restore`"
        ) from error


def _session_faults(engine: Engine) -> Iterator[str]:
    """Yield whose file is not what it was; read in parts, each in a transaction of its own."""
    with reading(engine) as connection:
        every = sessions.every(connection)
    for session in every:
        digest = hashlib.sha256()
        try:
            for part in sessions.archive(engine, session):
                digest.update(part)
        except NotFoundError:
            # A part is missing, unless the session was deleted since it was listed.
            with reading(engine) as connection:
                if sessions.by_digest(connection, session.sha256) is None:
                    continue
        if digest.hexdigest() != session.sha256:
            yield f"session {session.id}: its file is not the one that was uploaded"


def _close_loop_faults(connection: Connection, job: CloseLoopJob) -> Iterator[str]:
    """Yield what contradicts: a job's state and its lease, its report and its files."""
    files = close_loops.files(connection, job.id)
    wanted = REPORT_FILES if job.kind == JobKind.CLOSE_LOOP else INTERPRETATION_FILES
    if files != (set(wanted) if job.state == CloseLoopState.DONE else set()):
        yield f"it is {job.state} with {len(files)} of {len(wanted)} files"
    for what, there, state in (
        ("an end of its lease", job.expires_at is not None, CloseLoopState.RUNNING),
        ("a verdict", job.verdict is not None, CloseLoopState.DONE),
        ("a fault", job.fault is not None, CloseLoopState.FAILED),
    ):
        if there != (job.state == state):
            yield f"it is {job.state} with{'' if there else 'out'} {what}"
    under_way = [attempt for attempt in job.attempts if attempt.ended is None]
    if len(under_way) != (job.state == CloseLoopState.RUNNING):
        yield f"it is {job.state} with {len(under_way)} attempts under way"


def _study_faults(connection: Connection, study: Study) -> Iterator[str]:
    """Yield what contradicts: counters and tables, instances and results."""
    count = audit.count(connection, study.id)
    for what, counted, expected in (
        ("instances of begun rows", count["begun"], study.handed_out),
        ("leased instances", count["leased"], study.leased),
        ("results", count["results"], study.result_count),
        ("ok results", count["ok"], study.ok_count),
        ("failed results", count["results"] - count["ok"], sum(study.failures.values())),
        ("the last result's number", count["last"], study.result_count),
        ("instances that are done", count["done"], study.result_count),
        ("results of instances that are done", count["matched"], study.result_count),
        ("instances held by a lease that has ended", count["unheld"], 0),
        ("second opinions held by a lease that has ended", count["unasked"], 0),
        ("rows shared by kinds of machines", count["mixed"], 0),
    ):
        if counted != expected:
            yield f"{what}: {counted}, where {expected} would be right"
    if study.state == StudyState.CANCELLED:
        return
    if (study.state == StudyState.COMPLETE) != (count["results"] == study.plan.instances):
        yield f"it is {study.state} with {count['results']} of {study.plan.instances} results"
