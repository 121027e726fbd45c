"""Jobs that close the loop on sessions: asked for, leased to workers, and their files."""

from collections.abc import Iterator, Mapping
from typing import Any, BinaryIO
from uuid import uuid4

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine

from server.errors import ConflictError, NotFoundError
from server.logic.close_loops import (
    BAD_SESSION,
    CloseLoop,
    Proof,
    after_attempt,
    answers,
    attempts_from_json,
    attempts_to_json,
    failed,
    finished,
    handed_out,
    lease_of,
    released,
)
from server.logic.leases import (
    expiry,
    objection_to_release,
    objection_to_renewal,
    objection_to_results,
)
from server.store import loop_workers, parts, sessions, workers
from server.store.engine import reading, writing
from server.store.schema import close_loop_parts, close_loops
from server.store.sessions import Session


def create(engine: Engine, session_id: str, *, code: str, now: float) -> tuple[CloseLoop, bool]:
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
        for known in _select(connection, close_loops.c.session_id == session_id):
            if answers(known, code):
                return known, False
        job = CloseLoop(id=uuid4().hex[:12], session_id=session_id, state="waiting", created_at=now)
        connection.execute(sa.insert(close_loops).values(_row(job)))
    return job, True


def get(engine: Engine, job_id: str) -> CloseLoop:
    """Return a job; NotFoundError if there is none of that id."""
    with reading(engine) as connection:
        return find(connection, job_id)


def find(connection: Connection, job_id: str, *, lock: bool = False) -> CloseLoop:
    """Return a job within a transaction; NotFoundError if there is none of that id."""
    found = _select(connection, close_loops.c.id == job_id, lock=lock)
    if not found:
        raise NotFoundError(f"there is no close-loop {job_id!r}")
    return found[0]


def every(connection: Connection) -> list[CloseLoop]:
    """Return all jobs, oldest first."""
    return _select(connection, sa.true())


def grant(
    engine: Engine,
    *,
    worker: str,
    host: str,
    versions: Mapping[str, str],
    tags: tuple[str, ...],
    now: float,
    ttl: float,
) -> tuple[CloseLoop, Session] | None:
    """Lease the oldest waiting job to a worker; None if there is none for it.

    A job that went wrong on its host goes to another one, if one is at work.
    """
    with reading(engine) as connection:
        waiting = connection.scalar(
            sa.select(sa.literal(1)).where(close_loops.c.state == "waiting").limit(1)
        )
        noted = loop_workers.is_noted(connection, worker, now=now)
    if waiting is None and noted:
        return None
    with writing(engine) as connection:
        workers.introduce(connection, worker, host=host, versions=versions, tags=tags, now=now)
        loop_workers.note(connection, worker, now=now)
        candidates = _select(connection, close_loops.c.state == "waiting", lock=True)
        if not candidates:
            return None
        others = loop_workers.others_at_work(connection, host=host, now=now)
        for candidate in candidates:
            if candidate.avoid == host and others:
                continue
            job = handed_out(
                candidate, lease=uuid4().hex, worker=worker, host=host, now=now, ttl=ttl
            )
            _save(connection, job)
            return job, sessions.find(connection, job.session_id)
    return None


def renew(
    engine: Engine,
    job_id: str,
    *,
    lease: str,
    fence: int,
    progress: str | None,
    now: float,
    ttl: float,
) -> float:
    """Extend a job's lease, note what its worker is at, and return when it expires now.

    Raises:
        NotFoundError: there is no such job; its session may have been deleted.
        ConflictError: the lease has ended, or never was the bearer's.
    """
    with writing(engine) as connection:
        job = find(connection, job_id, lock=True)
        held = lease_of(job, lease)
        objection = objection_to_renewal(held, fence=fence, now=now)
        if held is None or objection is not None:
            raise ConflictError(f"lease {lease!r} cannot be renewed: {objection}")
        changes: dict[str, Any] = {"expires_at": expiry(now, ttl)}
        if progress is not None:
            changes["progress"] = progress
        connection.execute(sa.update(close_loops).where(close_loops.c.id == job_id).values(changes))
        workers.heard_from(connection, held.worker, now=now)
        loop_workers.note(connection, held.worker, now=now)
    return expiry(now, ttl)


def release(engine: Engine, job_id: str, *, lease: str, fence: int) -> None:
    """Take a job back unharmed; does nothing if its lease has ended; raises as `renew` does."""
    with writing(engine) as connection:
        job = find(connection, job_id, lock=True)
        held = lease_of(job, lease)
        objection = objection_to_release(held, fence=fence)
        if held is None or objection is not None:
            raise ConflictError(f"lease {lease!r} cannot be released: {objection}")
        if held.state == "open":
            _save(connection, released(job))


def require_holder(engine: Engine, job_id: str, proof: Proof) -> None:
    """Raise as `hand_in` does, before anything is read that may be large."""
    with reading(engine) as connection:
        _require_holder(find(connection, job_id), proof)


def hand_in(
    engine: Engine,
    job_id: str,
    files: Mapping[str, BinaryIO],
    *,
    proof: Proof,
    code: str,
    verdict: str,
    now: float,
) -> bool:
    """Store a job's report; False if it has one: the first stays.

    A lease that has expired is no objection while there is no report.

    Raises:
        NotFoundError: there is no such job.
        ConflictError: the lease never was the bearer's.
    """
    with writing(engine) as connection:
        job = find(connection, job_id, lock=True)
        _require_holder(job, proof)
        if job.state == "done":
            return False
        for name, file in files.items():
            parts.write(connection, close_loop_parts, {"close_loop_id": job_id, "file": name}, file)
        _save(connection, finished(job, proof.lease, code=code, verdict=verdict, now=now))
        workers.heard_from(connection, proof.worker, now=now)
        loop_workers.note(connection, proof.worker, now=now)
    return True


def fail(
    engine: Engine,
    job_id: str,
    *,
    proof: Proof,
    outcome: str,
    reason: str,
    where: Mapping[str, str | int | None],
    now: float,
) -> bool:
    """Count an attempt that failed; False if it no longer counts; raises as `hand_in` does.

    Args:
        engine: where.
        job_id: which job.
        proof: under which lease it was attempted.
        outcome: "bad_session", which is final, or a key of BUDGETS.
        reason: a sentence.
        where: file, column and line of what is wrong with the session.
        now: seconds, UTC epoch.
    """
    with writing(engine) as connection:
        job = find(connection, job_id, lock=True)
        _require_holder(job, proof)
        workers.heard_from(connection, proof.worker, now=now)
        if job.current is None or job.current.lease != proof.lease:
            return False
        if outcome == BAD_SESSION:
            after = failed(job, outcome=outcome, detail=reason, where=where, now=now)
        else:
            after = after_attempt(job, cause=outcome, reason=reason, now=now)
        _save(connection, after)
    return True


def reap(engine: Engine, *, now: float) -> int:
    """Take back what silent workers hold, as lost; returns how many jobs that were."""
    run_out = sa.and_(close_loops.c.state == "running", close_loops.c.expires_at <= now)
    with reading(engine) as connection:
        if connection.scalar(sa.select(sa.literal(1)).where(run_out).limit(1)) is None:
            return 0
    with writing(engine) as connection:
        lost = _select(connection, run_out, lock=True)
        for job in lost:
            reason = f"worker {job.attempts[-1].worker} fell silent"
            _save(connection, after_attempt(job, cause="lost", reason=reason, now=now))
    return len(lost)


def excuse_silence(engine: Engine, *, now: float, ttl: float) -> None:
    """Let every lease end a ttl from now: see `server.store.queue.excuse_silence`."""
    with writing(engine) as connection:
        connection.execute(
            sa.update(close_loops)
            .where(close_loops.c.state == "running")
            .values(expires_at=expiry(now, ttl))
        )


def file_size(engine: Engine, job: CloseLoop, file: str) -> int:
    """Return how many bytes a file of a report has; NotFoundError if there is no report yet."""
    with reading(engine) as connection:
        size = parts.size(connection, close_loop_parts, {"close_loop_id": job.id, "file": file})
    if not size:
        raise NotFoundError(f"close-loop {job.id} is {job.state}: there is no {file}")
    return size


def read_file(engine: Engine, job: CloseLoop, file: str, size: int) -> Iterator[bytes]:
    """Yield a file of a report, a part at a time."""
    return parts.read(engine, close_loop_parts, {"close_loop_id": job.id, "file": file}, size)


def _require_holder(job: CloseLoop, proof: Proof) -> None:
    held = lease_of(job, proof.lease)
    if held is None:
        raise ConflictError(f"close-loop {job.id} was never leased as {proof.lease!r}")
    objection = objection_to_results(held, fence=proof.fence, worker=proof.worker)
    if objection is not None:
        raise ConflictError(f"nothing can be handed in under lease {proof.lease!r}: {objection}")


def _select(
    connection: Connection, where: sa.ColumnElement[bool], *, lock: bool = False
) -> list[CloseLoop]:
    query = sa.select(close_loops).where(where)
    query = query.order_by(close_loops.c.created_at, close_loops.c.id)
    rows = connection.execute(query.with_for_update() if lock else query).all()
    return [
        CloseLoop(**{**row._mapping, "attempts": attempts_from_json(row.attempts)}) for row in rows
    ]


def _save(connection: Connection, job: CloseLoop) -> None:
    connection.execute(sa.update(close_loops).where(close_loops.c.id == job.id).values(_row(job)))


def _row(job: CloseLoop) -> dict[str, Any]:
    return {**vars(job), "attempts": attempts_to_json(job.attempts)}
