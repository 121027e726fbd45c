"""Transactions of the many workers: those that wait for their turn together share one.

A transaction on SQLite costs more than what most requests do in it, and handing it from thread to
thread as much again. So one thread does all of them, and a commit acknowledges all that it holds.
On PostgreSQL, where every transaction waits for the server most of the time, each has a thread.
"""

import asyncio
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from sqlalchemy.engine import Connection, Engine

from server.store.engine import writing

T = TypeVar("T")

#: What is to be done in a transaction; done again in another one if that one fails.
Job = Callable[[Connection], T]


class Turns:
    """Does jobs in transactions that write, off the event loop that asks for them."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._shared = engine.dialect.name == "sqlite"
        self._thread = ThreadPoolExecutor(1 if self._shared else None, "turns")
        self._waiting: list[tuple[Job[Any], asyncio.Future[Any]]] = []
        self._serving: asyncio.Task[None] | None = None

    async def __call__(self, job: Job[T]) -> T:
        """Do a job in a transaction; return what it returned, or raise what it raised.

        When this returns the transaction is committed.
        """
        loop = asyncio.get_running_loop()
        if not self._shared:
            return await loop.run_in_executor(self._thread, _alone, self._engine, job)
        done: asyncio.Future[T] = loop.create_future()
        self._waiting.append((job, done))
        if self._serving is None or self._serving.done():
            self._serving = loop.create_task(self._serve())
        return await done

    def close(self) -> None:
        """Wait for what is under way; nothing can be done afterwards."""
        self._thread.shutdown()

    async def _serve(self) -> None:
        """Do what waits, until nothing does."""
        loop = asyncio.get_running_loop()
        while self._waiting:
            turn, self._waiting = self._waiting, []
            jobs = [job for job, _ in turn]
            outcomes = await loop.run_in_executor(self._thread, together, self._engine, jobs)
            for (_, done), (result, error) in zip(turn, outcomes, strict=True):
                if done.cancelled():
                    continue
                if error is None:
                    done.set_result(result)
                else:
                    done.set_exception(error)


def together(
    engine: Engine, jobs: Sequence[Job[Any]]
) -> list[tuple[Any, None] | tuple[None, Exception]]:
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
    return [outcome for job in jobs for outcome in together(engine, [job])]


def _alone(engine: Engine, job: Job[T]) -> T:
    with writing(engine) as connection:
        return job(connection)
