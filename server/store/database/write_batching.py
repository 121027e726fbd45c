"""Write batching: workers that wait at the same time share one transaction.

A transaction on SQLite takes less time than handing it to another thread, where it would get back
the interpreter's lock from the event loop at every statement. So the event loop does it itself,
unless it would have to wait for somebody, and a commit acknowledges all that it holds. On
PostgreSQL, where every transaction waits for the server most of the time, each has a thread.
"""

import asyncio
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Generic, TypeVar

from sqlalchemy.engine import Connection, Engine

from server.store.database.engine import ImmediateWriter, writing
from server.store.database.presence import is_busy

Q = TypeVar("Q")
A = TypeVar("A")

#: What a transaction does: it answers questions. Done again in another one if that one fails.
Serve = Callable[[Connection, Sequence[Q]], Sequence[A]]
#: What a question was answered, or what was raised.
Outcome = tuple[A, None] | tuple[None, Exception]

#: So often a transaction is one in which SQLite may copy its log into the file, which waits for the
#: disk.
UPKEEP = 100


class WriteBatches(Generic[Q, A]):
    """Answers in transactions that write, for an event loop that must not be kept waiting."""

    def __init__(self, engine: Engine, serve: Serve[Q, A]) -> None:
        self._engine = engine
        self._answer = serve
        self._shared = engine.dialect.name == "sqlite"
        self._threads = ThreadPoolExecutor(thread_name_prefix="writes")
        self._at_once = ImmediateWriter(engine)
        #: Questions, and what waits for their answers.
        self._waiting: list[tuple[Q, asyncio.Future[A]]] = []
        #: Whether somebody will see to what waits.
        self._seen_to = False
        self._count = 0

    async def __call__(self, question: Q) -> A:
        """Return what a question is answered in a transaction, or raise what is raised.

        When this returns the transaction is committed.
        """
        loop = asyncio.get_running_loop()
        if not self._shared:
            return await loop.run_in_executor(self._threads, self._alone, question)
        done: asyncio.Future[A] = loop.create_future()
        self._waiting.append((question, done))
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
        questions = [question for question, _ in batch]
        self._count += 1
        if self._count % UPKEEP:
            try:
                with self._at_once() as connection:
                    answers = self._answer(connection, questions)
                outcomes: list[Outcome[A]] = [(answer, None) for answer in answers]
            except Exception:
                # Somebody else writes, or a question is bad: nothing of it is in the database.
                pass
            else:
                self._seen_to = False
                _tell(batch, outcomes)
                return
        later = loop.run_in_executor(
            self._threads, run_batch, self._engine, self._answer, questions
        )
        later.add_done_callback(lambda done: self._resume(loop, batch, done.result()))

    def _resume(
        self,
        loop: asyncio.AbstractEventLoop,
        batch: Sequence[tuple[Q, asyncio.Future[A]]],
        outcomes: Sequence[Outcome[A]],
    ) -> None:
        """Answer a batch that a thread has done, and see to what came meanwhile."""
        _tell(batch, outcomes)
        _, error = outcomes[-1]
        if error is not None and is_busy(error):
            # Who came meanwhile waited, too, and would once more.
            _tell(self._waiting, [(None, error) for _ in self._waiting])
            self._waiting = []
        self._seen_to = bool(self._waiting)
        if self._waiting:
            loop.call_soon(self._serve, loop)

    def _alone(self, question: Q) -> A:
        with writing(self._engine) as connection:
            (answer,) = self._answer(connection, [question])
            return answer


def run_batch(engine: Engine, serve: Serve[Q, A], questions: Sequence[Q]) -> list[Outcome[A]]:
    """Answer in one transaction; if it fails, each in its own, so that none spoils the others.

    Unless somebody else keeps the file: each by itself would wait for as long.

    Returns:
        What each is answered, and what was raised instead.
    """
    try:
        with writing(engine) as connection:
            answers = serve(connection, questions)
        return [(answer, None) for answer in answers]
    except Exception as error:
        if len(questions) == 1 or is_busy(error):
            return [(None, error) for _ in questions]
    return [outcome for one in questions for outcome in run_batch(engine, serve, [one])]


def _tell(batch: Sequence[tuple[Q, asyncio.Future[A]]], outcomes: Sequence[Outcome[A]]) -> None:
    for (_, done), (answer, error) in zip(batch, outcomes, strict=True):
        if done.cancelled():
            continue
        if error is None:
            done.set_result(answer)  # type: ignore[arg-type]
        else:
            done.set_exception(error)
