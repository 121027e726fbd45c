"""Pages that stay up to date: one look at the store for all tabs that show the same."""

import asyncio
import json
import logging
from collections.abc import AsyncIterator, Callable, Mapping
from time import monotonic
from typing import Any

from sqlalchemy.exc import SQLAlchemyError

from server.errors import NotFoundError

log = logging.getLogger(__name__)

#: Seconds between two looks, and how many times as long as a look takes the next one waits: a page
#: is never worth more than a hundredth of a core.
LOOK_SECONDS = 1.0
PATIENCE = 100.0
KEEPALIVE_SECONDS = 15.0
#: A stream ends after so long, and its tab comes back: whose token was revoked does not.
STREAM_SECONDS = 300.0

#: The parts of a page by name: HTML of a block, or a figure.
Parts = Mapping[str, Any]


class Topic:
    """One page as several tabs show it: its parts, and the number of the look that changed each."""

    def __init__(self) -> None:
        self.listeners = 0
        self.looks = 0
        self.gone = False
        self.news = asyncio.Condition()
        self._parts: dict[str, tuple[int, str]] = {}

    def take(self, parts: Parts) -> bool:
        """Note what a look saw; return whether any part differs."""
        self.looks += 1
        before = self._parts
        self._parts = {}
        for name, content in parts.items():
            text = json.dumps(content, separators=(",", ":"))
            seen, known = before.get(name, (0, ""))
            self._parts[name] = (seen, known) if text == known else (self.looks, text)
        return any(seen == self.looks for seen, _ in self._parts.values())

    async def tell(self) -> None:
        """Wake whoever waits for news."""
        async with self.news:
            self.news.notify_all()

    def since(self, look: int) -> str:
        """Return the parts that changed after a look, as a JSON object."""
        new = [f"{json.dumps(n)}:{text}" for n, (seen, text) in self._parts.items() if seen > look]
        return "{" + ",".join(new) + "}"


class Hub:
    """All pages that somebody looks at.

    Args:
        stopping: set when the process is asked to stop.
    """

    def __init__(self, stopping: asyncio.Event) -> None:
        self._stopping = stopping
        self._topics: dict[object, Topic] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    async def follow(
        self, key: object, look: Callable[[], Parts], seconds: float = STREAM_SECONDS
    ) -> AsyncIterator[str]:
        """Yield server-sent events: all parts at first, then those that change; "gone" at the end.

        Args:
            key: whoever has the same sees the same.
            look: returns the parts, in a thread; NotFoundError if there is no such page any more.
            seconds: after which it ends.
        """
        topic = self._topics.get(key)
        if topic is None:
            topic = self._topics[key] = Topic()
            task = asyncio.create_task(self._keep_looking(key, topic, look))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)
        topic.listeners += 1
        try:
            yield "retry: 1000\n\n"
            told, until = 0, monotonic() + seconds
            while monotonic() < until and not self._stopping.is_set():
                if topic.looks > told:
                    news, told = topic.since(told), topic.looks
                    if news != "{}":
                        yield f"event: parts\ndata: {news}\n\n"
                if topic.gone:
                    yield "event: gone\ndata: {}\n\n"
                    return
                try:
                    async with topic.news:
                        await asyncio.wait_for(topic.news.wait(), KEEPALIVE_SECONDS)
                except TimeoutError:
                    yield ": still here\n\n"
        finally:
            topic.listeners -= 1
            if not topic.listeners and self._topics.get(key) is topic:
                del self._topics[key]

    async def _keep_looking(self, key: object, topic: Topic, look: Callable[[], Parts]) -> None:
        while self._topics.get(key) is topic and not topic.gone:
            began = monotonic()
            changed = False
            try:
                changed = topic.take(await asyncio.to_thread(look))
            except NotFoundError:
                topic.gone = True
            except SQLAlchemyError:
                log.exception("a page could not be looked at; trying again")
            took = monotonic() - began
            if changed or topic.gone:
                await topic.tell()
            if await self._stops_within(max(LOOK_SECONDS, PATIENCE * took)):
                await topic.tell()
                return

    async def _stops_within(self, seconds: float) -> bool:
        try:
            await asyncio.wait_for(self._stopping.wait(), seconds)
        except TimeoutError:
            return False
        return True
