"""The client speaks the coordinator's REST API and turns every refusal into an error to catch."""

import gzip
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx2
import numpy as np
import pytest

from rehyb import (
    Client,
    Conflict,
    Invalid,
    NotFound,
    RehybError,
    ServerError,
    Unauthorized,
    Unreachable,
)
from rehyb.client.studies import ANALYSIS_SECONDS
from tests.testbed.clock import Clock
from tests.testbed.transport import CoordinatorTransport

Answer = Callable[[httpx2.Request], httpx2.Response]


def client(answer: Answer) -> Client:
    return Client("http://coordinator:1", "secret", transport=CoordinatorTransport(answer))


def always(status: int, **content: object) -> Answer:
    return lambda request: httpx2.Response(status, **content)  # type: ignore[arg-type]


def test_every_request_bears_the_token() -> None:
    def answer(request: httpx2.Request) -> httpx2.Response:
        assert request.headers["Authorization"] == "Bearer secret"
        return httpx2.Response(200, json={"studies": []})

    assert client(answer).studies() == []


def test_url_and_token_come_from_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("REHYB_URL", "http://lab:9000/")
    monkeypatch.setenv("REHYB_TOKEN", "from-the-environment")

    def answer(request: httpx2.Request) -> httpx2.Response:
        assert str(request.url) == "http://lab:9000/v1/workers"
        return httpx2.Response(200, json={"workers": [{"id": "w"}]})

    assert Client(transport=CoordinatorTransport(answer)).workers() == [{"id": "w"}]


def test_a_client_without_a_token_says_what_to_set(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("REHYB_TOKEN", raising=False)
    with pytest.raises(Unauthorized, match="set REHYB_TOKEN"):
        Client("http://lab:9000")


def test_a_token_from_a_file_may_end_its_line() -> None:
    def answer(request: httpx2.Request) -> httpx2.Response:
        assert request.headers["Authorization"] == "Bearer secret"
        return httpx2.Response(200, json={"studies": []})

    with Client("http://c", "secret\n", transport=CoordinatorTransport(answer)) as client:
        assert client.studies() == []


def test_every_study_is_listed_page_after_page() -> None:
    def answer(request: httpx2.Request) -> httpx2.Response:
        if "after" not in request.url.params:
            return httpx2.Response(200, json={"studies": [{"id": "a"}], "next": "1.5:a"})
        assert request.url.params["after"] == "1.5:a"
        return httpx2.Response(200, json={"studies": [{"id": "b"}], "next": None})

    assert client(answer).studies() == [{"id": "a"}, {"id": "b"}]


@pytest.mark.parametrize("token", ["hush hush", "h\xfcsh", "hush\udcff"])
def test_a_token_that_no_request_can_bear_is_refused_and_not_shown(token: str) -> None:
    with pytest.raises(Unauthorized, match="no request can bear") as refused:
        Client("http://lab:9000", token)
    assert "hush" not in str(refused.value) and "h\xfcsh" not in str(refused.value)


def test_a_study_is_submitted_with_its_idempotency_key() -> None:
    def answer(request: httpx2.Request) -> httpx2.Response:
        assert (request.method, request.url.path) == ("POST", "/v1/studies")
        assert request.headers["Idempotency-Key"] == "k1"
        return httpx2.Response(201, json={"id": "s1", **json.loads(request.content)})

    assert client(answer).submit({"rows": 3}, idempotency_key="k1") == {"id": "s1", "rows": 3}


@pytest.mark.parametrize(
    ("status", "kind"),
    [
        (400, Invalid),
        (401, Unauthorized),
        (408, ServerError),
        (429, ServerError),
        (403, Unauthorized),
        (404, NotFound),
        (409, Conflict),
        (413, Invalid),
        (422, Invalid),
        (500, ServerError),
        (503, ServerError),
    ],
)
def test_a_refusal_is_an_error_of_its_kind_in_the_coordinators_words(
    status: int, kind: type[RehybError]
) -> None:
    problem = {"title": "No", "status": status, "detail": "rows must be at least 1"}
    with pytest.raises(kind, match=r"^rows must be at least 1$") as caught:
        client(always(status, json=problem)).study("s1")
    assert type(caught.value) is kind
    assert caught.value.problem == problem


def test_a_refusal_says_where_in_the_request_the_faults_are() -> None:
    errors = [{"pointer": "/rows", "detail": "is missing"}, {"pointer": "/seed", "detail": "is -1"}]
    refusal = always(422, json={"detail": "the study cannot be used", "errors": errors})
    with pytest.raises(Invalid, match="cannot be used: /rows is missing; /seed is -1"):
        client(refusal).submit({})


def test_a_refusal_by_something_that_is_no_coordinator_names_the_address() -> None:
    with pytest.raises(ServerError, match="http://coordinator:1/v1/studies answered 502 Bad Gat"):
        client(always(502, text="<html>proxy</html>")).studies()


def test_an_answer_that_is_no_json_object_is_the_coordinators_fault() -> None:
    with pytest.raises(ServerError, match="did not answer with a JSON object"):
        client(always(200, text="hello")).study("s1")


def test_silence_says_what_to_start_or_set() -> None:
    def answer(request: httpx2.Request) -> httpx2.Response:
        raise httpx2.ConnectError("connection refused")

    with pytest.raises(Unreachable, match=r"coordinator:1 \(connection refused\): .* `rehyb up`"):
        client(answer).studies()


def test_a_number_that_json_does_not_have_is_refused_before_it_is_sent() -> None:
    with pytest.raises(Invalid, match="cannot be written as JSON"):
        client(always(500)).submit({"fixed": {"x1": float("nan")}})


@pytest.mark.parametrize(
    ("study", "said"),
    [
        ({"rows": np.int64(64)}, "/rows: Object of type int64 is not JSON serializable"),
        ({"fixed": {"x1": float("inf")}}, "/fixed/x1: Out of range float values are not JSON"),
        ({"outputs": ["y", {"z"}]}, "/outputs/1: Object of type set is not JSON serializable"),
        ({(1, 2): 3}, "keys must be str"),
    ],
)
def test_what_json_does_not_have_is_refused_with_its_place(study: Any, said: str) -> None:
    """A whole number of NumPy's was a TypeError, which no caller of a client expects."""
    with pytest.raises(Invalid, match=f"cannot be written as JSON: {said}"):
        client(always(500)).submit(study)


def test_what_is_in_itself_is_refused_too() -> None:
    study: dict[str, Any] = {"rows": 1}
    study["fixed"] = study
    with pytest.raises(Invalid, match="Circular reference"):
        client(always(500)).submit(study)


def test_no_work_is_none_and_says_when_to_ask_again() -> None:
    idle = client(always(204, headers={"Retry-After": "3"}))
    assert idle.lease(worker={"id": "w"}, models=["ishigami"], max_instances=4) is None
    assert idle.retry_after == 3.0


def test_verdicts_come_back_even_when_some_results_are_refused() -> None:
    verdicts = [{"instance": "i", "verdict": "conflict", "detail": "another value is there"}]
    answered = client(always(409, json={"verdicts": verdicts, "title": "Conflict"})).post_results(
        lease="l", fence=1, worker="w", results=[{"instance": "i"}]
    )
    assert answered == verdicts


def test_an_exchange_posts_results_and_asks_for_more_in_one_request() -> None:
    asked: list[Any] = []

    def answer(request: httpx2.Request) -> httpx2.Response:
        asked.append((request.url.path, json.loads(request.content)))
        told = {"verdicts": [], "next": None, "misfit": "begun with MuJoCo 3"}
        return httpx2.Response(409, json=told, headers={"Retry-After": "7"})

    request = {"worker": {"id": "w"}, "models": ["ishigami"], "max_instances": 4}
    talking = client(answer)
    said = {"lease": "l", "fence": 1, "worker": "w", "results": [{"instance": "i"}]}
    assert talking.exchange(**said, request=request) == {
        "verdicts": [],
        "next": None,
        "misfit": "begun with MuJoCo 3",
    }
    assert asked == [("/v1/results", {**said, "next": request})]
    assert talking.retry_after == 7.0


def test_waiting_ends_with_the_study_and_its_indices_and_reports_on_the_way() -> None:
    states, rows = iter(["running", "running", "complete"]), iter([3, 7, 8])
    seen: list[str] = []

    def answer(request: httpx2.Request) -> httpx2.Response:
        if request.url.path.endswith("/indices"):
            return httpx2.Response(200, json={"rows_complete": next(rows)})
        return httpx2.Response(200, json={"state": next(states), "rows": 8})

    last = client(answer).wait(
        "s1", poll_seconds=0.0, on_progress=lambda progress: seen.append(progress["state"])
    )
    assert last == {"state": "complete", "rows": 8}
    assert seen == ["running", "running", "complete"]
    assert list(rows) == []


def test_waiting_for_indices_ends_where_no_analysis_follows() -> None:
    clock = Clock()
    stale = {"state": "complete", "rows": 8, "rows_complete": 0}
    last = client(always(200, json=stale)).wait("s1", clock=clock, sleep=clock.advance)
    assert last["state"] == "complete"
    assert clock.now == pytest.approx(1_000_000.0 + ANALYSIS_SECONDS, abs=0.3)


def test_results_are_downloaded_to_a_file(tmp_path: Path) -> None:
    client(always(200, text="row,position\n0,0\n")).results_csv("s1", tmp_path / "r.csv")
    assert (tmp_path / "r.csv").read_text() == "row,position\n0,0\n"


def test_a_download_that_fails_leaves_no_file_behind(tmp_path: Path) -> None:
    with pytest.raises(NotFound, match="no study"):
        client(always(404, json={"detail": "no study s1"})).results_csv("s1", tmp_path / "r.csv")
    assert list(tmp_path.iterdir()) == []


def test_a_long_body_is_sent_compressed_and_a_short_one_as_it_is() -> None:
    encodings: list[str | None] = []

    def answer(request: httpx2.Request) -> httpx2.Response:
        encodings.append(request.headers.get("Content-Encoding"))
        body = gzip.decompress(request.content) if encodings[-1] else request.content
        verdicts = [{"instance": r["instance"]} for r in json.loads(body)["results"]]
        return httpx2.Response(200, json={"verdicts": verdicts})

    for count in (1, 900):
        results = [{"instance": str(i), "reason": "x" * 100} for i in range(count)]
        verdicts = client(answer).post_results(lease="l", fence=1, worker="w", results=results)
        assert [v["instance"] for v in verdicts] == [str(i) for i in range(count)]
    assert encodings == [None, "gzip"]


def test_a_path_that_is_not_there_is_one_error_of_ours(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    asking = client(always(200, json={}))
    for ask in (asking.upload_session, asking.add_model, asking.analyse):
        with pytest.raises(Invalid, match=r"nothere\.zip: No such file or directory"):
            ask("nothere.zip")
        with pytest.raises(Invalid, match=r"\.: Is a directory"):
            ask(".")
    with pytest.raises(Invalid, match=r"nowhere/r\.csv: No such file or directory"):
        asking.results_csv("s1", "nowhere/r.csv")
