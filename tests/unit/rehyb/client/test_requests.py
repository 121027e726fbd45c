"""Every call is one request: its method, path, query, body and what is made of the answer."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import httpx2
import pytest

from rehyb import Client, Conflict, Invalid, ServerError
from tests.testbed.clock import Clock
from tests.testbed.recorder import Recorder
from tests.testbed.transport import CoordinatorTransport

GOAL = {"settled": False, "steps": []}


Call = Callable[[Client], Any]


@pytest.mark.parametrize(
    ("call", "method", "path", "body"),
    [
        (lambda c: c.work(), "GET", "/v1/work", None),
        (lambda c: c.work("a b"), "GET", "/v1/work?group=a%20b", None),
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
    call: Callable[[Client, Path | str], None], path: str, tmp_path: Path
) -> None:
    for out in (tmp_path / "out", f"{tmp_path}/text"):
        there = Recorder({"bytes": 1})
        call(there.client, out)
        assert there.told[:2] == ("GET", path)
        assert json.loads(Path(out).read_text()) == {"bytes": 1}


@pytest.mark.parametrize(
    ("call", "path", "sort"),
    [
        (lambda c, p: c.add_model(p), "/v1/models", "application/zip"),
        (lambda c, p: c.upload_session(p), "/v1/sessions?name=a", "application/zip"),
        (lambda c, p: c.add_model(str(p)), "/v1/models", "application/zip"),
        (lambda c, p: c.upload_session(str(p)), "/v1/sessions?name=a", "application/zip"),
        (lambda c, p: c.upload_session(p, "b"), "/v1/sessions?name=b", "application/zip"),
        (lambda c, p: c.analyse(p), "/v1/analyses?name=a.zip", None),
        (
            lambda c, p: c.analyse(str(p), ["y", "z"], ["x"]),
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

    client = Client("http://c:1", "t", transport=CoordinatorTransport(answer))
    assert call(client, tmp_path / "a.zip") == {"id": "x"}
    (request,) = seen
    assert (request.method, request.url.raw_path.decode()) == ("POST", path)
    assert request.content == (b"" if "/studies/" in path else b"content")
    assert request.headers.get("Content-Type") == sort
    refusing = Recorder({"detail": "no"}, status=409)
    with pytest.raises(Conflict, match=r"^no$"):
        call(refusing.client, tmp_path / "a.zip")


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda c: c.indices(None), "the id of a study is a text, not NoneType"),
        (lambda c: c.model(3), "the id of a model is a text, not int"),
        (lambda c: c.upload_session(None), "a path is a text or a pathlib.Path, not NoneType"),
        (lambda c: c.results_csv("s", 3), "a path is a text or a pathlib.Path, not int"),
    ],
)
def test_what_is_no_id_or_path_at_all_is_one_error_of_ours(
    call: Callable[[Any], object], said: str
) -> None:
    with pytest.raises(Invalid, match=f"^{said}$"):
        call(Recorder().client)


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

    client = Client("http://c:1", "t", transport=CoordinatorTransport(answer))
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


def test_who_follows_a_study_waits_for_a_coordinator_that_is_restarted_but_not_for_ever() -> None:
    clock = Clock()
    seen: list[Any] = []
    there = Recorder({"state": "running", "precision": None}, {"state": "cancelled"})
    away = {2: 503, 3: 503, 4: 500}

    def client(failing: Mapping[int, int]) -> Client:
        asked = iter(range(1, 10_000))

        def answer(request: httpx2.Request) -> httpx2.Response:
            if (number := next(asked)) in failing:
                return httpx2.Response(failing[number], json={"detail": f"fails at {number}"})
            return there(request)

        return Client("http://c:1", "t", transport=CoordinatorTransport(answer))

    last = client(away).wait("s", on_progress=seen.append, clock=clock, sleep=clock.advance)
    assert last == {"state": "cancelled"} and len(seen) == 2
    assert clock() == Clock()() + 1.0 + len(away)
    with pytest.raises(ServerError, match=r"fails at 1$"):
        client({1: 503}).wait("s", clock=clock, sleep=clock.advance)
    there = Recorder({"state": "running", "precision": None})
    gone = dict.fromkeys(range(2, 10_000), 503)
    with pytest.raises(ServerError, match=r"fails at 602$"):
        client(gone).wait("s", clock=clock, sleep=clock.advance)


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
