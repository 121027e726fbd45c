"""Transactions of the many workers: those that wait for their turn together share one.

A transaction on SQLite costs more than what most requests do in it, and handing it from thread to
thread as much again. So one thread does all of them, and a commit acknowledges all that it holds.
On PostgreSQL, where every transaction waits for the server most of the time, each has a thread.
"""

import asyncio
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from queue import SimpleQueue
from threading import Thread
from typing import Any, TypeVar

from sqlalchemy.engine import Connection, Engine

from server.store.engine import Writer, writing

T = TypeVar("T")

#: What is to be done in a transaction; done again in another one if that one fails.
Job = Callable[[Connection], T]
#: Opens a transaction that writes.
Begin = Callable[[], AbstractContextManager[Connection]]
#: What a job returned, or what it raised.
Outcome = tuple[Any, None] | tuple[None, Exception]
#: A job and what waits for its outcome.
Waiting = tuple[Job[Any], asyncio.Future[Any]]


class Turns:
    """Does jobs in transactions that write, off the event loop that asks for them."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._turns = _SharedTurns(engine) if engine.dialect.name == "sqlite" else None
        self._threads = ThreadPoolExecutor(thread_name_prefix="turns")

    async def __call__(self, job: Job[T]) -> T:
        """Do a job in a transaction; return what it returned, or raise what it raised.

        When this returns the transaction is committed.
        """
        if self._turns is not None:
            return await self._turns.ask(job)
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._threads, _alone, self._engine, job)

    def close(self) -> None:
        """Wait for what is under way; nothing can be done afterwards."""
        if self._turns is not None:
            self._turns.close()
        self._threads.shutdown()


class _SharedTurns:
    """One thread that does all that waits in one transaction, then what came meanwhile."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._waiting: list[Waiting] = []
        #: Whether the thread has a turn, or will be given one before the event loop waits.
        self._busy = False
        # A future would be made and told for every turn, which takes longer than its transaction.
        self._turns: SimpleQueue[tuple[asyncio.AbstractEventLoop, list[Waiting]] | None]
        self._turns = SimpleQueue()
        self._thread: Thread | None = None

    async def ask(self, job: Job[T]) -> T:
        """Return what a job returned in a transaction that is committed."""
        loop = asyncio.get_running_loop()
        done: asyncio.Future[T] = loop.create_future()
        self._waiting.append((job, done))
        if not self._busy:
            self._busy = True
            # After all requests that have arrived by now.
            loop.call_soon(self._hand_over, loop)
        return await done

    def close(self) -> None:
        """End the thread when it has done what it has."""
        if self._thread is not None:
            self._turns.put(None)
            self._thread.join()

    def _hand_over(self, loop: asyncio.AbstractEventLoop) -> None:
        if self._thread is None:
            self._thread = Thread(target=self._serve, name="turns", daemon=True)
            self._thread.start()
        turn, self._waiting = self._waiting, []
        self._busy = bool(turn)
        if turn:
            self._turns.put((loop, turn))

    def _serve(self) -> None:
        begin = Writer(self._engine)
        while (given := self._turns.get()) is not None:
            loop, turn = given
            outcomes = together(begin, [job for job, _ in turn])
            loop.call_soon_threadsafe(self._answer, loop, turn, outcomes)
        begin.close()

    def _answer(
        self, loop: asyncio.AbstractEventLoop, turn: Sequence[Waiting], outcomes: Sequence[Outcome]
    ) -> None:
        self._hand_over(loop)
        for (_, done), (result, error) in zip(turn, outcomes, strict=True):
            if done.cancelled():
                continue
            if error is None:
                done.set_result(result)
            else:
                done.set_exception(error)


def together(begin: Begin, jobs: Sequence[Job[Any]]) -> list[Outcome]:
    """Do jobs in one transaction; if it fails, each in its own, so that none spoils the others.

    Returns:
        What each returned, and what it raised.
    """
    try:
        with begin() as connection:
            return [(job(connection), None) for job in jobs]
    except Exception as error:
        if len(jobs) == 1:
            return [(None, error)]
    return [outcome for job in jobs for outcome in together(begin, [job])]


def _alone(engine: Engine, job: Job[T]) -> T:
    with writing(engine) as connection:
        return job(connection)
