"""Pages that stay up to date: one look at the store for all tabs that show the same."""

import asyncio
import logging
from collections.abc import AsyncIterator, Callable, Mapping
from json import dumps
from time import monotonic, thread_time
from typing import Any

from server.errors import NotFoundError
from server.threads import in_thread

log = logging.getLogger(__name__)

#: Seconds between two looks, and how many times the processor's time that a look takes the next
#: one waits, but no longer than so many seconds: a page is not worth more than 1 % of a core.
LOOK_SECONDS = 1.0
PATIENCE = 100.0
LONGEST_SECONDS = 30.0
#: A stream without news says so often that it is there; live.js knows how often.
BEAT_SECONDS = 5.0
#: A stream ends after so long, and its tab comes back: whose token was revoked does not.
STREAM_SECONDS = 300.0

#: The parts of a page by name: HTML of a block, or a figure.
Parts = Mapping[str, Any]


def _measured(look: Callable[[], Parts]) -> tuple[dict[str, str], float]:
    """Return the parts as JSON, and how many seconds of this thread they took."""
    began = thread_time()
    parts = {name: dumps(content) for name, content in look().items()}
    return parts, thread_time() - began


class Topic:
    """One page as several tabs show it: its parts, and the edition in which each last changed."""

    def __init__(self) -> None:
        self.listeners = 0
        self.edition = 0
        self.gone = False
        self.news = asyncio.Condition()
        self._parts: dict[str, tuple[int, str]] = {}

    def take(self, parts: Mapping[str, str]) -> bool:
        """Note what a look saw, each part as JSON; return whether any differs."""
        before, self._parts, new = self._parts, {}, self.edition + 1
        for name, text in parts.items():
            seen, known = before.get(name, (0, ""))
            self._parts[name] = (seen, known) if text == known else (new, text)
            if text != known:
                self.edition = new
        return self.edition == new

    async def tell(self) -> None:
        """Wake whoever waits for news."""
        async with self.news:
            self.news.notify_all()

    def since(self, edition: int) -> str:
        """Return the parts that changed after an edition, as a JSON object."""
        new = [f"{dumps(n)}:{text}" for n, (seen, text) in self._parts.items() if seen > edition]
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
        """Yield server-sent events: all parts, then those that change, else beats; last "gone".

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
                if topic.edition > told:
                    news, told = topic.since(told), topic.edition
                    yield f"event: parts\ndata: {news}\n\n"
                if topic.gone:
                    yield "event: gone\ndata: {}\n\n"
                    return
                try:
                    # What came while this was sent was told to nobody.
                    await asyncio.wait_for(self._news(topic, told), BEAT_SECONDS)
                except TimeoutError:
                    yield "event: beat\ndata: {}\n\n"
        finally:
            topic.listeners -= 1
            if not topic.listeners and self._topics.get(key) is topic:
                del self._topics[key]

    async def _news(self, topic: Topic, told: int) -> None:
        async with topic.news:
            await topic.news.wait_for(
                lambda: topic.edition > told or topic.gone or self._stopping.is_set()
            )

    async def _keep_looking(self, key: object, topic: Topic, look: Callable[[], Parts]) -> None:
        before = 0.0
        while self._topics.get(key) is topic and not topic.gone:
            changed, cost = False, 0.0
            try:
                parts, cost = await in_thread(_measured, look)
                changed = topic.take(parts)
            except NotFoundError:
                topic.gone = True
            except Exception:
                # Whatever it is, another look may go well; a page that stands still says nothing.
                log.exception("a page could not be looked at; trying again")
            if changed or topic.gone:
                await topic.tell()
            # What a look costs but once, as the first one does, need not be waited for.
            seconds = max(LOOK_SECONDS, PATIENCE * min(cost, before))
            before = cost
            if await self._stops_within(min(seconds, LONGEST_SECONDS)):
                await topic.tell()
                return

    async def _stops_within(self, seconds: float) -> bool:
        try:
            await asyncio.wait_for(self._stopping.wait(), seconds)
        except TimeoutError:
            return False
        return True
