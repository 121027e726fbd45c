"""Tabs that show the same share one look, and are sent what has changed."""

import asyncio
import json
from collections.abc import AsyncIterator
from typing import Any

import pytest

from server.errors import NotFoundError
from server.web import live
from server.web.live import Hub, Topic


@pytest.fixture(autouse=True)
def _fast(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "LOOK_SECONDS", 0.002)
    monkeypatch.setattr(live, "PATIENCE", 0.0)


def test_a_topic_tells_each_listener_what_changed_since_its_last_look() -> None:
    topic = Topic()
    assert topic.take({"a": "1", "b": "1"})
    assert not topic.take({"a": "1", "b": "1"})
    assert topic.take({"a": "2", "b": "1"})
    assert json.loads(topic.since(0)) == {"a": 2, "b": 1}
    assert json.loads(topic.since(1)) == {"a": 2}
    assert topic.since(2) == "{}"


def parts_of(event: str) -> Any:
    return json.loads(event.split("data: ")[1]) if event.startswith("event: parts") else event


async def heard(events: AsyncIterator[str], number: int) -> list[Any]:
    return [parts_of(await anext(events)) for _ in range(number)]


def test_fifty_tabs_share_one_look_and_the_last_one_ends_it() -> None:
    looks = 0

    def look() -> dict[str, int]:
        nonlocal looks
        looks += 1
        return {"looks": looks // 5, "same": 1}

    async def run() -> None:
        hub = Hub(asyncio.Event())
        tabs = [hub.follow("page", look) for _ in range(50)]
        for tab in tabs:
            retry, first = await heard(tab, 2)
            assert retry == "retry: 1000\n\n" and first["same"] == 1
        (changed,) = await heard(tabs[0], 1)
        assert set(changed) == {"looks"}
        for tab in tabs:
            await tab.aclose()  # type: ignore[attr-defined]
        await asyncio.sleep(0.02)
        before = looks
        await asyncio.sleep(0.02)
        assert looks == before
        assert not hub._topics

    asyncio.run(run())


def test_what_changes_while_a_slow_tab_is_served_is_not_forgotten() -> None:
    now = {"n": 0}

    async def run() -> None:
        tab = Hub(asyncio.Event()).follow("page", lambda: dict(now))
        await heard(tab, 2)
        now["n"] = 1
        # Looked at, and told, while this tab waits for nothing.
        await asyncio.sleep(0.03)
        assert await asyncio.wait_for(heard(tab, 1), 1.0) == [{"n": 1}]

    asyncio.run(run())


def test_a_tab_that_comes_back_is_sent_everything_as_it_is_now() -> None:
    now = {"n": 0}

    async def run() -> None:
        hub = Hub(asyncio.Event())
        tab = hub.follow("page", lambda: dict(now))
        assert await heard(tab, 2) == ["retry: 1000\n\n", {"n": 0}]
        await tab.aclose()  # type: ignore[attr-defined]
        now["n"] = 7
        assert (await heard(hub.follow("page", lambda: dict(now)), 2))[1] == {"n": 7}

    asyncio.run(run())


def test_a_stream_without_news_beats_so_that_a_page_can_miss_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(live, "BEAT_SECONDS", 0.01)

    async def run() -> None:
        tab = Hub(asyncio.Event()).follow("page", lambda: {"n": 0})
        # A comment would be kept from the page's script.
        beat = "event: beat\ndata: {}\n\n"
        assert await anext(tab) == "retry: 1000\n\n"
        # It beats before its first look is done, too, if that takes longer.
        while (event := await anext(tab)) == beat:
            pass
        assert parts_of(event) == {"n": 0}
        assert await heard(tab, 2) == [beat, beat]

    asyncio.run(run())


def test_a_look_that_goes_wrong_is_repeated(caplog: pytest.LogCaptureFixture) -> None:
    looks = iter([{"n": 0}, None, {"n": 2}])

    def look() -> dict[str, Any]:
        found = next(looks, {"n": 2})
        if found is None:
            raise RuntimeError("the database is away")
        return found

    async def run() -> None:
        tab = Hub(asyncio.Event()).follow("page", look)
        assert (await heard(tab, 3))[1:] == [{"n": 0}, {"n": 2}]

    asyncio.run(run())
    assert "trying again" in caplog.text


def test_a_stream_ends_with_its_page_its_time_and_the_coordinator() -> None:
    def missing() -> dict[str, Any]:
        raise NotFoundError("there is no study")

    async def run() -> None:
        stopping = asyncio.Event()
        hub = Hub(stopping)
        assert [e async for e in hub.follow("gone", missing)][1:] == ["event: gone\ndata: {}\n\n"]
        assert len([e async for e in hub.follow("page", lambda: {"a": 1}, seconds=0.0)]) == 1
        tab = hub.follow("page", lambda: {"a": 1})
        await heard(tab, 2)
        stopping.set()
        with pytest.raises(StopAsyncIteration):
            await anext(tab)

    asyncio.run(run())
