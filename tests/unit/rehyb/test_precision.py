"""A study is seen through to its precision: extended step by step, never past its cap."""

import copy
import json
from functools import partial
from typing import Any

import httpx2
import pytest

from analysis.designs import instance_parameters
from analysis.sensitivity.records import LoggedResult, StudyPlan
from analysis.sensitivity.service import analyse
from analysis.sensitivity.stopping import Goal, next_step
from rehyb.cli import main
from rehyb.client import Client
from rehyb.client.precision import decide, watch
from rehyb.errors import Conflict, Invalid
from sim.evaluation import evaluate
from tests.testbed.finished_study import RANGES


class Coordinator:
    """Computes a study at once; judges its goal whenever it is asked how far it is."""

    def __init__(self, rows: int = 32) -> None:
        self.rows = rows
        self.state = "complete"
        self.extensions: list[int] = []
        self.goal: dict[str, Any] | None = None

    def client(self) -> Client:
        return Client("http://c", "t", transport=httpx2.MockTransport(self))

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


def indices(rows: int) -> dict[str, Any]:
    """Return the snapshot of a study of the Ishigami function."""
    plan = StudyPlan(
        id="s1",
        method="saltelli",
        seed=1,
        sampling="sobol",
        rows=rows,
        factors=tuple(RANGES),
        outputs=("y",),
    )
    results = []
    for row in range(rows):
        for position, x in enumerate(instance_parameters("saltelli", "sobol", 1, row, RANGES)):
            result = LoggedResult(
                seq=len(results) + 1,
                instance="",
                row=row,
                position=position,
                outcome="ok",
                outputs=evaluate("ishigami", x).outputs,
            )
            results.append(result)
    return analyse(plan, results)


@pytest.fixture(autouse=True)
def no_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rehyb.client.precision.POLL_SECONDS", 0.0)


def test_a_study_with_a_goal_is_watched_until_it_is_precise() -> None:
    coordinator, said = Coordinator(), list[str]()
    client = coordinator.client()
    client.aim("s1", 10_000, 0.15)
    found = watch(client, "s1", on_step=said.append)
    assert found["reached"] and found["rows"] == coordinator.rows
    assert coordinator.extensions == [64, 128, 256, 512][: len(coordinator.extensions)]
    assert len(coordinator.extensions) >= 2
    assert said[0].startswith("It is extended to 64 rows. At most about")
    assert said[-1].startswith("Every index of y is within ±0.15")
    # It is told again from the start, and the study is left as it is.
    again = list[str]()
    assert watch(client, "s1", on_step=again.append) == found
    assert again == said


def test_waiting_for_a_study_waits_for_its_goal() -> None:
    coordinator = Coordinator()
    client = coordinator.client()
    assert client.wait("s1", poll_seconds=0.0)["rows"] == 32
    client.aim("s1", 128, 0.001, "y")
    assert client.wait("s1", poll_seconds=0.0)["rows"] == 128
    assert client.submit({"precision": {"target": 9.0, "up_to": 300}})["rows"] == 128
    assert client.wait("s1", poll_seconds=0.0)["precision"]["reached"]


def test_no_goal_a_cancelled_study_and_an_unknown_output_are_errors() -> None:
    coordinator = Coordinator(rows=4)
    client = coordinator.client()
    with pytest.raises(Invalid, match="s1 has no precision to reach: say one with --up-to"):
        watch(client, "s1")
    with pytest.raises(Invalid, match="no output 'z'"):
        client.aim("s1", 9, 0.1, "z")
    client.aim("s1", 9)
    coordinator.state = "cancelled"
    with pytest.raises(Conflict, match="was cancelled"):
        watch(client, "s1")


def test_what_a_complete_study_does_next_waits_for_the_analysis() -> None:
    goal = Goal(output="y", target=0.001, up_to=100)
    assert decide(indices(31), 32, goal) is None
    step = decide(indices(32), 32, goal)
    assert step is not None and step.rows == 64
    with pytest.raises(Invalid, match="has no output 'z': it has y"):
        decide(indices(4), 4, Goal(output="z", target=0.1, up_to=9))


def test_the_command_says_what_it_decides_and_by_its_status_whether_it_got_there(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    coordinator = Coordinator()
    monkeypatch.setenv("REHYB_TOKEN", "t")
    mocked = partial(Client, transport=httpx2.MockTransport(coordinator))
    monkeypatch.setattr("rehyb.cli.precision.Client", mocked)
    monkeypatch.setattr("rehyb.cli.studies.Client", mocked)

    def run(command: str) -> int:
        monkeypatch.setattr("sys.argv", ["rehyb", *command.split()])
        with pytest.raises(SystemExit) as leaving:
            main()
        return int(leaving.value.code or 0)

    assert run("study watch s1 --up-to 64 --target 0.001") == 1
    assert "It has its 64 rows" in capsys.readouterr().out
    assert run("study watch s1 --up-to 64 --target 9 --json") == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["study"], answer["rows"], answer["reached"]) == ("s1", 64, True)
    assert run("study watch s1") == 0
    assert run("study watch s1 --target 9") == 2
    assert "--target and --output need --up-to" in capsys.readouterr().err
    study = "study submit --model ishigami --method saltelli --rows 4"
    assert run(f"{study} --target 9 --up-to 64") == 0
    assert "Every index of y is within ±9" in capsys.readouterr().out
    assert run(f"{study} --target 9") == 2
    assert "--target needs --up-to" in capsys.readouterr().err
