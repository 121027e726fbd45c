"""What happens, told as server-sent events while somebody listens."""

import asyncio
import json
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass
from typing import Any

from fastapi.responses import StreamingResponse
from sqlalchemy.exc import DBAPIError

from server.errors import NotFoundError
from server.store.database.presence import why_away

#: A line is sent at least this often, so that nothing between takes the connection for dead.
KEEPALIVE_SECONDS = 15.0


@dataclass(frozen=True, kw_only=True)
class Moment:
    """How far something is."""

    #: Differs from that of the moment before exactly if something has happened.
    tag: str
    content: Mapping[str, Any]
    #: Whether nothing more will happen.
    over: bool


async def stream(
    look: Callable[[], Moment], stopping: asyncio.Event, *, seconds: float
) -> StreamingResponse:
    """Stream an event "progress" per change until it is over, or "deleted".

    Args:
        look: reads how far it is, in a thread; NotFoundError if it is not there.

    Raises:
        NotFoundError: it is not there to begin with: a problem, and not an empty stream.
    """
    first = await asyncio.to_thread(look)
    return StreamingResponse(
        follow(first, look, stopping, seconds=seconds),
        media_type="text/event-stream",
        headers={"Cache-Control": "no-store", "X-Accel-Buffering": "no"},
    )


async def follow(
    moment: Moment, look: Callable[[], Moment], stopping: asyncio.Event, *, seconds: float
) -> AsyncIterator[str]:
    """Yield events as `stream` sends them, the first one of `moment`."""
    told, quiet = "", 0.0
    while True:
        if moment.tag != told:
            yield f"event: progress\ndata: {json.dumps(moment.content)}\n\n"
            told, quiet = moment.tag, 0.0
        elif quiet >= KEEPALIVE_SECONDS:
            yield ": still here\n\n"
            quiet = 0.0
        if moment.over or stopping.is_set():
            return
        try:
            await asyncio.wait_for(stopping.wait(), seconds)
        except TimeoutError:
            quiet += seconds
        try:
            moment = await asyncio.to_thread(look)
        except NotFoundError:
            yield "event: deleted\ndata: {}\n\n"
            return
        except DBAPIError as error:
            # Who listens hears on when the database is back.
            if why_away(error) is None:
                raise
