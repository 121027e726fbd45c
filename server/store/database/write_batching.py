"""Write batching: the jobs of workers that wait at the same time share one transaction.

A transaction on SQLite takes less time than handing it to another thread, where it would get back
the interpreter's lock from the event loop at every statement. So the event loop does it itself,
unless it would have to wait for somebody, and a commit acknowledges all that it holds. On
PostgreSQL, where every transaction waits for the server most of the time, each has a thread.
"""

import asyncio
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from sqlalchemy.engine import Connection, Engine

from server.store.database.engine import ImmediateWriter, writing

T = TypeVar("T")

#: What a transaction does; done again in another one if that one fails.
Job = Callable[[Connection], T]
#: What a job returned, or what it raised.
Outcome = tuple[Any, None] | tuple[None, Exception]
#: A job and what waits for its outcome.
Waiting = tuple[Job[Any], asyncio.Future[Any]]

#: So often a transaction is one in which SQLite may copy its log into the file, which waits for the
#: disk.
UPKEEP = 100


class WriteBatches:
    """Does jobs in transactions that write, for an event loop that must not be kept waiting."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._shared = engine.dialect.name == "sqlite"
        self._threads = ThreadPoolExecutor(thread_name_prefix="writes")
        self._at_once = ImmediateWriter(engine)
        self._waiting: list[Waiting] = []
        #: Whether somebody will see to what waits.
        self._seen_to = False
        self._count = 0

    async def __call__(self, job: Job[T]) -> T:
        """Do a job in a transaction; return what it returned, or raise what it raised.

        When this returns the transaction is committed.
        """
        loop = asyncio.get_running_loop()
        if not self._shared:
            return await loop.run_in_executor(self._threads, _alone, self._engine, job)
        done: asyncio.Future[T] = loop.create_future()
        self._waiting.append((job, done))
        if not self._seen_to:
            self._seen_to = True
            # After all requests that have arrived by now: it is between the two calls that the loop
            # looks who else has sent one.
            loop.call_soon(loop.call_soon, self._serve, loop)
        return await done

    def close(self) -> None:
        """Wait for what is under way; nothing can be done afterwards."""
        self._threads.shutdown()
        self._at_once.close()

    def _serve(self, loop: asyncio.AbstractEventLoop) -> None:
        """Do what waits; in a thread if it does not work out at once, or may take long."""
        batch, self._waiting = self._waiting, []
        jobs = [job for job, _ in batch]
        self._count += 1
        if self._count % UPKEEP:
            try:
                with self._at_once() as connection:
                    outcomes: list[Outcome] = [(job(connection), None) for job in jobs]
            except Exception:
                # Somebody else writes, or a job fails: nothing of the batch is in the database.
                pass
            else:
                self._seen_to = False
                _answer(batch, outcomes)
                return
        later = loop.run_in_executor(self._threads, run_batch, self._engine, jobs)
        later.add_done_callback(lambda done: self._resume(loop, batch, done.result()))

    def _resume(
        self, loop: asyncio.AbstractEventLoop, batch: Sequence[Waiting], outcomes: Sequence[Outcome]
    ) -> None:
        """Answer a batch that a thread has done, and see to what came meanwhile."""
        _answer(batch, outcomes)
        self._seen_to = bool(self._waiting)
        if self._waiting:
            loop.call_soon(self._serve, loop)


def run_batch(engine: Engine, jobs: Sequence[Job[Any]]) -> list[Outcome]:
    """Do jobs in one transaction; if it fails, each in its own, so that none spoils the others.

    Returns:
        What each returned, and what it raised.
    """
    try:
        with writing(engine) as connection:
            return [(job(connection), None) for job in jobs]
    except Exception as error:
        if len(jobs) == 1:
            return [(None, error)]
    return [outcome for job in jobs for outcome in run_batch(engine, [job])]


def _answer(batch: Sequence[Waiting], outcomes: Sequence[Outcome]) -> None:
    for (_, done), (result, error) in zip(batch, outcomes, strict=True):
        if done.cancelled():
            continue
        if error is None:
            done.set_result(result)
        else:
            done.set_exception(error)


def _alone(engine: Engine, job: Job[T]) -> T:
    with writing(engine) as connection:
        return job(connection)
