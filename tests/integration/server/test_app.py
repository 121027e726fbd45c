"""What the coordinator does unasked, and when."""

import asyncio
from itertools import count
from typing import Any

import pytest

from server import app
from server.errors import NotFoundError
from server.metrics import Metrics


def test_rows_are_freed_only_by_who_has_listened_for_that_long(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = [1000.0]
    freed_at: list[float] = []

    async def sleep(seconds: float) -> None:
        now[0] += seconds
        if now[0] > 1200.0:
            raise asyncio.CancelledError

    async def here(call: Any, *given: Any, **named: Any) -> Any:
        return call(*given, **named)

    def free(_engine: object, **_: float) -> int:
        freed_at.append(now[0])
        return 0

    monkeypatch.setattr(app, "monotonic", lambda: now[0])
    monkeypatch.setattr(app.asyncio, "sleep", sleep)
    monkeypatch.setattr(app.asyncio, "to_thread", here)
    asked = count(1)

    def reap(_engine: object, **_: float) -> int:
        if next(asked) == 2:
            raise NotFoundError("a study was deleted meanwhile")
        return 0

    monkeypatch.setattr(app.lease_operations, "reap", reap)
    monkeypatch.setattr(app.close_loop_operations, "reap", lambda *_, **__: 0)
    monkeypatch.setattr(app.comparisons, "give_up", lambda *_, **__: None)
    monkeypatch.setattr(app.reruns, "free_stranded_rows", free)
    engine: Any = None
    with pytest.raises(asyncio.CancelledError):
        measures = Metrics(engine, lambda: now[0])
        asyncio.run(app._reap_for_ever(engine, measures, lambda: now[0], ttl=60.0, patience=100.0))
    # Looks every 15 s, from 1000 on; the first after 100 s is at 1105.
    assert freed_at == [1105.0, 1120.0, 1135.0, 1150.0, 1165.0, 1180.0, 1195.0]
