"""A study is seen through to its precision: extended step by step, never past its cap."""

import json
from functools import partial
from typing import Any

import httpx2
import pytest
from finished_study import RANGES

from analysis.designs import instance_parameters
from analysis.records import LoggedResult, StudyPlan
from analysis.service import analyse
from rehyb.cli import main
from rehyb.client import Client
from rehyb.errors import Conflict, Invalid
from rehyb.precision import Goal, watch
from sim.evaluation import evaluate


class Coordinator:
    """Computes a study at once whenever it is extended; its analysis lags one call behind."""

    def __init__(self, rows: int = 32) -> None:
        self.rows = rows
        self.state = "complete"
        self.extensions: list[int] = []
        self._lag = True

    def client(self) -> Client:
        return Client("http://c", "t", transport=httpx2.MockTransport(self))

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        if request.url.path.endswith("/extend"):
            self.rows = json.loads(request.content)["rows"]
            self.extensions.append(self.rows)
            self._lag = True
        if request.url.path.endswith("/indices"):
            seen = self.rows - 1 if self._lag else self.rows
            self._lag = False
            return httpx2.Response(200, json=indices(seen))
        study = {"id": "s1", "name": "n", "rows": self.rows, "outputs": ["y"], "instances": 1}
        progress = {"state": self.state, "ok": 1, "failed": 0, "rows_complete": 1, "workers": 1}
        rate = {"results_per_second": 1.0, "eta_seconds": 0.0, "failures": {}}
        return httpx2.Response(200, json=study | progress | rate)


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
    monkeypatch.setattr("rehyb.precision.POLL_SECONDS", 0.0)


def test_a_study_is_extended_until_it_is_precise() -> None:
    coordinator, said = Coordinator(), list[str]()
    goal = Goal(output="y", target=0.15, most_rows=10_000)
    step = watch(coordinator.client(), "s1", goal, on_step=lambda s: said.append(s.sentence))
    assert step.reached
    assert coordinator.extensions == [64, 128, 256, 512][: len(coordinator.extensions)]
    assert len(coordinator.extensions) >= 2
    assert said[0].startswith("It is extended to 64 rows. At most about")
    assert said[-1].startswith("Every index of y is within ±0.15")
    # What is precise already is left as it is.
    before = list(coordinator.extensions)
    assert watch(coordinator.client(), "s1", goal).reached
    assert coordinator.extensions == before


def test_a_study_stops_at_its_cap() -> None:
    coordinator = Coordinator()
    goal = Goal(output="y", target=0.001, most_rows=100)
    step = watch(coordinator.client(), "s1", goal)
    assert not step.reached
    assert coordinator.extensions == [64, 100]
    assert step.sentence.startswith("It has its 100 rows, and 100 at most were allowed. At most")


def test_a_cancelled_study_and_an_unknown_output_are_errors() -> None:
    coordinator = Coordinator(rows=4)
    with pytest.raises(Invalid, match="has no output 'z': it has y"):
        watch(coordinator.client(), "s1", Goal(output="z", target=0.1, most_rows=9))
    coordinator.state = "cancelled"
    with pytest.raises(Conflict, match="was cancelled"):
        watch(coordinator.client(), "s1", Goal(output="y", target=0.1, most_rows=9))


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
    study = "study submit --model ishigami --method saltelli --rows 4"
    assert run(f"{study} --target 9 --up-to 64") == 0
    assert "Every index of y is within ±9" in capsys.readouterr().out
    assert run(f"{study} --target 9") == 2
    assert "--target needs --up-to" in capsys.readouterr().err
