"""Requests over plain HTTP/1.1 with next to nothing around them.

A general client makes ten times as much of a request as the coordinator's answer costs to read,
and a worker with quick instances does little else. What is not plain (TLS, a proxy) goes through
such a client all the same: `connection` decides.
"""

import socket
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from http import HTTPStatus
from urllib.request import getproxies

import httptools
import httpx2

from rehyb.errors import Invalid

#: Bytes read at once.
CHUNK = 65_536
#: What cannot stand in a header.
BREAKS = ("\r", "\n", "\0")


class WireError(OSError):
    """The other side does not speak HTTP, or has hung up in the middle of an answer."""


class Wire:
    """Kept connections to one host. Threads may share it: each request has a connection to itself.

    Args:
        url: of the host, as `is_plain` takes it.
        headers: of every request.
        timeout: seconds that the other side may be silent.
    """

    def __init__(self, url: httpx2.URL, headers: Mapping[str, str], timeout: float) -> None:
        self._address = url.host, url.port or 80
        self._timeout = timeout
        host = url.netloc.decode("ascii")
        self._headers = _lines({"Host": host, "Accept": "*/*", **headers})
        self._idle: list[socket.socket] = []
        # What an answer is an answer to; a worker asks for the same few all the time.
        self._request = lru_cache(maxsize=64)(httpx2.Request)

    def request(
        self, method: str, url: httpx2.URL, headers: Mapping[str, str], content: bytes = b""
    ) -> httpx2.Response:
        """Send a request and return the answer, read to its end.

        Raises:
            OSError: nobody answers, or not in HTTP.
            Invalid: a header cannot be sent.
        """
        head = b"%s %s HTTP/1.1\r\n%s%sContent-Length: %d\r\n\r\n" % (
            method.encode("ascii"),
            url.raw_path,
            self._headers,
            _lines(headers),
            len(content),
        )
        connection = self._connection()
        try:
            # An answer may come, and the rest of the request be unwanted, before it is sent.
            with suppress(BrokenPipeError, ConnectionResetError):
                _send(connection, head + content)
            answer = _read(connection)
        except BaseException:
            connection.close()
            raise
        if answer.keep:
            self._idle.append(connection)
        else:
            connection.close()
        response = httpx2.Response(
            answer.status,
            headers=answer.headers,
            stream=httpx2.ByteStream(b"".join(answer.body)),
            request=self._request(method, url),
        )
        response.read()
        return response

    def close(self) -> None:
        """Close what is kept."""
        while self._idle:
            self._idle.pop().close()

    def _connection(self) -> socket.socket:
        """Return a connection that the other side has not closed meanwhile."""
        while self._idle:
            with suppress(IndexError):
                kept = self._idle.pop()
                if not _readable(kept):
                    return kept
                kept.close()
        fresh = socket.create_connection(self._address, self._timeout)
        fresh.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return fresh


def is_plain(url: httpx2.URL, token: str, *, direct: bool) -> bool:
    """Say whether a coordinator can be asked over a `Wire`.

    Args:
        url: where it is.
        token: what requests bear.
        direct: no proxy is asked, whatever the environment says.
    """
    return (
        url.scheme == "http"
        and not url.userinfo
        and bool(url.host)
        and (direct or not getproxies().keys() & {"http", "all"})
        and token.isascii()
        and token.isprintable()
    )


class _Answer:
    """An answer as it arrives; httptools calls its methods."""

    def __init__(self) -> None:
        self.status = 0
        self.headers: list[tuple[bytes, bytes]] = []
        self.body: list[bytes] = []
        self.begun = self.complete = self.keep = False
        self._parser = httptools.HttpResponseParser(self)

    def feed(self, chunk: bytes) -> None:
        try:
            self._parser.feed_data(chunk)
        except (httptools.HttpParserError, httptools.HttpParserUpgrade) as error:
            raise WireError(f"no answer in HTTP: {error}") from None

    def end(self) -> None:
        """Take note that nothing more comes, which ends a body of no given length."""
        names = {name.lower() for name, _ in self.headers}
        if not self.begun or names & {b"content-length", b"transfer-encoding"}:
            raise WireError("the coordinator hung up without an answer")
        self.complete = True

    def on_message_begin(self) -> None:
        # What follows an answer is none to this request, and who knows what comes next.
        self.keep = False
        if not self.complete:
            self.headers, self.body, self.begun = [], [], False

    def on_header(self, name: bytes, value: bytes) -> None:
        if not self.complete:
            self.headers.append((name, value))

    def on_headers_complete(self) -> None:
        if not self.complete:
            self.status, self.begun = self._parser.get_status_code(), True

    def on_body(self, body: bytes) -> None:
        if not self.complete:
            self.body.append(body)

    def on_message_complete(self) -> None:
        # One of 1xx only says that the answer is on its way.
        if self.status >= HTTPStatus.OK and not self.complete:
            self.complete, self.keep = True, self._parser.should_keep_alive()


def _read(connection: socket.socket) -> _Answer:
    answer = _Answer()
    while not answer.complete:
        if chunk := connection.recv(CHUNK):
            answer.feed(chunk)
        else:
            answer.end()
    return answer


def _send(connection: socket.socket, data: bytes) -> None:
    # Not `sendall`, which counts the seconds of the whole.
    left = memoryview(data)
    while left:
        left = left[connection.send(left) :]


def _readable(connection: socket.socket) -> bool:
    """Say whether there is something to read, if only the end, between two requests."""
    seconds = connection.gettimeout()
    connection.setblocking(False)
    try:
        connection.recv(1, socket.MSG_PEEK)
    except BlockingIOError:
        return False
    except OSError:
        return True
    finally:
        connection.settimeout(seconds)
    return True


def _lines(headers: Mapping[str, str]) -> bytes:
    for name, value in headers.items():
        if not value.isascii() or any(one in value for one in BREAKS):
            raise Invalid(f"{name} must be one line of ASCII, not {value[:80]!r}")
    return b"".join(b"%s: %s\r\n" % (n.encode(), v.encode()) for n, v in headers.items())
