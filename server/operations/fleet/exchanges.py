"""What workers post and ask for, many of them at the same time: shared transactions, or turns."""

import asyncio
import logging
from collections.abc import Sequence

from sqlalchemy.engine import Engine

from server.operations.fleet.exchange import Answer, Deferred, Exchange, Grant, Served
from server.operations.fleet.turns import next_turn, serve_within, take_turn
from server.store.database.presence import is_silent, waited_for_lock
from server.store.database.write_batching import WriteBatches
from server.store.fleet.turns import TurnConnection

log = logging.getLogger(__name__)

Waiting = tuple["asyncio.Future[Served | None]", Exchange]


class Exchanges:
    """Serves workers, for an event loop that must not be kept waiting.

    Those who wait share one turn after the other: on SQLite in the transactions of `WriteBatches`,
    on PostgreSQL in transactions of their own.
    """

    def __init__(self, engine: Engine) -> None:
        self._write = WriteBatches(engine, serve_within)
        self._turns = None if engine.dialect.name == "sqlite" else TurnConnection(engine)
        self._waiting: list[Waiting] = []
        self._at_work: asyncio.Task[None] | None = None
        self._next_study = ""

    async def __call__(self, exchange: Exchange) -> Answer:
        """Serve one exchange; when this returns it is committed."""
        judgements, found = await self._served(exchange)
        while isinstance(found, Deferred):
            more, found = await self._served(found.rest)
            judgements += more
        return judgements, found

    async def _served(self, exchange: Exchange) -> Served:
        if self._turns is not None:
            done: asyncio.Future[Served | None] = asyncio.get_running_loop().create_future()
            self._waiting.append((done, exchange))
            if self._at_work is None or self._at_work.done():
                self._at_work = asyncio.create_task(self._serve(self._turns))
            answer = await done
            if answer is not None:
                return answer
        return await self._write(exchange)

    async def close(self) -> None:
        """Wait for what is under way; nothing can be done afterwards."""
        if self._at_work is not None:
            await self._at_work
        if self._turns is not None:
            self._turns.close()
        self._write.close()

    async def _serve(self, turns: TurnConnection) -> None:
        """Take one turn after the other while anybody waits."""
        loop = asyncio.get_running_loop()
        while self._waiting:
            study = self._waiting[0][1].study or self._next_study
            taken: list[Waiting] = []

            def collect(study: str = study, taken: list[Waiting] = taken) -> Sequence[Exchange]:
                found, self._waiting = next_turn(self._waiting, study)
                taken += found
                return [exchange for _, exchange in taken]

            def ahead(grant: Grant) -> None:
                # The event loop comes to it when the server writes the turn.
                loop.call_soon(grant.instances)

            answers: Sequence[Served | None]
            try:
                async with turns.turn() as turn:
                    found = await take_turn(turn, study, collect, ahead)
                answers, self._next_study = found.answers, found.next_study
            except Exception as error:
                self._next_study = ""
                if is_silent(error) or waited_for_lock(error):
                    collect()
                    _refuse(taken, error)
                    continue
                # What comes of it by itself each is told; perhaps the server is away.
                log.warning("a turn failed: each gets a transaction of its own", exc_info=True)
                answers = [None for _ in collect()]
            for (done, _), answer in zip(taken, answers, strict=True):
                if not done.cancelled():
                    done.set_result(answer)


def _refuse(waiting: Sequence[Waiting], error: Exception) -> None:
    """Tell those who wait what went wrong: each by itself would wait for as long."""
    for done, _ in waiting:
        if not done.cancelled():
            done.set_exception(error)
