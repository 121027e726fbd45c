"""What workers post and ask for, many of them at the same time: shared transactions, or turns."""

import asyncio
import logging
from collections.abc import Sequence
from functools import partial

from sqlalchemy.engine import Engine

from server.operations.fleet.exchange import Answer, Deferred, Exchange, Served
from server.operations.fleet.turns import serve_within, take_turn
from server.store.database.write_batching import WriteBatches
from server.store.fleet.turns import TurnConnection

log = logging.getLogger(__name__)

#: A turn serves so many at most, and others only while it is about fewer instances than these: who
#: comes next should not wait long, and large requests gain nothing by company.
MOST = 100
MOST_INSTANCES = 500

Waiting = tuple[Exchange, "asyncio.Future[Served | None]"]


class Exchanges:
    """Serves workers, for an event loop that must not be kept waiting.

    On SQLite each has a turn, in the transactions of `WriteBatches`; on PostgreSQL all who wait
    share one turn after the other.
    """

    def __init__(self, engine: Engine, write: WriteBatches) -> None:
        self._write = write
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
            self._waiting.append((exchange, done))
            if self._at_work is None or self._at_work.done():
                self._at_work = asyncio.create_task(self._serve(self._turns))
            answer = await done
            if answer is not None:
                return answer
        return await self._write(partial(serve_within, exchange=exchange))

    async def close(self) -> None:
        """Wait for what is under way; nothing can be done afterwards."""
        if self._at_work is not None:
            await self._at_work
        if self._turns is not None:
            self._turns.close()

    async def _serve(self, turns: TurnConnection) -> None:
        """Take one turn after the other while anybody waits."""
        while self._waiting:
            study = self._waiting[0][0].study or self._next_study
            taken: list[Waiting] = []

            def collect(study: str = study, taken: list[Waiting] = taken) -> Sequence[Exchange]:
                found, self._waiting = next_turn(self._waiting, study)
                taken += found
                return [exchange for exchange, _ in taken]

            answers: Sequence[Served | None]
            try:
                async with turns.turn() as turn:
                    found = await take_turn(turn, study, collect)
                answers, self._next_study = found.answers, found.next_study
            except Exception:
                # What comes of it by itself each is told; perhaps the server is away.
                log.warning("a turn failed: each gets a transaction of its own", exc_info=True)
                answers = [None for _ in collect()]
                self._next_study = ""
            for (_, done), answer in zip(taken, answers, strict=True):
                if not done.cancelled():
                    done.set_result(answer)


def next_turn(waiting: Sequence[Waiting], study: str) -> tuple[list[Waiting], list[Waiting]]:
    """Return whom the next turn serves, who bring results of a study or none; and who waits on."""
    taken: list[Waiting] = []
    left: list[Waiting] = []
    instances = 0
    for one in waiting:
        full = len(taken) == MOST or instances >= MOST_INSTANCES
        if full or one[0].study not in ("", study):
            left.append(one)
        else:
            taken.append(one)
            instances += one[0].size
    return taken, left
