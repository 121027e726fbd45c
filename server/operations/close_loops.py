"""Close-loop jobs: asked for, followed, and the files of their reports."""

from collections.abc import Iterator
from uuid import uuid4

from sqlalchemy.engine import Engine

from server.errors import NotFoundError
from server.logic.close_loops import answers
from server.logic.hosts import GONE_SECONDS
from server.records import CloseLoopJob
from server.states import CloseLoopState
from server.store import close_loops, sessions, workers
from server.store.database.engine import reading, writing


def create(engine: Engine, session_id: str, *, code: str, now: float) -> tuple[CloseLoopJob, bool]:
    """Ask for the loop to be closed on a session.

    Args:
        engine: where.
        session_id: on which.
        code: digest of the code that is asked to; what it has found before is not computed again.
        now: seconds, UTC epoch.

    Returns:
        The job, and whether it is new.

    Raises:
        NotFoundError: there is no session of that id.
    """
    with writing(engine) as connection:
        sessions.find(connection, session_id, lock=True)
        for known in close_loops.of_session(connection, session_id):
            if answers(known, code):
                return known, False
        job = CloseLoopJob(
            id=uuid4().hex[:12],
            session_id=session_id,
            state=CloseLoopState.WAITING,
            created_at=now,
        )
        close_loops.add(connection, job)
    return job, True


def get(engine: Engine, job_id: str) -> CloseLoopJob:
    """Return a job; NotFoundError if there is none of that id."""
    with reading(engine) as connection:
        return close_loops.find(connection, job_id)


def standing(engine: Engine, job_id: str, *, now: float) -> tuple[CloseLoopJob, int]:
    """Return a job as `get` does, and how many workers can close loops now."""
    return get(engine, job_id), at_work(engine, now=now)


def at_work(engine: Engine, *, now: float) -> int:
    """Return how many workers that can close loops were heard from lately."""
    with reading(engine) as connection:
        return workers.closing_loops(connection, heard_after=now - GONE_SECONDS)


def file_size(engine: Engine, job: CloseLoopJob, file: str) -> int:
    """Return how many bytes a file of a report has; NotFoundError if there is no report yet."""
    with reading(engine) as connection:
        size = close_loops.file_size(connection, job.id, file)
    if not size:
        raise NotFoundError(f"close-loop {job.id} is {job.state}: there is no {file}")
    return size


def read_file(engine: Engine, job: CloseLoopJob, file: str, size: int) -> Iterator[bytes]:
    """Yield a file of a report, a part at a time."""
    return close_loops.read_file(engine, job.id, file, size)
