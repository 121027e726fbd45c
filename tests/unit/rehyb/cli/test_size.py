"""A study of very many instances is taken from the command line only if they are meant."""

import io
import json
from collections.abc import Callable
from typing import Any

import httpx2
import pytest

from rehyb.client import Client
from sim.models import MODELS
from tests.testbed.transport import CoordinatorTransport

Run = Callable[..., tuple[int, str, str]]

#: Three factors, so that a row of morris has four instances.
ISHIGAMI = MODELS["ishigami"].as_json()
HUGE = ("study", "submit", "--model", "ishigami", "--method", "morris", "--rows", "99999999")
SAID = (
    "rehyb: that makes 399,999,996 instances, of which each takes a core 0.4 s if it is like the "
    "elbow's (1,852 days of one core), and in the coordinator's database 96.0 to 256.0 GB in all"
)


@pytest.fixture
def posted(talk_to: Callable[..., None]) -> list[Any]:
    """A coordinator that takes everything; what it was sent."""
    bodies: list[Any] = []
    study = {"id": "s1", "name": "n", "rows": 10, "instances": 50, "state": "running"}

    def answer(request: httpx2.Request) -> httpx2.Response:
        if request.method == "POST":
            bodies.append(json.loads(request.content))
        model = request.url.path == "/v1/models/ishigami"
        there = model or request.url.path.startswith("/v1/studies")
        body = ISHIGAMI if model else study | {"priority": 0}
        missing = httpx2.Response(404, json={"detail": "there is no such model"})
        return httpx2.Response(200, json=body) if there else missing

    talk_to(answer)
    return bodies


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Sit at a terminal and type that."""

    def typed(text: str) -> None:
        terminal = io.StringIO(text)
        terminal.isatty = lambda: True  # type: ignore[method-assign]
        monkeypatch.setattr("sys.stdin", terminal)

    return typed


def test_nobody_at_a_terminal_is_told_what_to_type(run: Run, posted: list[Any]) -> None:
    assert run(*HUGE) == (2, "", f"{SAID}: if you mean it, say --yes\n")
    assert posted == []


def test_whoever_says_yes_is_not_asked(run: Run, posted: list[Any]) -> None:
    assert run(*HUGE, "--yes")[0] == 0
    assert posted[0]["rows"] == 99999999


@pytest.mark.parametrize(("answer", "status", "sent"), [("y\n", 0, 1), ("n\n", 1, 0), ("\n", 1, 0)])
def test_at_a_terminal_it_is_asked(
    run: Run,
    posted: list[Any],
    typed: Callable[[str], None],
    answer: str,
    status: int,
    sent: int,
) -> None:
    typed(answer)
    ended, _, said = run(*HUGE)
    assert (ended, len(posted)) == (status, sent)
    assert f"{SAID}. Is that what you want? [y/N]" in said


@pytest.mark.parametrize(
    ("more", "instances"),
    [
        (("--rows", "250000"), 0),
        (("--rows", "250001"), 1_000_004),
        (("--rows", "500000", "--fix", "x1=0", "--fix", "x2=0"), 0),
        (("--rows", "500000", "--factor", "x1=0:1"), 0),
        (("--rows", "333333", "--group", "g=x1,x2"), 0),
        (("--rows", "10", "--target", "0.1", "--up-to", "300000"), 1_200_000),
        # The coordinator says what is wrong with it.
        (("--rows", "500000", "--method", "moris"), 0),
        (("--rows", "500000", "--model", "nothing"), 0),
    ],
)
def test_instances_are_counted_as_the_coordinator_counts_them(
    run: Run, posted: list[Any], more: tuple[str, ...], instances: int
) -> None:
    asked = ("study", "submit", "--model", "ishigami", "--method", "morris", *more)
    status, _, said = run(*asked)
    assert status == (2 if instances else 0), said
    assert len(posted) == (0 if instances else 1)
    assert not instances or f"that makes {instances:,} instances" in said


@pytest.mark.parametrize(
    "command", ["extend s1 --rows 200001", "watch s1 --target 0.1 --up-to 200001"]
)
def test_more_rows_of_a_study_that_is_there_are_asked_about(
    run: Run, posted: list[Any], command: str
) -> None:
    status, _, said = run("study", *command.split())
    assert (status, posted) == (2, [])
    assert "that makes 1,000,005 instances" in said


def test_a_script_is_never_asked() -> None:
    taken = CoordinatorTransport(lambda request: httpx2.Response(201, json={"id": "s1"}))
    with Client("http://c", "t", transport=taken) as client:
        study = client.submit({"model": "ishigami", "method": "morris", "rows": 99999999})
    assert study == {"id": "s1"}
