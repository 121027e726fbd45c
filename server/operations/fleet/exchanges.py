"""What workers post and ask for, many of them at the same time: shared transactions, or turns."""

import asyncio
import logging
import threading
from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

from sqlalchemy.engine import Engine

from server.operations.fleet.exchange import Answer, Exchange
from server.operations.fleet.turns import Turn, take_turn
from server.store.database.write_batching import WriteBatches
from server.store.fleet.turns import TurnConnection

log = logging.getLogger(__name__)

#: A turn serves so many at most: who comes next should not wait long.
MOST = 100

Waiting = tuple[Exchange, "asyncio.Future[Answer | None]"]


class Exchanges:
    """Serves workers, for an event loop that must not be kept waiting.

    On SQLite the transactions of `WriteBatches` do; on PostgreSQL turns in one thread.
    """

    def __init__(self, engine: Engine, write: WriteBatches) -> None:
        self._write = write
        self._turns = None if engine.dialect.name == "sqlite" else TurnConnection(engine)
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="turns")
        self._waiting: deque[Waiting] = deque()
        self._lock = threading.Lock()
        self._at_work = False
        self._next_study = ""

    async def __call__(self, exchange: Exchange) -> Answer:
        """Serve one exchange; when this returns it is committed."""
        if self._turns is not None:
            loop = asyncio.get_running_loop()
            done: asyncio.Future[Answer | None] = loop.create_future()
            with self._lock:
                self._waiting.append((exchange, done))
                begin, self._at_work = not self._at_work, True
            if begin:
                loop.run_in_executor(self._thread, self._serve, loop, self._turns)
            answer = await done
            if answer is not None:
                return answer
        return await self._write(exchange.alone)

    def close(self) -> None:
        """Wait for what is under way; nothing can be done afterwards."""
        self._thread.shutdown()
        if self._turns is not None:
            self._turns.close()

    def _serve(self, loop: asyncio.AbstractEventLoop, turns: TurnConnection) -> None:
        """Take one turn after the other while anybody waits."""
        while True:
            with self._lock:
                if not self._waiting:
                    self._at_work = False
                    return
                study = self._waiting[0][0].study or self._next_study
            taken: list[Waiting] = []

            def collect(study: str = study, taken: list[Waiting] = taken) -> Sequence[Exchange]:
                taken += self._collect(study)
                return [exchange for exchange, _ in taken]

            try:
                turn = take_turn(turns, study, collect)
            except Exception:
                # What comes of it by itself each is told; perhaps the server is away.
                log.warning("a turn failed: each gets a transaction of its own", exc_info=True)
                turn = Turn(answers=[(exchange, None) for exchange in collect()])
            self._next_study = turn.next_study
            answers = [answer for _, answer in turn.answers]
            loop.call_soon_threadsafe(_answer, taken, answers)

    def _collect(self, study: str) -> list[Waiting]:
        """Take those from the queue who bring results of a study, or none."""
        with self._lock:
            fitting = [one for one in self._waiting if one[0].study in ("", study)][:MOST]
            chosen = set(map(id, fitting))
            self._waiting = deque(one for one in self._waiting if id(one) not in chosen)
        return fitting


def _answer(taken: Sequence[Waiting], answers: Sequence[Answer | None]) -> None:
    for (_, done), answer in zip(taken, answers, strict=True):
        if not done.cancelled():
            done.set_result(answer)
