"""Jobs on sessions, to close the loop or to interpret them, and the files of their reports."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import Any, BinaryIO

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine

from server.errors import NotFoundError
from server.records import Attempt, CloseLoopJob
from server.states import CloseLoopState, JobKind
from server.store.database import parts
from server.store.database.schema import close_loop_parts, close_loops

_RUNNING = close_loops.c.state == CloseLoopState.RUNNING


def add(connection: Connection, job: CloseLoopJob) -> None:
    """Store a new job."""
    connection.execute(sa.insert(close_loops).values(_row(job)))


def find(
    connection: Connection, job_id: str, *, kind: JobKind | None = None, lock: bool = False
) -> CloseLoopJob:
    """Return a job; NotFoundError if there is none of that id, and of a `kind` if one is wanted."""
    found = _select(connection, close_loops.c.id == job_id, lock=lock)
    if not found or kind not in (None, found[0].kind):
        raise NotFoundError(f"there is no {kind or JobKind.CLOSE_LOOP} {job_id!r}")
    return found[0]


def every(connection: Connection) -> list[CloseLoopJob]:
    """Return all jobs, oldest first."""
    return _select(connection, sa.true())


def of_session(connection: Connection, session_id: str) -> list[CloseLoopJob]:
    """Return the jobs of a session, oldest first."""
    return _select(connection, close_loops.c.session_id == session_id)


def waiting(connection: Connection, *, lock: bool = False) -> list[CloseLoopJob]:
    """Return the jobs that wait for a worker, oldest first."""
    return _select(connection, close_loops.c.state == CloseLoopState.WAITING, lock=lock)


def expired(connection: Connection, *, now: float, lock: bool = False) -> list[CloseLoopJob]:
    """Return the jobs whose lease has run out, oldest first."""
    return _select(connection, sa.and_(_RUNNING, close_loops.c.expires_at <= now), lock=lock)


def extend_open(connection: Connection, *, until: float) -> None:
    """Let every job's lease last until a moment."""
    _select(connection, _RUNNING, lock=True)
    connection.execute(sa.update(close_loops).where(_RUNNING).values(expires_at=until))


def save(connection: Connection, job: CloseLoopJob) -> None:
    """Write back a job that was read, locked, in the same transaction."""
    connection.execute(sa.update(close_loops).where(close_loops.c.id == job.id).values(_row(job)))


def add_files(connection: Connection, job_id: str, files: Mapping[str, BinaryIO]) -> None:
    """Store the files of a report, each from where it stands."""
    for name, file in files.items():
        parts.write(connection, close_loop_parts, _file(job_id, name), file)


def file_size(connection: Connection, job_id: str, file: str) -> int:
    """Return how many bytes a file of a report has; 0 if there is none."""
    return parts.size(connection, close_loop_parts, _file(job_id, file))


def read_file(engine: Engine, job_id: str, file: str, size: int) -> Iterator[bytes]:
    """Yield a file of a report, a part at a time, each in a transaction of its own."""
    return parts.read(engine, close_loop_parts, _file(job_id, file), size)


def files(connection: Connection, job_id: str) -> set[str]:
    """Return the names of the files that a job's report has."""
    query = sa.select(close_loop_parts.c.file).where(close_loop_parts.c.close_loop_id == job_id)
    return set(connection.scalars(query.distinct()))


def delete_of_session(connection: Connection, session_id: str) -> None:
    """Remove the jobs of a session with their reports."""
    of_session = sa.select(close_loops.c.id).where(close_loops.c.session_id == session_id)
    # Whoever hands in a report now has done so, or finds no job.
    _select(connection, close_loops.c.session_id == session_id, lock=True)
    connection.execute(
        sa.delete(close_loop_parts).where(close_loop_parts.c.close_loop_id.in_(of_session))
    )
    connection.execute(sa.delete(close_loops).where(close_loops.c.session_id == session_id))


def _file(job_id: str, file: str) -> dict[str, str]:
    return {"close_loop_id": job_id, "file": file}


def _select(
    connection: Connection, where: sa.ColumnElement[bool], *, lock: bool = False
) -> list[CloseLoopJob]:
    query = sa.select(close_loops).where(where)
    query = query.order_by(close_loops.c.created_at, close_loops.c.id)
    jobs = []
    for row in connection.execute(query.with_for_update() if lock else query):
        attempts = tuple(Attempt(**entry) for entry in row.attempts)
        known = {"state": CloseLoopState(row.state), "kind": JobKind(row.kind)}
        jobs.append(CloseLoopJob(**{**row._mapping, "attempts": attempts, **known}))
    return jobs


def _row(job: CloseLoopJob) -> dict[str, Any]:
    return {**vars(job), "attempts": [asdict(attempt) for attempt in job.attempts]}
