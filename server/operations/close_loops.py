"""Jobs on sessions: asked for and followed, leased to workers, and what these hand in."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, BinaryIO
from uuid import uuid4

from sqlalchemy.engine import Connection, Engine

from server.errors import ConflictError, NotFoundError
from server.logic import close_loops as life
from server.logic.fleet.hosts import GONE_SECONDS, host_class
from server.logic.fleet.leases import (
    expiry,
    objection_to_release,
    objection_to_renewal,
    objection_to_results,
)
from server.records import CloseLoopJob, Introduction, Session
from server.states import CloseLoopState, JobKind, LeaseState, Outcome
from server.store import close_loops, sessions
from server.store.database.engine import reading, writing
from server.store.fleet import workers
from server.store.fleet.turn_changes import Changes
from server.store.fleet.turns import at_once, turn_within


@dataclass(frozen=True, kw_only=True)
class Proof:
    """What a worker shows to speak for a job."""

    lease: str
    fence: int
    worker: str


def create(engine: Engine, session_id: str, *, code: str, now: float) -> tuple[CloseLoopJob, bool]:
    """Ask for the loop to be closed on a session.

    What `code`, a digest, has found before is not computed again.

    Returns:
        The job, and whether it is new.
    """
    with writing(engine) as connection:
        return _asked(connection, session_id, {code}, now, JobKind.CLOSE_LOOP, None)


def interpret(
    engine: Engine,
    session_id: str,
    options: Mapping[str, Any],
    *,
    code_of: Callable[[str], str],
    now: float,
) -> tuple[CloseLoopJob, bool]:
    """Ask for a session to be interpreted, as `create` does.

    Args:
        engine: the database.
        session_id: its id.
        options: {"known", "tolerance", "bank"}; without a bank any worker's will do.
        code_of: digest of the code with a bank: an answer of a bank that no worker has any more
            is none, unless none has a bank at all.
        now: the time.
    """
    with writing(engine) as connection:
        there = workers.banks(connection, heard_after=now - GONE_SECONDS)
        wanted = [options["bank"]] if options["bank"] else there
        codes = {code_of(bank) for bank in wanted} or None
        return _asked(connection, session_id, codes, now, JobKind.INTERPRETATION, options)


def _asked(
    connection: Connection,
    session_id: str,
    codes: set[str] | None,
    now: float,
    kind: JobKind,
    options: Mapping[str, Any] | None,
) -> tuple[CloseLoopJob, bool]:
    sessions.find(connection, session_id, lock=True)
    for known in reversed(close_loops.of_session(connection, session_id)):
        if life.answers(known, codes, kind, options):
            return known, False
    job = CloseLoopJob(
        id=uuid4().hex[:12],
        session_id=session_id,
        state=CloseLoopState.WAITING,
        created_at=now,
        kind=kind,
        options=options,
    )
    close_loops.add(connection, job)
    return job, True


def standing(
    engine: Engine, job_id: str, *, kind: JobKind | None = None, now: float
) -> tuple[CloseLoopJob, int]:
    """Return a job and how many workers there are for it now; NotFoundError if it is unknown."""
    with reading(engine) as connection:
        job = close_loops.find(connection, job_id, kind=kind)
        return job, _able(connection, job, now)


def at_work(engine: Engine, *, now: float) -> int:
    """Return how many workers that can close loops were heard from lately."""
    with reading(engine) as connection:
        return workers.closing_loops(connection, heard_after=now - GONE_SECONDS)


def able(engine: Engine, job: CloseLoopJob, *, now: float) -> int:
    """Return how many workers were heard from lately that a job is for."""
    with reading(engine) as connection:
        return _able(connection, job, now)


def banks(engine: Engine, *, now: float) -> list[str]:
    """Return the banks of workers that interpret and were heard from lately."""
    with reading(engine) as connection:
        return workers.banks(connection, heard_after=now - GONE_SECONDS)


def _able(connection: Connection, job: CloseLoopJob, now: float, but_on: str | None = None) -> int:
    since = now - GONE_SECONDS
    if job.kind == JobKind.CLOSE_LOOP:
        return workers.closing_loops(connection, heard_after=since, but_on=but_on)
    there = workers.banks(connection, heard_after=since, but_on=but_on)
    return sum(life.suits(job, bank) for bank in there)


def file_size(engine: Engine, job: CloseLoopJob, file: str) -> int:
    """Return how many bytes a file of a report has; NotFoundError if there is no report yet."""
    with reading(engine) as connection:
        size = close_loops.file_size(connection, job.id, file)
    if not size:
        raise NotFoundError(f"{job.kind} {job.id} is {job.state}: there is no {file}")
    return size


def read_file(engine: Engine, job: CloseLoopJob, file: str, size: int) -> Iterator[bytes]:
    """Yield a file of a report, a part at a time."""
    return close_loops.read_file(engine, job.id, file, size)


def grant(
    engine: Engine, worker: Introduction, *, bank: str | None = None, now: float, ttl: float
) -> tuple[CloseLoopJob, Session] | None:
    """Lease the oldest waiting job to a worker; None if there is none for it.

    A job that went wrong on its host goes to another one, if one is at work. A worker without a
    bank interprets nothing.
    """
    with reading(engine) as connection:
        waiting = any(life.suits(job, bank) for job in close_loops.waiting(connection))
        noted = life.is_noted(workers.close_loops_noted(connection, worker.id), now)
    if noted and not waiting:
        return None
    with writing(engine) as connection:
        # Whoever locks jobs and workers begins with jobs, the oldest first.
        candidates = close_loops.waiting(connection, lock=True)
        # Which models it has is told where instances are asked for.
        if (last := workers.find(connection, worker.id)) is not None:
            worker = replace(worker, models=last.models, refused=last.refused)
        known = Changes(workers=[(worker, host_class(worker.versions), 0)])
        at_once(turn_within(connection).write(known, None, None, now=now, end=False))
        workers.note_close_loops(connection, worker.id, bank=bank, now=now)
        for candidate in candidates:
            if not life.suits(candidate, bank):
                continue
            if candidate.avoid == worker.host and _able(connection, candidate, now, worker.host):
                continue
            job = life.handed_out(candidate, lease=uuid4().hex, worker=worker, now=now, ttl=ttl)
            close_loops.save(connection, job)
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
    until = expiry(now, ttl)
    with writing(engine) as connection:
        job = close_loops.find(connection, job_id, lock=True)
        held = life.lease_of(job, lease)
        objection = objection_to_renewal(held, fence=fence, now=now)
        if held is None or objection is not None:
            raise ConflictError(f"lease {lease!r} cannot be renewed: {objection}")
        said = job.progress if progress is None else progress
        close_loops.save(connection, replace(job, expires_at=until, progress=said))
        _heard_from(connection, held.worker, now)
    return until


def release(engine: Engine, job_id: str, *, lease: str, fence: int) -> None:
    """Take a job back unharmed; does nothing if its lease has ended; raises as `renew` does."""
    with writing(engine) as connection:
        job = close_loops.find(connection, job_id, lock=True)
        held = life.lease_of(job, lease)
        objection = objection_to_release(held, fence=fence)
        if held is None or objection is not None:
            raise ConflictError(f"lease {lease!r} cannot be released: {objection}")
        if held.state == LeaseState.OPEN:
            close_loops.save(connection, life.released(job))


def require_holder(engine: Engine, job_id: str, proof: Proof) -> JobKind:
    """Return a job's kind; raise as `hand_in` does, before anything is read that may be large."""
    with reading(engine) as connection:
        job = close_loops.find(connection, job_id)
        _require_holder(job, proof)
    return job.kind


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
        ConflictError: the lease never was the bearer's.
    """
    with _held(engine, job_id, proof) as (connection, job):
        if job.state == CloseLoopState.DONE:
            return False
        close_loops.add_files(connection, job_id, files)
        close_loops.save(
            connection, life.finished(job, proof.lease, code=code, verdict=verdict, now=now)
        )
        _heard_from(connection, proof.worker, now)
    return True


def fail(
    engine: Engine,
    job_id: str,
    *,
    proof: Proof,
    outcome: str,
    reason: str,
    where: Mapping[str, str | int | None] | None = None,
    now: float,
) -> bool:
    """Count an attempt that failed; False if it no longer counts; raises as `hand_in` does.

    Args:
        outcome: "bad_session", which is final, or a key of BUDGETS.
        where: file, column and line of what is wrong with the session.
    """
    with _held(engine, job_id, proof) as (connection, job):
        workers.heard_from(connection, proof.worker, now=now)
        if job.current is None or job.current.lease != proof.lease:
            return False
        if outcome == Outcome.BAD_SESSION:
            after = life.failed(job, outcome=outcome, detail=reason, where=where, now=now)
        else:
            after = life.after_attempt(job, cause=outcome, reason=reason, now=now)
        close_loops.save(connection, after)
    return True


def reap(engine: Engine, *, now: float) -> int:
    """Take back what silent workers hold, as lost; returns how many jobs that were."""
    with reading(engine) as connection:
        if not close_loops.expired(connection, now=now):
            return 0
    with writing(engine) as connection:
        lost = close_loops.expired(connection, now=now, lock=True)
        for job in lost:
            reason = f"worker {job.attempts[-1].worker} fell silent"
            after = life.after_attempt(job, cause=Outcome.LOST, reason=reason, now=now)
            close_loops.save(connection, after)
    return len(lost)


@contextmanager
def _held(engine: Engine, job_id: str, proof: Proof) -> Iterator[tuple[Connection, CloseLoopJob]]:
    """Open a transaction that has locked a job, for somebody who may speak for it."""
    with writing(engine) as connection:
        job = close_loops.find(connection, job_id, lock=True)
        _require_holder(job, proof)
        yield connection, job


def _require_holder(job: CloseLoopJob, proof: Proof) -> None:
    held = life.lease_of(job, proof.lease)
    if held is None:
        raise ConflictError(f"{job.kind} {job.id} was never leased as {proof.lease!r}")
    objection = objection_to_results(held, fence=proof.fence, worker=proof.worker)
    if objection is not None:
        raise ConflictError(f"nothing can be handed in under lease {proof.lease!r}: {objection}")


def _heard_from(connection: Connection, worker: str, now: float) -> None:
    workers.heard_from(connection, worker, now=now)
    workers.note_close_loops(connection, worker, now=now)
