"""Who keeps the coordinator waiting is not waited for, and strangers leave room for others."""

import asyncio
import json
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
import uvicorn
from uvicorn.server import ServerState

from server.http.connections import (
    BODY_SECONDS,
    HEAD_SECONDS,
    MOST_HEAD,
    ImpatientProtocol,
    Strangers,
)

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


def refused(peer: Peer, status: bytes) -> str:
    """What a peer hears before its connection is closed."""
    assert peer.wire.ended == "closed"
    head, _, body = peer.wire.sent.partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 " + status) and b"application/problem+json" in head
    assert b"connection: close" in head and b"x-of-all: answers" in head
    return str(json.loads(body)["detail"])


@pytest.mark.parametrize(
    ("start", "more"),
    [
        (b"GET /healthz HTTP/1.1\r\nHost: x\r\nX: ", b"a" * 1000),
        (b"GET /healthz HTTP/1.1\r\nHost: x\r\n", b"X: a\r\n" * 100),
        (b"GET /healthz?", b"a" * 1000),
        (b"\r\n", b"\r\n" * 500),
        (
            HEAD.replace(b"Content-Length: 100000", b"Transfer-Encoding: chunked") + b"1;",
            b"a" * 999,
        ),
        (
            HEAD.replace(b"Content-Length: 100000", b"Transfer-Encoding: chunked") + b"0\r\nX: ",
            b"a" * 1000,
        ),
    ],
    ids=["header", "headers", "path", "blank lines", "extension of a chunk", "trailer"],
)
def test_a_head_without_end_is_refused_after_as_much_as_one_may_have(
    peer: Peer, start: bytes, more: bytes
) -> None:
    peer.protocol.data_received(start)
    sent = len(start)
    while not peer.wire.ended:
        assert sent < MOST_HEAD + 2000
        peer.protocol.data_received(more)
        sent += len(more)
    assert (
        refused(peer, b"431 ") == "the line and headers of a request may have 65536 bytes at most"
    )


@pytest.mark.parametrize("name", ["X", "Y" * 30_000])
def test_a_head_that_is_too_long_is_refused_also_if_it_comes_at_once(peer: Peer, name: str) -> None:
    long = b"GET / HTTP/1.1\r\n%s: %s\r\n\r\n" % (name.encode(), b"a" * MOST_HEAD)
    peer.protocol.data_received(long)
    refused(peer, b"431 ")


def test_a_long_body_may_come_with_its_head_and_many_requests_on_one_connection(peer: Peer) -> None:
    peer.protocol.data_received(HEAD + b"x" * 100_000)
    assert peer.protocol.cycle.body == b"x" * 100_000 and not peer.protocol.cycle.more_body
    peer.protocol.cycle.response_complete = True
    for _ in range(200):
        peer.protocol.data_received(b"GET / HTTP/1.1\r\nHost: a\r\nX: %s\r\n\r\n" % (b"a" * 1000))
        peer.protocol.cycle.response_complete = True
    chunked = HEAD.replace(b"Content-Length: 100000", b"Transfer-Encoding: chunked")
    peer.protocol.data_received(chunked)
    for _ in range(1000):
        peer.protocol.data_received(b"1\r\na\r\n" * 100)
    assert not peer.wire.ended


@pytest.mark.parametrize(
    "sent", [b"nonsense\r\n\r\n", b"\x16\x03\x01\x02\x00\x01", b"GET / HTTP/9\r\n"]
)
def test_what_is_no_request_is_refused_as_everything_is(peer: Peer, sent: bytes) -> None:
    peer.protocol.data_received(sent)
    assert refused(peer, b"400 ").startswith("what came is no HTTP request")


def test_of_too_many_strangers_the_oldest_of_the_address_goes() -> None:
    strangers = Strangers(most=5, most_per_address=3)
    assert [strangers.add(n, "bad") for n in range(3)] == [None] * 3
    assert strangers.add(3, "bad") == 0
    assert strangers.add(4, "good") is None
    strangers.forget(4)
    assert [strangers.add(n, "bad") for n in range(5, 8)] == [1, 2, 3]
    assert [strangers.add(n, f"other {n}") for n in range(10, 12)] == [None, None]
    assert strangers.add(12, "another") == 5


@pytest.mark.parametrize("hosts", [b"", b"Host: a\r\nHost: b\r\n"])
def test_a_request_that_does_not_say_for_whom_it_is_once_is_refused(
    peer: Peer, hosts: bytes
) -> None:
    peer.protocol.data_received(b"GET / HTTP/1.1\r\n%s\r\n" % hosts)
    assert refused(peer, b"400 ").startswith("an HTTP/1.1 request has the header Host once")


def test_http_1_0_needs_no_host(peer: Peer) -> None:
    peer.protocol.data_received(b"GET / HTTP/1.0\r\n\r\n")
    assert not peer.wire.ended
