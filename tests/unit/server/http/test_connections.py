"""Who keeps the coordinator waiting is not waited for, and strangers leave room for others."""

import asyncio
import json
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
import uvicorn
from uvicorn.server import ServerState

from server.http.connections import BODY_SECONDS, HEAD_SECONDS, ImpatientProtocol, Strangers

HEAD = b"POST /v1/results HTTP/1.1\r\nHost: h\r\nContent-Length: 100000\r\n\r\n"


class Wire(asyncio.Transport):
    """A transport that goes nowhere."""

    def __init__(self) -> None:
        super().__init__()
        self.sent, self.ended = b"", ""

    def write(self, data: Any) -> None:
        self.sent += data

    def close(self) -> None:
        self.ended = "closed"

    def abort(self) -> None:
        self.ended = "aborted"

    def pause_reading(self) -> None:
        pass


class Task:
    def add_done_callback(self, call: Any) -> None:
        pass


class Peer:
    """A connection and the time that it is served at."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        async def app(scope: Any, receive: Any, send: Any) -> None:
            pass

        app.state = SimpleNamespace(  # type: ignore[attr-defined]
            strangers=Strangers(most=9, most_per_address=9)
        )
        config = uvicorn.Config(app, log_config=None, lifespan="off")
        self.now = 0.0
        self.loop = SimpleNamespace(time=lambda: self.now, create_task=self._task)
        state = ServerState()
        state.default_headers = [(b"x-of-all", b"answers")]
        self.protocol = ImpatientProtocol(
            config=config, server_state=state, app_state={}, _loop=self.loop
        )
        self.wire = Wire()
        self.protocol.connection_made(self.wire)

    def _task(self, work: Any, **_: Any) -> Any:
        work.close()
        return Task()

    def overdue_after(self, seconds: float) -> bool:
        return self.protocol.is_overdue(self.now + seconds)


@pytest.fixture
def peer() -> Iterator[Peer]:
    loop = asyncio.new_event_loop()
    yield Peer(loop)
    loop.close()


def test_a_head_must_come_in_time_however_it_trickles(peer: Peer) -> None:
    assert not peer.overdue_after(HEAD_SECONDS)
    for byte in HEAD[:9]:
        peer.now += 1.0
        peer.protocol.data_received(bytes([byte]))
    assert peer.overdue_after(HEAD_SECONDS - 8.5)


def test_a_body_must_come_at_the_least_rate(peer: Peer) -> None:
    peer.now = 5.0
    peer.protocol.data_received(HEAD)
    assert not peer.overdue_after(BODY_SECONDS)
    assert peer.overdue_after(BODY_SECONDS + 1.0)
    peer.protocol.data_received(b"x" * 20_000)
    assert not peer.overdue_after(BODY_SECONDS + 1.0)
    assert peer.overdue_after(BODY_SECONDS + 3.0)
    peer.protocol.data_received(b"x" * 80_000)
    assert not peer.overdue_after(1e9)


def test_who_sends_a_body_too_slowly_is_told_so_and_who_sends_no_head_is_not(peer: Peer) -> None:
    peer.protocol.give_up()
    assert (peer.wire.sent, peer.wire.ended) == (b"", "aborted")
    peer.protocol.data_received(HEAD)
    peer.protocol.give_up()
    assert peer.wire.ended == "closed"
    head, _, body = peer.wire.sent.partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 408 ") and b"content-length: %d" % len(body) in head
    assert b"x-of-all: answers\r\n" in head
    assert json.loads(body)["detail"].startswith("the request's body came too slowly: 30 s and")


def test_of_too_many_strangers_the_oldest_of_the_address_goes() -> None:
    strangers = Strangers(most=5, most_per_address=3)
    assert [strangers.add(n, "bad") for n in range(3)] == [None] * 3
    assert strangers.add(3, "bad") == 0
    assert strangers.add(4, "good") is None
    strangers.forget(4)
    assert [strangers.add(n, "bad") for n in range(5, 8)] == [1, 2, 3]
    assert [strangers.add(n, f"other {n}") for n in range(10, 12)] == [None, None]
    assert strangers.add(12, "another") == 5
