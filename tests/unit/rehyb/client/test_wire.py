"""Over the short way a request is answered as over the long one, whatever the other side does."""

import gzip
import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import httpx2
import pytest

from rehyb import Client, Invalid, Unreachable
from rehyb.client.wire import Wire, is_plain
from rehyb.errors import WrongProtocol

OK = b"HTTP/1.1 200 OK\r\nX-Rehyb: coordinator\r\nContent-Length: 14\r\n\r\n"
ANSWER = OK + b'{"studies":[]}'


class Host:
    """Answers each request on a connection with the next of some texts; b"" hangs up."""

    def __init__(self, answers: Sequence[bytes]) -> None:
        self._answers = iter(answers)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._listener.getsockname()[1]}"
        self.connections = 0
        self.heard = b""
        #: What the other side is waited for after an answer.
        self.after: Callable[[], object] = lambda: None
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        with suppress(OSError):
            while True:
                connection, _ = self._listener.accept()
                self.connections += 1
                threading.Thread(target=self._talk, args=(connection,), daemon=True).start()

    def _talk(self, connection: socket.socket) -> None:
        with connection, suppress(OSError):
            while chunk := connection.recv(65536):
                self.heard += chunk
                if b"\r\n\r\n" not in chunk:
                    continue
                answer = next(self._answers)
                connection.sendall(answer)
                if not answer or b"close" in answer:
                    return

    def close(self) -> None:
        # Closed alone it listens on for as long as a thread waits in accept.
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()


@pytest.fixture
def host() -> Iterator[Callable[..., Host]]:
    hosts: list[Host] = []

    def listening(*answers: bytes) -> Host:
        hosts.append(Host(answers))
        return hosts[-1]

    yield listening
    for one in hosts:
        one.close()


HostOf = Callable[..., Host]


@pytest.mark.parametrize(
    "answer",
    [
        ANSWER,
        b"HTTP/1.1 204 No Content\r\nRetry-After: 3\r\n\r\n",
        b"HTTP/1.1 304 Not Modified\r\nETag: x\r\n\r\n",
        b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n3\r\nabc\r\n2\r\nde\r\n0\r\n\r\n",
        b"HTTP/1.1 200 OK\r\nConnection: close\r\n\r\nuntil the end",
        b"HTTP/1.0 200 OK\r\nX: close\r\n\r\nold",
        b"HTTP/1.1 103 Early Hints\r\nLink: a\r\n\r\n" + ANSWER,
        b"HTTP/1.1 409 Conflict\r\nContent-Length: 2\r\nA: 1\r\na: 2\r\n\r\n{}",
        b"HTTP/1.1 200 OK\r\nContent-Encoding: gzip\r\nContent-Length: %d\r\n\r\n"
        % len(gzip.compress(b"packed", mtime=0))
        + gzip.compress(b"packed", mtime=0),
    ],
)
def test_an_answer_is_what_a_general_client_makes_of_it(answer: bytes, host: HostOf) -> None:
    there = host(answer, answer)
    url = httpx2.URL(there.url + "/v1/studies")
    wire = Wire(url, {})
    short = wire.request("GET", url, {}, timeout=5.0)
    wire.close()
    with httpx2.Client(trust_env=False) as general:
        long = general.get(url)
    assert (short.status_code, short.content) == (long.status_code, long.content)
    assert {name: short.header(name) for name in long.headers} == dict(long.headers)
    assert (short.url, short.is_success) == (str(long.request.url), long.is_success)


def test_requests_share_a_connection_until_the_other_side_closes_it(host: HostOf) -> None:
    closing = ANSWER.replace(b"OK\r\n", b"OK\r\nConnection: close\r\n")
    there = host(ANSWER, ANSWER, closing, ANSWER)
    with Client(there.url, "secret") as client:
        for _ in range(3):
            assert client.studies() == []
        assert there.connections == 1
        assert client.studies() == []
    assert there.connections == 2
    assert there.heard.count(b"Authorization: Bearer secret\r\n") == 4


def test_a_connection_that_was_closed_meanwhile_is_not_asked(host: HostOf) -> None:
    there = host(ANSWER, ANSWER)
    with Client(there.url, "secret") as client:
        client.studies()
        assert client._wire is not None
        (kept,) = client._wire._idle
        kept.shutdown(socket.SHUT_RDWR)
        assert client.studies() == []
    assert there.connections == 2


def test_what_follows_an_answer_is_not_the_next_one(host: HostOf) -> None:
    there = host(ANSWER + ANSWER.replace(b"[]", b"[1"), ANSWER)
    with Client(there.url, "secret") as client:
        assert client.studies() == []
        assert client.studies() == []
    assert there.connections == 2


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        (b"", "hung up without an answer; of one with TLS give https://"),
        (b"HTTP/1.1 200 OK\r\nContent-Length: 99\r\nX: close\r\n\r\n{", "hung up in the middle"),
        (b"HTTP/1.1 200 OK\r\nContent-Length: 99\r\n\r\n{", "timed out"),
    ],
)
def test_who_gives_no_answer_is_no_coordinator(answer: bytes, why: str, host: HostOf) -> None:
    with (
        Client(host(answer).url, "secret", timeout=0.2) as client,
        pytest.raises(Unreachable, match=f"no coordinator answers at http://.*{why}.*rehyb up"),
    ):
        client.studies()


def test_who_answers_in_another_protocol_is_told_from_who_is_not_there_yet(host: HostOf) -> None:
    with (
        Client(host(b"SSH-2.0-OpenSSH_9.2\r\n").url, "secret") as client,
        pytest.raises(WrongProtocol, match=r"does not speak HTTP \(no answer in HTTP: "),
    ):
        client.studies()


def test_a_port_that_nobody_listens_at_says_so(host: HostOf) -> None:
    there = host()
    there.close()
    with (
        Client(there.url, "secret", timeout=1.0) as client,
        pytest.raises(Unreachable, match="Connection refused"),
    ):
        client.studies()


def test_a_refusal_before_the_request_is_sent_is_heard(host: HostOf) -> None:
    listener = socket.create_server(("127.0.0.1", 0))
    head = b"HTTP/1.1 413 Too Large\r\nX-Rehyb: coordinator\r\nContent-Length: 22\r\n\r\n"
    refusal = head + b'{"detail":"too large"}'

    def refuse() -> None:
        connection, _ = listener.accept()
        with connection:
            connection.recv(1000)
            connection.sendall(refusal)
            connection.shutdown(socket.SHUT_WR)
            while connection.recv(1 << 20):
                pass

    threading.Thread(target=refuse, daemon=True).start()
    url = f"http://127.0.0.1:{listener.getsockname()[1]}"
    noise = {str(number): hash(str(number)) for number in range(100_000)}
    with Client(url, "secret") as client, pytest.raises(Invalid, match=r"^too large$"):
        client.submit({"fixed": noise})
    listener.close()


def test_threads_do_not_hear_each_other_s_answers(host: HostOf) -> None:
    listener = socket.create_server(("127.0.0.1", 0))

    def echo(connection: socket.socket) -> None:
        with connection, suppress(OSError):
            while chunk := connection.recv(65536):
                about = chunk.split(b" ")[1].split(b"/")[-1]
                body = b'{"id": "%s"}' % about
                connection.sendall(OK.replace(b"14", b"%d" % len(body)) + body)

    def serve() -> None:
        with suppress(OSError):
            while True:
                threading.Thread(target=echo, args=(listener.accept()[0],), daemon=True).start()

    threading.Thread(target=serve, daemon=True).start()
    wrong: list[str] = []
    with Client(f"http://127.0.0.1:{listener.getsockname()[1]}", "secret") as client:

        def ask(name: str) -> None:
            wrong.extend(name for _ in range(40) if client.study(name)["id"] != name)

        threads = [threading.Thread(target=ask, args=(f"s{number}",)) for number in range(6)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    listener.close()
    assert wrong == []


@pytest.mark.parametrize("key", ["a\r\nX-Evil: 1", "a\nb", "ä"])
def test_a_header_cannot_break_its_line(key: str, host: HostOf) -> None:
    with Client(host(ANSWER).url, "secret") as client, pytest.raises(Invalid, match="one line"):
        client.submit({}, idempotency_key=key)


def test_a_path_cannot_break_its_line(host: HostOf) -> None:
    there = host(ANSWER)
    with Client(there.url + "/under", "secret") as client:
        with pytest.raises(Invalid, match="is no address at http"):
            client._json("GET", "/v1/a\r\nX-Evil: 1")
        client._json("GET", "/v1/a b HTTP/1.1 ä")
    assert there.heard.startswith(b"GET /under/v1/a%20b%20HTTP/1.1%20%C3%A4 HTTP/1.1\r\n")


@pytest.mark.parametrize(
    ("url", "plain"),
    [
        ("http://lab:9000", True),
        ("http://[::1]:9000", True),
        ("https://lab:9000", False),
        ("http://me:secret@lab:9000", False),
    ],
)
def test_only_what_is_plain_goes_the_short_way(
    url: str, plain: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("http_proxy", "all_proxy", "HTTP_PROXY", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
    assert is_plain(httpx2.URL(url), direct=False) is plain


@pytest.mark.parametrize("name", ["http_proxy", "HTTP_PROXY", "all_proxy"])
def test_a_proxy_is_asked_but_not_for_this_machine(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(name, "http://proxy:3128")
    assert not is_plain(httpx2.URL("http://lab:9000"), direct=False)
    assert is_plain(httpx2.URL("http://127.0.0.1:9000"), direct=True)


@pytest.mark.parametrize("transport", [None, httpx2.HTTPTransport()])
def test_no_answer_is_waited_for_beyond_the_time_by_which_it_must_be_there(
    transport: httpx2.BaseTransport | None, tmp_path: Path
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = f"http://127.0.0.1:{silent.getsockname()[1]}"
        with Client(url, "secret", timeout=60.0, transport=transport) as client:
            began = time.monotonic()
            client.answer_by = began + 0.1
            for ask in (client.studies, lambda: client.model_archive("m@1", tmp_path / "m.zip")):
                with pytest.raises(Unreachable):
                    ask()
            assert time.monotonic() < began + 30.0
