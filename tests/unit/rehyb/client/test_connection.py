"""Where a coordinator is, how long it is waited for, and how what it says of itself is heard."""

import ssl
from collections.abc import Callable
from math import inf
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx2
import pytest

from rehyb import Client, Conflict, Invalid, NotFound, ServerError, Unreachable
from rehyb.client.close_loops import INTERPRETATIONS
from rehyb.client.connection import COMPRESS_BYTES, DEFAULT_URL, Connection
from rehyb.errors import RehybError, WrongProtocol
from tests.testbed.recorder import Recorder
from tests.testbed.transport import CoordinatorTransport


def test_a_place_without_an_address_is_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("REHYB_URL", raising=False)
    assert Connection(token="t").url == DEFAULT_URL
    assert Connection("http://lab:9000//", "t").url == "http://lab:9000"
    monkeypatch.setenv("REHYB_URL", "http://else:1")
    assert Connection("http://lab:9000", "t").url == "http://lab:9000"
    with pytest.raises(Invalid, match=r"^http://lab:no is not a coordinator's address: "):
        Connection("http://lab:no", "t")


@pytest.mark.parametrize(
    "url", ["lab:8787", "192.168.1.10:8787", "ftp://lab", "http://", "http:///v1"]
)
def test_an_address_that_is_none_is_refused_before_anybody_waits_for_it(url: str) -> None:
    with pytest.raises(Invalid, match=r"it begins with http:// or https://, and a host follows$"):
        Connection(url, "t")


def test_who_has_another_protocol_or_certificate_is_told_from_who_is_not_there() -> None:
    certificate = ssl.SSLCertVerificationError(1, "certificate verify failed")
    certificate.verify_message = "self-signed certificate"
    plain = ssl.SSLError(1, "wrong version number")
    plain.reason = "WRONG_VERSION_NUMBER"
    fault = httpx2.ConnectError("it fails")

    def refuse(request: httpx2.Request) -> httpx2.Response:
        raise fault

    client = Client("https://lab", "t", transport=CoordinatorTransport(refuse))
    for fault.__cause__, words in (
        (certificate, r"not trusted \(self-signed certificate\); SSL_CERT_FILE names one"),
        (plain, r"does not speak TLS: write http://lab$"),
    ):
        with pytest.raises(WrongProtocol, match=words):
            client.studies()


@pytest.mark.parametrize(
    ("status", "kind", "words"),
    [
        (404, WrongProtocol, "answered 404 Not Found, which is no coordinator's word"),
        (
            301,
            WrongProtocol,
            "answered 301 Moved Permanently, which is no coordinator's word; it sends on to "
            "https://lab/",
        ),
        (413, Invalid, "answered 413 Request Entity Too Large"),
        (408, ServerError, "answered 408 Request Timeout"),
        (429, ServerError, "answered 429 Too Many Requests"),
        (502, ServerError, "answered 502 Bad Gateway"),
        (520, ServerError, "answered 520"),
    ],
)
def test_what_a_web_server_in_between_says_is_not_taken_for_a_coordinators_word(
    status: int, kind: type[RehybError], words: str
) -> None:
    def answer(request: httpx2.Request) -> httpx2.Response:
        headers = {"Location": "https://lab/"} if status == 301 else {}
        return httpx2.Response(status, html="<p>it is so</p>", headers=headers)

    client = Client("http://lab", "t", transport=httpx2.MockTransport(answer))
    with pytest.raises(kind) as caught:
        client.studies()
    assert type(caught.value) is kind
    assert str(caught.value) == f"http://lab/v1/studies {words}"


@pytest.mark.parametrize(
    ("status", "words"),
    [
        (200, "http://lab answers, but is no coordinator of rehyb; set REHYB_URL to its address"),
        (204, "http://lab answers, but is no coordinator of rehyb; set REHYB_URL to its address"),
        (404, "answered 404 Not Found, which is no coordinator's word"),
        (422, "answered 422 Unprocessable Entity, which is no coordinator's word"),
    ],
)
def test_another_server_that_speaks_json_is_told_from_a_coordinator(
    status: int, words: str, tmp_path: Path
) -> None:
    def answer(request: httpx2.Request) -> httpx2.Response:
        return httpx2.Response(status, json={"detail": "a stranger's", "status": status})

    client = Client("http://lab", "t", transport=httpx2.MockTransport(answer))
    (tmp_path / "t.csv").write_text("a,b\n")
    calls: list[Callable[[], object]] = [
        client.studies,
        client.workers,
        client.health,
        lambda: client.study("s"),
        lambda: client.delete("s"),
        lambda: client.lease(worker={}, models=[], max_instances=1),
        lambda: client.post_results(lease="l", fence=1, worker="w", results=[]),
        lambda: client.analyse(tmp_path / "t.csv"),
        lambda: client.results_csv("s", tmp_path / "r.csv"),
    ]
    for call in calls:
        with pytest.raises(WrongProtocol) as caught:
            call()
        assert str(caught.value).endswith(words)
    assert not (tmp_path / "r.csv").exists()


@pytest.mark.parametrize(("said", "seconds"), [("12", 12.0), ("", 1.0), ("soon", 1.0)])
def test_how_long_to_leave_a_coordinator_alone_is_whole_seconds(said: str, seconds: float) -> None:
    idle = Recorder(status=204, headers={"Retry-After": said})
    idle.client.retry_after = 5.0
    assert idle.client.lease(worker={}, models=[], max_instances=1) is None
    assert idle.client.retry_after == seconds


def test_a_body_as_long_as_may_be_is_sent_as_it_is_and_a_longer_one_is_not() -> None:
    there = Recorder()
    frame = len('{"x":""}')
    for length, packed in ((COMPRESS_BYTES, None), (COMPRESS_BYTES + 1, "gzip")):
        there.client.submit({"x": "x" * (length - frame)})
        assert there.last is not None
        assert there.last.headers.get("Content-Encoding") == packed
        assert there.last.headers["Content-Type"] == "application/json"


def test_an_answer_to_results_without_verdicts_is_an_error_in_its_own_words() -> None:
    said: dict[str, Any] = {"lease": "l", "fence": 1, "worker": "w", "results": []}
    with pytest.raises(Conflict, match=r"^another's$"):
        Recorder({"detail": "another's"}, status=409).client.post_results(**said)
    with pytest.raises(ServerError, match=r"^it is full$"):
        Recorder({"detail": "it is full"}, status=503).client.post_results(**said)


def test_results_are_posted_under_their_lease_and_its_fence() -> None:
    there = Recorder({"verdicts": [1]})
    said: dict[str, Any] = {"lease": "l", "fence": 7, "worker": "w", "results": [{"instance": "i"}]}
    assert there.client.post_results(**said) == [1]
    assert there.told == ("POST", "/v1/results", said)


@pytest.mark.parametrize(
    ("url", "verify", "trusting"),
    [
        ("https://lab:9000", True, True),
        ("http://lab:9000", False, True),
        ("https://127.0.0.1:9000", True, False),
        ("http://localhost:9000", False, False),
    ],
)
def test_certificates_are_looked_at_and_no_proxy_is_asked_of_this_machine(
    url: str, verify: bool, trusting: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[dict[str, Any]] = []
    general = httpx2.Client

    def make(**said: Any) -> httpx2.Client:
        made.append(said)
        return general(base_url=said["base_url"])

    monkeypatch.setattr(httpx2, "Client", make)
    for patience in ({}, {"timeout": 7.0}):
        client = Client(url, "t", **patience)
        assert client.retry_after == 1.0
        client.close()
    assert [(one["verify"], one["trust_env"]) for one in made] == [(verify, trusting)] * 2
    assert [one["timeout"] for one in made] == [30.0, 7.0]


def test_an_answer_is_waited_for_no_longer_than_it_may_take(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("rehyb.client.connection.time", SimpleNamespace(monotonic=lambda: 100.0))
    there = Recorder()
    for answer_by, seconds in ((inf, 30.0), (200.0, 30.0), (100.5, 0.5)):
        there.client.answer_by = answer_by
        there.client.work()
        assert there.last is not None
        assert there.last.extensions["timeout"]["read"] == seconds
    there.client.answer_by = 100.0
    with pytest.raises(Unreachable):
        there.client.work()


def test_nothing_is_asked_once_the_time_is_over(tmp_path: Path) -> None:
    there = Recorder()
    there.client.answer_by = 0.0
    for call in (
        lambda: there.client.work(),
        lambda: there.client.results_csv("s", tmp_path / "r.csv"),
        lambda: there.client.analyse_study("s"),
    ):
        with pytest.raises(Unreachable, match=r"\(there is no time left to ask\): start one with"):
            call()
    assert there.last is None and list(tmp_path.iterdir()) == []


def test_an_address_that_is_too_long_is_told_in_part() -> None:
    with pytest.raises(Invalid) as caught:
        Recorder().client.study("a" * 70_000)
    start = repr("/v1/studies/" + "a" * 68)
    assert str(caught.value).startswith(f"{start} is no address at http://c:1: ")


STRANGE = [
    "s/precision",
    "s/pause?",
    "../sessions/x",
    "s?x=1",
    "s#x",
    "..",
    ".",
    "",
    "s%2Fpause",
    "s\n",
]


@pytest.mark.parametrize("strange", STRANGE)
def test_what_cannot_be_an_id_leads_nowhere_else(strange: str) -> None:
    there = Recorder()
    client, job = there.client, {"id": strange, "lease": "l", "fence": 1}
    calls: dict[str, Callable[[], object]] = {
        "study": lambda: client.delete(strange),
        "model": lambda: client.model(strange),
        "lease": lambda: client.renew(strange, 1),
        "session": lambda: client.delete_session(strange),
        "close-loop": lambda: client.release_close_loop(job),
        "interpretation": lambda: client.wait_for_report(strange, INTERPRETATIONS),
    }
    for one, call in calls.items():
        with pytest.raises(NotFound) as caught:
            call()
        assert str(caught.value) == f"there is no {one} {strange!r}"
    assert there.last is None
