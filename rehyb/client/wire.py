"""Requests over plain HTTP/1.1 with next to nothing around them.

A general client makes ten times as much of a request as the coordinator's answer costs to read,
and a worker with quick instances does little else. What is not plain (TLS, a proxy) goes through
such a client all the same: `connection` decides.
"""

import json
import select
import socket
import ssl
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any
from urllib.request import getproxies

import httptools
import httpx2

from rehyb.errors import Invalid

#: Bytes read at once.
CHUNK = 65_536
#: What cannot stand in a header.
BREAKS = ("\r", "\n", "\0")
#: The header by which a coordinator is told from any other server, in every answer.
SPEAKER = "X-Rehyb"
#: First byte of what TLS says: a handshake, or an alert (RFC 8446, section 5.1).
TLS_RECORDS = (b"\x16", b"\x15")


class WireError(OSError):
    """The other side does not speak HTTP, or has hung up in the middle of an answer."""


class NotHttpError(WireError):
    """The other side does not speak HTTP."""


class HungUpError(WireError):
    """The other side has hung up without a word of an answer."""


@dataclass(slots=True)
class Answer:
    """An answer to a request, read to its end: what a coordinator's client needs of one."""

    status_code: int
    content: bytes
    #: What was asked.
    url: str
    headers: list[tuple[bytes, bytes]]

    @property
    def is_success(self) -> bool:
        """Whether what was asked for was done."""
        return HTTPStatus.OK <= self.status_code < HTTPStatus.MULTIPLE_CHOICES

    @property
    def is_coordinators(self) -> bool:
        """Whether a coordinator says it, and no other server that is there, or in between."""
        return bool(self.header(SPEAKER))

    def header(self, name: str) -> str:
        """Return what a header says; empty: it is not there."""
        wanted = name.lower().encode("ascii")
        said = [value for given, value in self.headers if given.lower() == wanted]
        return b", ".join(said).decode("latin-1")

    def json(self) -> Any:
        """Return the value that it holds; ValueError if it is no JSON."""
        return json.loads(self.content)


def answered(response: httpx2.Response) -> Answer:
    """Return an answer that a general client has read."""
    content, url = response.content, str(response.request.url)
    return Answer(response.status_code, content, url, response.headers.raw)


class Wire:
    """Kept connections to one host. Threads may share it: each request has a connection to itself.

    Args:
        url: of the host, as `is_plain` takes it.
        headers: of every request.
    """

    def __init__(self, url: httpx2.URL, headers: Mapping[str, str]) -> None:
        self._address = url.host, url.port or 80
        host = url.netloc.decode("ascii")
        self._headers = _lines({"Host": host, "Accept": "*/*", **headers})
        self._idle: list[socket.socket] = []

    def request(
        self,
        method: str,
        url: httpx2.URL,
        headers: Mapping[str, str],
        content: bytes = b"",
        *,
        timeout: float,
    ) -> Answer:
        """Send a request and return the answer, read to its end.

        `timeout`: seconds that the other side may be silent.

        Raises:
            OSError: nobody answers, or not in HTTP.
            httpx2.DecodingError: the answer cannot be unpacked.
            Invalid: a header cannot be sent.
        """
        head = b"%s %s HTTP/1.1\r\n%s%sContent-Length: %d\r\n\r\n" % (
            method.encode("ascii"),
            url.raw_path,
            self._headers,
            _lines(headers),
            len(content),
        )
        connection = self._connection(timeout)
        try:
            # An answer may come, and the rest of the request be unwanted, before it is sent.
            with suppress(BrokenPipeError, ConnectionResetError):
                _send(connection, head + content)
            found = _read(connection)
        except BaseException:
            connection.close()
            raise
        if found.keep:
            self._idle.append(connection)
        else:
            connection.close()
        answer = Answer(found.status, b"".join(found.body), str(url), found.headers)
        if answer.header("content-encoding"):
            # Nobody asked for it, but a server in between may pack what it likes.
            packed = httpx2.Response(
                answer.status_code, headers=found.headers, content=answer.content
            )
            answer.content = packed.content
        return answer

    def close(self) -> None:
        """Close what is kept."""
        while self._idle:
            self._idle.pop().close()

    def _connection(self, timeout: float) -> socket.socket:
        """Return a connection that the other side has not closed meanwhile."""
        while self._idle:
            with suppress(IndexError):
                kept = self._idle.pop()
                if not _readable(kept):
                    kept.settimeout(timeout)
                    return kept
                kept.close()
        fresh = socket.create_connection(self._address, timeout)
        fresh.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return fresh


def speaks_tls(host: str, port: int, seconds: float) -> bool:
    """Say whether what listens there speaks TLS, whoever it is, and says so in time.

    It answers the first message of a handshake in a record of TLS, if only to refuse this client.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    hello = ssl.MemoryBIO()
    handshake = context.wrap_bio(ssl.MemoryBIO(), hello, server_hostname=host)
    with suppress(ssl.SSLWantReadError):
        handshake.do_handshake()
    try:
        with socket.create_connection((host, port), seconds) as there:
            there.sendall(hello.read())
            return there.recv(1) in TLS_RECORDS
    except OSError:
        return False


def is_plain(url: httpx2.URL, *, direct: bool) -> bool:
    """Say whether a coordinator can be asked over a `Wire`.

    Args:
        url: where it is.
        direct: no proxy is asked, whatever the environment says.
    """
    return (
        url.scheme == "http"
        and not url.userinfo
        and bool(url.host)
        and (direct or not getproxies().keys() & {"http", "all"})
    )


class _Reading:
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
            raise NotHttpError(f"no answer in HTTP: {error}") from None

    def end(self) -> None:
        """Take note that nothing more comes, which ends a body of no given length."""
        names = {name.lower() for name, _ in self.headers}
        if not self.begun:
            # So does one that speaks TLS, but who is just being restarted, too.
            raise HungUpError("it hung up without an answer; of one with TLS give https://")
        if names & {b"content-length", b"transfer-encoding"}:
            raise WireError("it hung up in the middle of an answer")
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


def _read(connection: socket.socket) -> _Reading:
    answer = _Reading()
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
    looking = select.poll()
    looking.register(connection, select.POLLIN)
    return bool(looking.poll(0))


def _lines(headers: Mapping[str, str]) -> bytes:
    for name, value in headers.items():
        if not value.isascii() or any(one in value for one in BREAKS):
            raise Invalid(f"{name} must be one line of ASCII, not {value[:80]!r}")
    return b"".join(b"%s: %s\r\n" % (n.encode(), v.encode()) for n, v in headers.items())
