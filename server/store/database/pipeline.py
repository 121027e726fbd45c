"""Statements that go to PostgreSQL together, for an event loop: it waits for nothing.

Each trip is one write and, nearly always, one read.

The driver's own pipelines send each statement by itself and look for answers in between, which
costs two system calls a statement. From a thread, as the driver needs it, each of them hands the
interpreter's lock to the event loop, which gives it back when it is done with what it does. Here a
trip is one write and, nearly always, one read.
"""

import asyncio
import os
from collections.abc import Sequence
from typing import Any

import psycopg
from psycopg.adapt import Transformer
from psycopg.pq import ExecStatus

from server.store.database.silence import (
    SILENT_SECONDS,
    TRIP_SECONDS,
    SilentError,
    place_of,
    why_given_up,
)
from server.threads import in_thread

Rows = list[tuple[Any, ...]]
#: A statement, in which %s stands for values, and its values.
Statement = tuple[str, Sequence[Any]]

_TRUTH = {True: b"t", False: b"f"}


class Pipeline:
    """A connection of the driver that does nothing but trips, one at a time.

    Nothing else may use the connection any more. It belongs to the event loop of its first trip.
    """

    def __init__(self, driver: "psycopg.Connection[Any]") -> None:
        self._raw = driver.pgconn
        self._place = place_of(driver.pgconn)
        # Of its own: that of a connection that is lost is closed before the event loop lets go.
        self._socket = os.dup(driver.pgconn.socket)
        self._failure: psycopg.OperationalError | None = None
        self._loading = Transformer(driver)
        #: What the server calls the statements that it has seen.
        self._names: dict[str, bytes] = {}
        self._loop: asyncio.AbstractEventLoop | None = None
        self._arrival: asyncio.Future[None] | None = None
        #: When the server is looked at, if the trip under way takes long; and who does.
        self._watch: asyncio.TimerHandle | None = None
        self._look: asyncio.Task[None] | None = None
        self._raw.nonblocking = 1
        self._raw.enter_pipeline_mode()

    async def trip(self, statements: Sequence[Statement]) -> list[Rows]:
        """Execute statements; return the rows of each.

        Raises:
            psycopg.Error: the server refused one, or is gone. The connection is good for nothing
                then but to be closed.
        """
        if self._failure is not None:
            raise self._failure
        if self._loop is None:
            self._loop = asyncio.get_running_loop()
            self._loop.add_reader(self._socket, self._arrived)
        self._watch_from(self._loop.time())
        try:
            return await self._trip(statements)
        finally:
            self._unwatch()

    async def _trip(self, statements: Sequence[Statement]) -> list[Rows]:
        answers: list[bool] = []
        for text, values in statements:
            if text not in self._names:
                self._name(text)
                answers.append(False)
            self._raw.send_query_prepared(self._names[text], [_told(one) for one in values])
            answers.append(True)
        self._raw.pipeline_sync()
        while self._raw.flush():
            await self._writable()
        found = [await self._answer() for _ in answers]
        # What the end of the trip is answered.
        await self._result()
        return [rows for rows, wanted in zip(found, answers, strict=True) if wanted]

    def close(self) -> None:
        """Let go of the event loop."""
        if self._loop is not None and not self._loop.is_closed():
            self._loop.remove_reader(self._socket)
            self._loop.remove_writer(self._socket)
        self._loop = None
        if self._socket >= 0:
            os.close(self._socket)
            self._socket = -1

    def _watch_from(self, begun: float) -> None:
        """Have somebody look at the server in a while, for a trip that has begun at `begun`."""
        assert self._loop is not None
        self._watch = self._loop.call_later(SILENT_SECONDS, self._doubt, self._loop, begun)

    def _unwatch(self) -> None:
        if self._watch is not None:
            self._watch.cancel()
        if self._look is not None:
            self._look.cancel()
        self._watch = self._look = None

    def _doubt(self, loop: asyncio.AbstractEventLoop, begun: float) -> None:
        async def look() -> None:
            waited = loop.time() - begun
            why = await in_thread(why_given_up, self._place, waited, TRIP_SECONDS)
            self._look = None
            if why is None:
                self._watch_from(begun)
            else:
                self._failure = SilentError(why)
                self.close()
                self._wake()

        self._look = loop.create_task(look())

    def _name(self, text: str) -> None:
        name = self._names[text] = b"trip_%d" % len(self._names)
        first, *rest = text.split("%s")
        numbered = first + "".join(f"${n}{part}" for n, part in enumerate(rest, start=1))
        self._raw.send_prepare(name, numbered.replace("%%", "%").encode())

    async def _answer(self) -> Rows:
        """Return the rows of one statement."""
        rows: Rows = []
        while (result := await self._result()) is not None:
            if result.status == ExecStatus.TUPLES_OK:
                self._loading.set_pgresult(result)
                rows = self._loading.load_rows(0, result.ntuples, tuple)
            elif result.status != ExecStatus.COMMAND_OK:
                raise psycopg.errors.error_from_result(result)
        return rows

    async def _result(self) -> Any:
        """Return the next thing that the server says; None: that was all of a statement."""
        while self._raw.is_busy():
            assert self._loop is not None
            self._arrival = self._loop.create_future()
            await self._arrival
        return self._raw.get_result()

    async def _writable(self) -> None:
        """Wait until the server takes more, or has sent something, or is gone."""
        assert self._loop is not None
        loop, self._arrival = self._loop, self._loop.create_future()
        loop.add_writer(self._socket, self._wake)
        try:
            await self._arrival
        finally:
            if self._socket >= 0:
                loop.remove_writer(self._socket)

    def _arrived(self) -> None:
        """Take in what the server has sent, asked or not; it may be that it hung up."""
        try:
            self._raw.consume_input()
        except psycopg.OperationalError as error:
            self._failure = error
            self.close()
        self._wake()

    def _wake(self) -> None:
        """Wake up who waits."""
        waiting, self._arrival = self._arrival, None
        if waiting is not None and not waiting.done():
            if self._failure is None:
                waiting.set_result(None)
            else:
                waiting.set_exception(self._failure)


def _told(value: Any) -> bytes | None:
    """Return a value as the server reads it."""
    if value is None:
        return None
    if isinstance(value, bool):
        return _TRUTH[value]
    return str(value).encode()
