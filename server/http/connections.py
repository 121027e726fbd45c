"""How long a connection may keep the coordinator waiting or busy, and how many may be open."""

import asyncio
import resource
from collections import Counter
from collections.abc import Hashable
from http import HTTPStatus
from typing import Any

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from server.http.problems import problem

#: Seconds for the head of a request to arrive whole, from its first byte or from the connection's
#: beginning; and for a body, besides what it takes at the least rate.
HEAD_SECONDS = 10.0
BODY_SECONDS = 30.0
#: Bytes that a request's line and headers may have, and what comes between or behind the pieces of
#: a body. The parser has no bound of its own, and the time it takes grows with the square.
MOST_HEAD = 65_536
#: Bytes a second, on average, of whoever sends a body.
LEAST_RATE = 10_000.0
#: Most connections of one address, and of all together, of whose requests none bore a good token
#: yet; and the share of this process's descriptors that they may take at most.
STRANGERS_PER_ADDRESS = 256
STRANGERS = 1024
SHARE_PER_ADDRESS, SHARE = 1 / 8, 1 / 4
#: In every answer: tells a client that no other server gives it.
SPEAKER = ("X-Rehyb", "coordinator")
_TOO_SLOW = (
    f"the request's body came too slowly: {BODY_SECONDS:g} s and a second for every "
    f"{LEAST_RATE:g} bytes are waited for"
)
_TOO_LONG = f"the line and headers of a request may have {MOST_HEAD} bytes at most"
_NO_HOST = "an HTTP/1.1 request has the header Host once (RFC 9112, 3.2)"
_NO_HTTP = "what came is no HTTP request, by this protocol's own rules: use an HTTP client"


class Strangers:
    """Connections that have not shown a good token, oldest first."""

    def __init__(self, *, most: int, most_per_address: int) -> None:
        self._most = most
        self._most_per_address = most_per_address
        self._address: dict[Hashable, str] = {}
        self._count: Counter[str] = Counter()

    def add(self, connection: Hashable, address: str) -> Hashable | None:
        """Note a new one; return the one that must go for it, if it is one too many.

        It is the oldest: whoever wants to work shows a token with the first request, and is no
        stranger any more when others have come.
        """
        self._address[connection] = address
        self._count[address] += 1
        gone: Hashable | None = None
        if self._count[address] > self._most_per_address:
            gone = next(one for one, whose in self._address.items() if whose == address)
        elif len(self._address) > self._most:
            gone = next(iter(self._address))
        if gone is not None:
            self.forget(gone)
        return gone

    def forget(self, connection: Hashable) -> None:
        """One is closed, or has shown a good token."""
        address = self._address.pop(connection, None)
        if address is not None:
            self._count[address] -= 1
            if not self._count[address]:
                del self._count[address]


def strangers() -> Strangers:
    """Return the bounds of this process, which may open all the files that the system allows."""
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    # Without a limit it is -1.
    files = hard if hard > 0 else 1 << 20
    return Strangers(
        most=min(STRANGERS, int(files * SHARE)),
        most_per_address=min(STRANGERS_PER_ADDRESS, int(files * SHARE_PER_ADDRESS)),
    )


class _TooLongError(Exception):
    """A request's line and headers are longer than they may be."""


class _NoHostError(Exception):
    """A request does not say for whom it is, or says so twice."""


class ImpatientProtocol(HttpToolsProtocol):
    """Uvicorn's HTTP, which by itself waits for ever for a request that has not begun or ended.

    It also takes heads without end, and does nothing else meanwhile.
    """

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to serve a connection; close another if there are too many."""
        super().connection_made(transport)
        #: Since when the peer owes the rest of a head or a body; None if it owes nothing.
        self._owes_since: float | None = self.loop.time()
        self._received = 0
        #: Bytes since a head was whole or a part of a body came.
        self._fruitless = 0
        self._too_long = self._hostless = False
        gone: Any = self._strangers.add(self, self.client[0] if self.client else "")
        if gone is not None:
            gone.transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget a connection."""
        self._strangers.forget(self)
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Take what has arrived."""
        before = self.cycle
        self._fruitless += len(data)
        super().data_received(data)
        cycle = self.cycle
        self._received += len(data)
        if cycle is not before:
            # Who shows a good token with this request is told so by `server.http.guards`.
            cycle.scope["rehyb.connection"] = self  # type: ignore[typeddict-unknown-key]
            self._owes_since = self.loop.time() if cycle.more_body else None
            self._received = self._fruitless = 0
        elif cycle is not None and not cycle.response_complete:
            if not cycle.more_body:
                self._owes_since = None
        elif self._owes_since is None:
            self._owes_since, self._received = self.loop.time(), 0
        if self._fruitless > MOST_HEAD and not self._too_long:
            self._too_long = True
            self._refuse(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE, _TOO_LONG)

    def on_headers_complete(self) -> None:
        """Begin to serve a request, unless its head is too long."""
        # To add it up is for the few that come with so much; most of that is a body, as a rule.
        if self._fruitless > MOST_HEAD and self._length_of_head() > MOST_HEAD:
            self._too_long = True
            raise _TooLongError
        if sum(name == b"host" for name, _ in self.headers) != 1 and self._is_http_1_1():
            self._hostless = True
            raise _NoHostError
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        """Take a part of a body."""
        self._fruitless = 0
        super().on_body(body)

    def send_400_response(self, msg: str) -> None:
        """Answer what the parser does not take, as everything is refused: with a problem."""
        if self._too_long:
            self._refuse(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE, _TOO_LONG)
        else:
            self._refuse(HTTPStatus.BAD_REQUEST, _NO_HOST if self._hostless else _NO_HTTP)

    def signed_in(self) -> None:
        """A request bore a good token."""
        self._strangers.forget(self)

    def is_overdue(self, now: float) -> bool:
        """Say whether the peer has owed the rest of its request for too long."""
        if self._owes_since is None:
            return False
        cycle = self.cycle
        if cycle is None or cycle.response_complete:
            return bool(now > self._owes_since + HEAD_SECONDS)
        if self.flow.read_paused:
            # It is the coordinator that does not read.
            self._owes_since, self._received = now, 0
        return bool(now > self._owes_since + BODY_SECONDS + self._received / LEAST_RATE)

    def give_up(self) -> None:
        """Close the connection of a peer that is overdue, who is told so if it owes a body."""
        if self.cycle is None or self.cycle.response_started:
            self.transport.abort()
            return
        self._refuse(HTTPStatus.REQUEST_TIMEOUT, _TOO_SLOW)

    def _refuse(self, status: HTTPStatus, detail: str) -> None:
        """Say why, and close the connection; without a word if an answer is under way."""
        cycle = self.cycle
        if cycle is not None and cycle.response_started and not cycle.response_complete:
            self.transport.abort()
            return
        answer = problem(status, detail, headers={"Connection": "close"})
        headers = (*self.server_state.default_headers, *answer.raw_headers)
        head = b"".join(b"%s: %s\r\n" % header for header in headers)
        first = f"HTTP/1.1 {status} {status.phrase}".encode()
        self.transport.write(b"%s\r\n%s\r\n%s" % (first, head, answer.body))
        self.transport.close()

    @property
    def _strangers(self) -> Strangers:
        app: Any = self.config.app
        bounds: Strangers = app.state.strangers
        return bounds

    def _is_http_1_1(self) -> bool:
        return bool(self.parser.get_http_version() == "1.1")

    def _length_of_head(self) -> int:
        return len(self.url) + sum(len(name) + len(value) + 4 for name, value in self.headers)
