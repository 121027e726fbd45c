"""The commands for a study under way ask the right thing and show the answer."""

import io
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import httpx2
import pytest

from rehyb import Client

Run = Callable[..., tuple[int, str, str]]

STUDY = {"id": "s1", "state": "paused", "rows": 9, "instances": 36, "priority": 3}
FAILED = {"row": 1, "position": 2, "outcome": "slipped", "reason": "no grip", "worker": "w"}


class Coordinator:
    """Answers in two pages, and remembers what it was asked."""

    def __init__(self) -> None:
        self.asked: list[str] = []
        self.bodies: list[Any] = []

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        self.asked.append(f"{request.method} {request.url.raw_path.decode()}")
        self.bodies.append(json.loads(request.content) if request.content else None)
        if request.method == "DELETE":
            return httpx2.Response(204)
        if request.url.path.endswith("/instances"):
            first = "after" not in str(request.url)
            page = {"instances": [FAILED], "next": "1:2" if first else None}
            return httpx2.Response(200, json=page)
        if "/instances/" in request.url.path:
            bundle = {"model": "elbow", "parameters": {"forearm_mass": -1.0}}
            return httpx2.Response(200, json=bundle)
        return httpx2.Response(200, json={**STUDY, "taken_back": 4})


@pytest.fixture
def coordinator(talk_to: Callable[[Coordinator], None]) -> Coordinator:
    coordinator = Coordinator()
    talk_to(coordinator)
    return coordinator


@pytest.mark.parametrize(
    ("command", "asked", "body", "said"),
    [
        ("drain s1", "POST /v1/studies/s1/drain", None, "s1 is paused: 9 rows, 36 instances"),
        ("pause s1", "POST /v1/studies/s1/pause", None, "s1 is paused: 9 rows, 36 instances"),
        ("resume s1", "POST /v1/studies/s1/resume", None, "priority 3"),
        ("extend s1 --rows 9", "POST /v1/studies/s1/extend", {"rows": 9}, "9 rows"),
        ("settle s1", "DELETE /v1/studies/s1/precision", None, "s1 is extended no more"),
        ("priority s1 3", "POST /v1/studies/s1/priority", {"priority": 3}, "priority 3"),
        (
            "rerun s1 --outcome lost",
            "POST /v1/studies/s1/rerun",
            {"which": "failed", "outcomes": ["lost"]},
            "4 results were taken back; s1 is paused",
        ),
        (
            "rerun s1 --which all",
            "POST /v1/studies/s1/rerun",
            {"which": "all", "outcomes": None},
            "4 results were taken back",
        ),
        ("delete s1", "DELETE /v1/studies/s1", None, "s1 is deleted"),
    ],
)
def test_a_verb_asks_once_and_says_what_is_now(
    coordinator: Coordinator,
    run: Run,
    command: str,
    asked: str,
    body: Any,
    said: str,
) -> None:
    status, words, _ = run("study", *command.split())
    assert (status, coordinator.asked, coordinator.bodies) == (0, [asked], [body])
    assert said in words


def test_failures_are_read_to_the_last_page(coordinator: Coordinator, run: Run) -> None:
    status, words, _ = run("study", "failures", "s1", "--json")
    assert (status, json.loads(words)) == (0, {"instances": [FAILED, FAILED]})
    assert [path.partition("?")[2] for path in coordinator.asked] == [
        "state=failed&limit=500",
        "state=failed&after=1%3A2&limit=500",
    ]
    assert "no grip" in run("study", "failures", "s1")[1]
    run("study", "failures", "s1", "--quarantined")
    assert "state=quarantined&limit=500" in coordinator.asked[-2]


def test_a_bundle_is_written_for_a_replay_which_reads_its_parameters(
    coordinator: Coordinator, run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    file = tmp_path / "bundle.json"
    assert run("study", "instance", "s1", "1", "2", "--out", str(file))[0] == 0
    status, _, words = run("assess", "--replay", str(file))
    assert (status, "forearm_mass must be positive" in words) == (2, True)
    monkeypatch.setattr("sys.stdin", io.StringIO('{"model": "ishigami", "parameters": {}}'))
    status, _, words = run("assess", "--replay", "-")
    assert (status, "is of model 'ishigami', which is no assessment" in words) == (2, True)


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("study delete s1/precision", "there is no study 's1/precision'"),
        ("study cancel s1/pause?", "there is no study 's1/pause?'"),
        ("study delete ../sessions/x", "there is no study '../sessions/x'"),
        ("study indices ../../etc", "there is no study '../../etc'"),
        ("study indices s1?x=1", "there is no study 's1?x=1'"),
        ("model show ../studies/s1", "there is no model '../studies/s1'"),
    ],
)
def test_an_id_that_is_none_is_said_and_nothing_is_asked(
    coordinator: Coordinator, run: Run, command: str, said: str
) -> None:
    assert run(*command.split()) == (1, "", f"rehyb: {said}\n")
    assert coordinator.asked == []


@pytest.mark.parametrize("command", ["study list", "study show x", "workers", "model list"])
def test_a_stranger_s_json_is_not_shown(
    run: Run, monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    def answer(request: httpx2.Request) -> httpx2.Response:
        return httpx2.Response(200, json={"models": 1, "id": "a stranger's"})

    mocked = partial(Client, "http://lab", transport=httpx2.MockTransport(answer))
    monkeypatch.setattr("rehyb.cli.answers.Client", lambda _url, token: mocked(token))
    status, words, said = run(*command.split())
    assert (status, words) == (1, "")
    assert said.startswith("rehyb: http://lab answers, but is no coordinator of rehyb; ")


@pytest.mark.parametrize("columns", ["300", "40"])
@pytest.mark.parametrize(
    "command", ["study list", "study failures s", "model list", "study show s"]
)
def test_what_would_not_be_seen_on_a_terminal_is_written_out(
    run: Run,
    talk_to: Callable[[Any], None],
    monkeypatch: pytest.MonkeyPatch,
    command: str,
    columns: str,
) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    name = "a\u202eb\x1b[2Jc"
    model = {"name": "m", "own": False, "kind": "command", "digest": "d", "factors": []}
    said = {
        "id": "s",
        "name": name,
        "studies": [{"id": "s", "name": name}],
        "instances": [{**FAILED, "reason": name}],
        "models": [{**model, "description": name}],
        "next": None,
    }
    talk_to(lambda request: httpx2.Response(200, json=said))
    status, words, _ = run(*command.split())
    assert status == 0
    assert "a\\u202eb\\u001b[2Jc" in words
    assert not {"\u202e", "\x1b"} & set(words)


def test_a_refusal_is_written_as_it_would_be_seen(run: Run, talk_to: Callable[[Any], None]) -> None:
    talk_to(lambda request: httpx2.Response(404, json={"detail": "there is no study 'a\u202eb'"}))
    assert run("study", "show", "s") == (1, "", "rehyb: there is no study 'a\\u202eb'\n")
