"""Turns on PostgreSQL without a coordinator around them."""

import asyncio
from collections.abc import Callable, Sequence
from typing import Any

from sqlalchemy.engine import Engine

from server.operations.fleet.exchange import Exchange
from server.operations.fleet.turns import TurnOutcome, take_turn
from server.store.fleet.turns import TurnConnection


class Turns:
    """Takes turns, in an event loop of its own."""

    def __init__(self, engine: Engine) -> None:
        self._runner = asyncio.Runner()
        self._store = TurnConnection(engine)

    def take(self, study: str, waiting: Callable[[], Sequence[Exchange]]) -> TurnOutcome:
        async def taken() -> TurnOutcome:
            async with self._store.turn() as turn:
                return await take_turn(turn, study, waiting)

        return self._runner.run(taken())

    def ask(self, statement: str, values: Sequence[Any]) -> list[tuple[Any, ...]]:
        """Return what one statement finds in a turn that stores nothing."""

        async def found() -> list[tuple[Any, ...]]:
            async with self._store.turn() as turn:
                _, rows = await turn.trip([("BEGIN", ()), (statement, values)])
                return rows

        return self._runner.run(found())

    def close(self) -> None:
        self._store.close()
        self._runner.close()
