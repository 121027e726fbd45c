"""Every call is one request: its method, path, query, body and what is made of the answer."""

import json
from collections.abc import Callable
from math import inf
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import httpx2
import pytest

from rehyb import Client, Conflict, Invalid, ServerError, Unreachable
from rehyb.client.connection import COMPRESS_BYTES, DEFAULT_URL, Connection
from tests.testbed.clock import Clock

GOAL = {"settled": False, "steps": []}


class Recorder:
    """Notes the last request, and answers with the next of some bodies, over and over the last."""

    def __init__(self, *answers: Any, status: int = 200, headers: dict[str, str] | None = None):
        self._answers, self._status, self._headers = list(answers) or [{}], status, headers
        self.last: httpx2.Request | None = None
        self.client = Client("http://c:1", "t", transport=httpx2.MockTransport(self))

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        request.read()
        self.last = request
        answer = self._answers.pop(0) if len(self._answers) > 1 else self._answers[0]
        return httpx2.Response(self._status, json=answer, headers=self._headers)

    @property
    def told(self) -> tuple[str, str, Any]:
        """Method, path with its query, and body of the last request."""
        assert self.last is not None
        content = self.last.content
        return self.last.method, self.last.url.raw_path.decode(), json.loads(content or b"null")


Call = Callable[[Client], Any]


@pytest.mark.parametrize(
    ("call", "method", "path", "body"),
    [
        (lambda c: c.work(), "GET", "/v1/work", None),
        (lambda c: c.study("s"), "GET", "/v1/studies/s", None),
        (lambda c: c.progress("s"), "GET", "/v1/studies/s/progress", None),
        (lambda c: c.indices("s"), "GET", "/v1/studies/s/indices", None),
        (lambda c: c.pause("s"), "POST", "/v1/studies/s/pause", None),
        (lambda c: c.drain("s"), "POST", "/v1/studies/s/drain", None),
        (lambda c: c.resume("s"), "POST", "/v1/studies/s/resume", None),
        (lambda c: c.cancel("s"), "POST", "/v1/studies/s/cancel", None),
        (lambda c: c.submit({"rows": 3}), "POST", "/v1/studies", {"rows": 3}),
        (lambda c: c.extend("s", 9), "POST", "/v1/studies/s/extend", {"rows": 9}),
        (lambda c: c.prioritise("s", -2), "POST", "/v1/studies/s/priority", {"priority": -2}),
        (
            lambda c: c.set_precision_goal("s", 64),
            "POST",
            "/v1/studies/s/precision",
            {"up_to": 64, "target": None, "output": None},
        ),
        (
            lambda c: c.set_precision_goal("s", 64, 0.05, "y"),
            "POST",
            "/v1/studies/s/precision",
            {"up_to": 64, "target": 0.05, "output": "y"},
        ),
        (
            lambda c: c.rerun("s"),
            "POST",
            "/v1/studies/s/rerun",
            {"which": "failed", "outcomes": None},
        ),
        (
            lambda c: c.rerun("s", "all", ("crashed",)),
            "POST",
            "/v1/studies/s/rerun",
            {"which": "all", "outcomes": ["crashed"]},
        ),
        (lambda c: c.instances("s"), "GET", "/v1/studies/s/instances?limit=100", None),
        (
            lambda c: c.instances("s", state="done", outcome="ok", after="4:2", limit=7),
            "GET",
            "/v1/studies/s/instances?state=done&outcome=ok&after=4%3A2&limit=7",
            None,
        ),
        (lambda c: c.instance("s", 3, 4), "GET", "/v1/studies/s/instances/3/4", None),
        (lambda c: c.renew("l", 7), "POST", "/v1/leases/l/renew", {"fence": 7}),
        (
            lambda c: c.lease(worker={"id": "w"}, models=("m",), max_instances=4),
            "POST",
            "/v1/leases",
            {"worker": {"id": "w"}, "models": ["m"], "max_instances": 4},
        ),
        (lambda c: c.model("m"), "GET", "/v1/models/m", None),
        (lambda c: c.announce_model({"name": "m"}), "POST", "/v1/models", {"name": "m"}),
        (lambda c: c.session("e"), "GET", "/v1/sessions/e", None),
        (lambda c: c.close_loop("e"), "POST", "/v1/sessions/e/close-loop", None),
        (
            lambda c: c.interpret("e"),
            "POST",
            "/v1/sessions/e/interpretation",
            {"known": [], "tolerance": None, "bank": None},
        ),
        (
            lambda c: c.interpret("e", known=[("m", 1.0, 0.1)], tolerance=0.5, bank="b"),
            "POST",
            "/v1/sessions/e/interpretation",
            {"known": [{"name": "m", "value": 1.0, "sd": 0.1}], "tolerance": 0.5, "bank": "b"},
        ),
        (lambda c: c.close_loop_report("j"), "GET", "/v1/close-loops/j", None),
    ],
)
def test_a_call_is_one_request_and_returns_its_answer(
    call: Call, method: str, path: str, body: Any
) -> None:
    there = Recorder({"some": "answer"})
    assert call(there.client) == {"some": "answer"}
    assert there.told == (method, path, body)


@pytest.mark.parametrize(
    ("call", "method", "path", "body"),
    [
        (lambda c: c.remove_precision_goal("s"), "DELETE", "/v1/studies/s/precision", None),
        (lambda c: c.delete("s"), "DELETE", "/v1/studies/s", None),
        (lambda c: c.release("l", 7), "POST", "/v1/leases/l/release", {"fence": 7}),
        (lambda c: c.delete_session("e"), "DELETE", "/v1/sessions/e", None),
        (
            lambda c: c.release_close_loop({"id": "j", "lease": "l", "fence": 7}),
            "POST",
            "/v1/close-loops/j/release",
            {"lease": "l", "fence": 7},
        ),
    ],
)
def test_what_is_given_back_or_removed_has_no_answer(
    call: Call, method: str, path: str, body: Any
) -> None:
    there = Recorder()
    call(there.client)
    assert there.told == (method, path, body)
    with pytest.raises(Conflict):
        call(Recorder({"detail": "no"}, status=409).client)


@pytest.mark.parametrize(
    ("call", "path", "of"),
    [
        (lambda c: c.studies(), "/v1/studies", "studies"),
        (lambda c: c.workers(), "/v1/workers", "workers"),
        (lambda c: c.models(), "/v1/models", "models"),
        (lambda c: c.models(wanted=True), "/v1/models?wanted=true", "models"),
        (lambda c: c.sessions(), "/v1/sessions", "sessions"),
    ],
)
def test_a_list_comes_without_its_wrapping(call: Call, path: str, of: str) -> None:
    there = Recorder({of: [1, 2]})
    assert call(there.client) == [1, 2]
    assert there.told == ("GET", path, None)


@pytest.mark.parametrize(
    ("call", "path"),
    [
        (lambda c, p: c.results_csv("s", p), "/v1/studies/s/results.csv"),
        (lambda c, p: c.model_archive("m@1", p), "/v1/models/m@1/archive"),
        (lambda c, p: c.session_archive("e", p), "/v1/sessions/e/archive"),
        (lambda c, p: c.close_loop_file("j", "f.csv", p), "/v1/close-loops/j/f.csv"),
        (lambda c, p: c.interpretation_file("j", "f.csv", p), "/v1/interpretations/j/f.csv"),
    ],
)
def test_a_download_writes_the_answer(
    call: Callable[[Client, Path], None], path: str, tmp_path: Path
) -> None:
    there = Recorder({"bytes": 1})
    call(there.client, tmp_path / "out")
    assert there.told[:2] == ("GET", path)
    assert json.loads((tmp_path / "out").read_text()) == {"bytes": 1}


@pytest.mark.parametrize(
    ("call", "path", "sort"),
    [
        (lambda c, p: c.add_model(p), "/v1/models", "application/zip"),
        (lambda c, p: c.upload_session(p), "/v1/sessions?name=a", "application/zip"),
        (lambda c, p: c.upload_session(p, "b"), "/v1/sessions?name=b", "application/zip"),
        (lambda c, p: c.analyse(p), "/v1/analyses?name=a.zip", None),
        (
            lambda c, p: c.analyse(p, ["y", "z"], ["x"]),
            "/v1/analyses?name=a.zip&output=y&output=z&factor=x",
            None,
        ),
        (
            lambda c, p: c.analyse_study("s", ["y"]),
            "/v1/studies/s/analyses?output=y",
            None,
        ),
    ],
)
def test_an_upload_sends_a_file_and_returns_the_answer(
    call: Callable[[Client, Path], Any], path: str, sort: str | None, tmp_path: Path
) -> None:
    (tmp_path / "a.zip").write_bytes(b"content")
    seen: list[httpx2.Request] = []

    def answer(request: httpx2.Request) -> httpx2.Response:
        request.read()
        seen.append(request)
        return httpx2.Response(200, json={"id": "x"})

    client = Client("http://c:1", "t", transport=httpx2.MockTransport(answer))
    assert call(client, tmp_path / "a.zip") == {"id": "x"}
    (request,) = seen
    assert (request.method, request.url.raw_path.decode()) == ("POST", path)
    assert request.content == (b"" if "/studies/" in path else b"content")
    assert request.headers.get("Content-Type") == sort
    refusing = Recorder({"detail": "no"}, status=409)
    with pytest.raises(Conflict, match=r"^no$"):
        call(refusing.client, tmp_path / "a.zip")


def test_who_announces_a_model_is_said_in_a_header() -> None:
    there = Recorder()
    for worker in ("w", ""):
        there.client.announce_model({}, *([worker] if worker else []))
        assert there.last is not None and there.last.headers["X-Rehyb-Worker"] == worker


def test_a_page_that_signs_in_is_at_the_coordinator_s_own_address() -> None:
    there = Recorder({"path": "/sign-in?code=x"})
    assert there.client.page_address() == "http://c:1/sign-in?code=x"
    assert there.told == ("POST", "/v1/sign-in-codes", None)


@pytest.mark.parametrize(("date", "said"), [("today", "today"), ("", None)])
def test_health_comes_with_the_coordinator_s_clock(date: str, said: str | None) -> None:
    there = Recorder({"status": "ok"}, headers={"Date": date} if date else {})
    assert there.client.health() == {"status": "ok", "date": said}
    assert there.told[:2] == ("GET", "/healthz")


def test_every_page_of_instances_is_asked_for() -> None:
    there = Recorder({"instances": [1, 2], "next": "b"}, {"instances": [3], "next": None})
    asked: list[dict[str, str]] = []
    send = there.__call__

    def answer(request: httpx2.Request) -> httpx2.Response:
        asked.append(dict(request.url.params))
        return send(request)

    client = Client("http://c:1", "t", transport=httpx2.MockTransport(answer))
    assert client.all_instances("s", state="done", outcome="ok") == [1, 2, 3]
    first = {"state": "done", "outcome": "ok", "limit": "1000"}
    assert asked == [first, {**first, "after": "b"}]


@pytest.mark.parametrize("state", ["running", "draining", "paused"])
def test_waiting_goes_on_until_nothing_further_comes(state: str) -> None:
    clock = Clock()
    there = Recorder(
        {"state": state, "precision": None},
        {"state": "complete", "precision": GOAL},
        {"state": "complete", "precision": {**GOAL, "settled": True}, "rows": 8},
        {"rows_complete": 7},
        {"rows_complete": 8},
    )
    waits: list[float] = []
    last = there.client.wait("s", poll_seconds=3.0, clock=clock, sleep=waits.append)
    assert last["rows"] == 8
    # Twice for the study, once for its indices, which follow soon.
    assert waits == [3.0, 3.0, 0.2]
    waits.clear()
    there = Recorder({"state": "cancelled", "rows": 8})
    assert there.client.wait("s", clock=clock, sleep=waits.append)["state"] == "cancelled"
    assert waits == []


def test_precision_is_followed_step_by_step_until_it_is_settled() -> None:
    def goal(*steps: str, settled: bool = False) -> dict[str, Any]:
        told = [{"sentence": one} for one in steps]
        return {"state": "running", "rows": 8, "precision": {"steps": told, "settled": settled}}

    # It is set anew on the way, and so begins anew.
    there = Recorder(goal(), goal("a"), goal("a", "b"), goal(), goal("c"), goal("c", settled=True))
    steps: list[str] = []
    seen: list[Any] = []
    waits: list[float] = []
    last = there.client.wait_for_precision(
        "s", on_progress=seen.append, on_step=steps.append, sleep=waits.append
    )
    assert last == {"steps": [{"sentence": "c"}], "settled": True, "rows": 8}
    assert (steps, len(seen), waits) == (["a", "b", "c"], 6, [1.0] * 5)


def test_precision_that_nobody_asked_for_or_that_is_cancelled_is_said() -> None:
    there = Recorder({"state": "running", "precision": None})
    with pytest.raises(Invalid, match=r"^study s has no precision to reach: say one with --up-to$"):
        there.client.wait_for_precision("s")
    there = Recorder({"state": "cancelled", "precision": {**GOAL, "settled": True}})
    with pytest.raises(Conflict, match=r"^study s was cancelled before it was precise enough$"):
        there.client.wait_for_precision("s")


def test_a_place_without_an_address_is_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("REHYB_URL", raising=False)
    assert Connection(token="t").url == DEFAULT_URL
    assert Connection("http://lab:9000//", "t").url == "http://lab:9000"
    monkeypatch.setenv("REHYB_URL", "http://else:1")
    assert Connection("http://lab:9000", "t").url == "http://lab:9000"
    with pytest.raises(Invalid, match=r"^http://lab:no is not a coordinator's address: "):
        Connection("http://lab:no", "t")


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


def test_an_address_with_a_line_break_is_told_in_part() -> None:
    with pytest.raises(Invalid) as caught:
        Recorder().client.study("a\n" + "b" * 99)
    start = repr("/v1/studies/a\n" + "b" * 66)
    assert str(caught.value).startswith(f"{start} is no address at http://c:1: ")
