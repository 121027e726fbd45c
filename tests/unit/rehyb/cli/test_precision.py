"""A study is seen through to its precision: extended step by step, never past its cap."""

import copy
import json
import sys
from collections.abc import Callable
from functools import cache, partial
from typing import Any, cast

import httpx2
import pytest

from analysis.sensitivity.judgement.stopping import Goal, next_step
from rehyb.cli.study.precision import wait_for_precision
from rehyb.client import Client, Json
from rehyb.errors import Conflict, Invalid
from tests.testbed.clock import Clock
from tests.testbed.coordinators.finished_study import STUDY, FinishedStudy
from tests.testbed.transport import CoordinatorTransport


class Coordinator:
    """Computes a study at once; judges its goal whenever it is asked how far it is."""

    def __init__(self, rows: int = 32) -> None:
        self.rows = rows
        self.state = "complete"
        self.extensions: list[int] = []
        self.goal: dict[str, Any] | None = None

    def client(self) -> Client:
        return Client("http://c", "t", transport=CoordinatorTransport(self))

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        path = request.url.path
        asked = json.loads(request.content) if request.content else {}
        wanted = asked if path.endswith("/precision") else asked.get("precision")
        if wanted is not None:
            output = wanted.get("output") or "y"
            if output != "y":
                return httpx2.Response(422, json={"detail": f"no output {output!r}: it has y"})
            self.goal = {
                **wanted,
                "output": output,
                "settled": False,
                "reached": False,
                "steps": [],
            }
        study = {"id": "s1", "name": "n", "rows": self.rows, "outputs": ["y"], "instances": 1}
        progress = {"state": self.state, "ok": 1, "failed": 0, "rows_complete": 1, "workers": 1}
        rate = {"results_per_second": 1.0, "eta_seconds": 0.0, "failures": {}}
        body = study | progress | rate | {"precision": copy.deepcopy(self.goal)}
        if path.endswith("/progress"):
            self._judge()
        return httpx2.Response(200, json=body)

    def _judge(self) -> None:
        goal = self.goal
        if goal is None or goal["settled"] or self.state != "complete":
            return
        wanted = Goal(output="y", target=goal["target"], up_to=goal["up_to"])
        step = next_step(indices(self.rows), wanted, self.rows)
        assert step is not None
        goal["steps"].append({"sentence": step.sentence})
        goal["settled"], goal["reached"] = step.rows is None, step.reached
        if step.rows is not None:
            self.rows = step.rows
            self.extensions.append(self.rows)


def at_once(seconds: float) -> None:
    """Do not wait."""


@cache
def indices(rows: int) -> dict[str, Any]:
    """Return the snapshot of a study of the Ishigami function."""
    return FinishedStudy(STUDY | {"rows": rows, "seed": 1}, lost=()).indices


def test_a_study_with_a_goal_is_watched_until_it_is_precise() -> None:
    coordinator, said = Coordinator(), list[str]()
    client = coordinator.client()
    client.set_precision_goal("s1", 10_000, 0.15)
    found = client.wait_for_precision("s1", on_step=said.append, sleep=at_once)
    assert found["reached"] and found["rows"] == coordinator.rows
    assert coordinator.extensions == [64, 128, 256, 512][: len(coordinator.extensions)]
    assert len(coordinator.extensions) >= 2
    assert said[0].startswith("It is extended to 64 rows. At most about")
    assert said[-1].startswith("Every index of y is within ±0.15")
    # It is told again from the start, and the study is left as it is.
    again = list[str]()
    assert client.wait_for_precision("s1", on_step=again.append, sleep=at_once) == found
    assert again == said


def test_waiting_for_a_study_waits_for_its_goal() -> None:
    coordinator, clock = Coordinator(), Clock()
    client = coordinator.client()
    wait = partial(client.wait, "s1", clock=clock, sleep=clock.advance)
    assert wait()["rows"] == 32
    client.set_precision_goal("s1", 128, 0.001, "y")
    assert wait()["rows"] == 128
    assert client.submit({"precision": {"target": 9.0, "up_to": 300}})["rows"] == 128
    assert wait()["precision"]["reached"]


def test_no_goal_a_cancelled_study_and_an_unknown_output_are_errors() -> None:
    coordinator = Coordinator(rows=4)
    client = coordinator.client()
    with pytest.raises(Invalid, match="s1 has no precision to reach: say one with --up-to"):
        client.wait_for_precision("s1", sleep=at_once)
    with pytest.raises(Invalid, match="no output 'z'"):
        client.set_precision_goal("s1", 9, 0.1, "z")
    client.set_precision_goal("s1", 9)
    coordinator.state = "cancelled"
    with pytest.raises(Conflict, match="was cancelled"):
        client.wait_for_precision("s1", sleep=at_once)


def test_the_command_says_what_it_decides_and_by_its_status_whether_it_got_there(
    run: Callable[..., tuple[int, str, str]],
    talk_to: Callable[[Coordinator], None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    talk_to(Coordinator())
    monkeypatch.setattr("rehyb.client.studies.POLL_SECONDS", 0.0)

    def study(command: str) -> tuple[int, str, str]:
        return run("study", *command.split())

    status, out, _ = study("watch s1 --up-to 64 --target 0.001")
    assert status == 1 and "It has its 64 rows" in out
    status, out, _ = study("watch s1 --up-to 128 --target 9 --json")
    answer = json.loads(out)
    assert status == 0
    assert (answer["study"], answer["rows"], answer["reached"]) == ("s1", 128, True)
    assert study("watch s1")[0] == 0
    status, _, err = study("watch s1 --target 9")
    assert status == 2 and "--target and --output need --up-to" in err
    submit = "submit --model ishigami --method saltelli --rows 4"
    status, out, _ = study(f"{submit} --target 9 --up-to 128")
    assert status == 0 and "Every index of y is within ±9" in out
    status, _, err = study(f"{submit} --target 9")
    assert status == 2 and "--target needs --up-to" in err


def test_a_goal_that_nobody_judges_says_who_would_once_that_takes_long(
    capsys: pytest.CaptureFixture[str],
) -> None:
    coordinator, clock = Coordinator(), Clock()
    coordinator.state = "running"
    client = coordinator.client()
    client.set_precision_goal("s1", 10_000, 0.15)
    progress = client.progress("s1")

    class Unjudged:
        def wait_for_precision(
            self, study: str, on_progress: Callable[[Json], None], **_: Any
        ) -> Json:
            polls = (("running", 1.0), ("running", 60.0), ("complete", 1.0), ("complete", 9.0))
            for state, seconds in (*polls, ("complete", 1.0)):
                clock.advance(seconds)
                print(f"{state} after {seconds} s", file=sys.stderr)
                on_progress(progress | {"state": state})
            return {"reached": False}

    wait_for_precision(cast(Client, Unjudged()), "s1", as_json=False, clock=clock)
    said = capsys.readouterr().err.splitlines()
    waits = "its precision waits for an analysis: if none runs, start `rehyb analysis`"
    assert waits in said[-1]
    assert not any(waits in line for line in said[:-1])
