"""What `study indices`, `study surrogate` and `report` print of a study that a coordinator has."""

import csv
import io
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import httpx2
import pytest

from analysis.designs import instance_parameters
from analysis.designs.distributions import Uniform
from analysis.sensitivity.records import LoggedResult, plan_of
from analysis.sensitivity.service import analyse
from rehyb.cli import main
from rehyb.client import Client

Run = Callable[..., tuple[int, str, str]]

RANGES = {"x1": Uniform(low=0.0, high=1.0), "x2": Uniform(low=0.0, high=1.0)}
STUDY: dict[str, Any] = {
    "id": "s1",
    "name": "try",
    "model": "ishigami",
    "method": "saltelli",
    "sampling": "sobol",
    "rows": 8,
    "seed": 1,
    "factors": [{"name": name, "distribution": d.to_json()} for name, d in RANGES.items()],
    "fixed": {"x3": 0.0},
    "outputs": ["y"],
}


def computed() -> tuple[str, dict[str, Any]]:
    """Return the study's table and its snapshot; y = 3 x1 + x2."""
    text = io.StringIO()
    lines = csv.writer(text)
    lines.writerow(["row", "position", *RANGES, "outcome", "y"])
    results = []
    for row in range(8):
        points = instance_parameters("saltelli", "sobol", 1, row, RANGES)
        for position, x in enumerate(points):
            y = 3.0 * x["x1"] + x["x2"]
            lines.writerow([row, position, *x.values(), "ok", y])
            results.append(
                LoggedResult(
                    seq=len(results) + 1,
                    instance="",
                    row=row,
                    position=position,
                    outcome="ok",
                    outputs={"y": y},
                )
            )
    return text.getvalue(), analyse(plan_of(STUDY), results)


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Run the command beside a coordinator that has the study."""
    table, snapshot = computed()

    def answer(request: httpx2.Request) -> httpx2.Response:
        if request.url.path.endswith("/results.csv"):
            return httpx2.Response(200, text=table)
        return httpx2.Response(
            200, json=snapshot if request.url.path.endswith("/indices") else STUDY
        )

    mocked = partial(Client, transport=httpx2.MockTransport(answer))
    for module in ("studies", "surrogates", "reports"):
        monkeypatch.setattr(f"rehyb.cli.{module}.Client", mocked)
    monkeypatch.setenv("REHYB_TOKEN", "t")
    monkeypatch.setenv("COLUMNS", "200")

    def run(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["rehyb", *arguments])
        status = 0
        try:
            main()
        except SystemExit as leaving:
            status = int(leaving.code or 0)
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run


def test_indices_come_with_their_ranking_and_how_many_rows_are_wanted(run: Run) -> None:
    status, out, _ = run("study", "indices", "s1", "--target", "0.01")
    assert status == 0
    assert "8 of 8 rows are complete" in out
    assert "with x1 first." in out
    assert "more rows" in out and "bring y to ±0.01" in out


def test_a_surrogate_stands_beside_the_sampled_indices(run: Run) -> None:
    status, out, _ = run("study", "surrogate", "s1")
    assert status == 0
    assert out.index("x1") < out.index("x2")
    assert "0.900, 0.900" in out and "ST sampled" in out
    assert "the surrogate's indices are worth reading" in out
    answer = json.loads(run("study", "surrogate", "s1", "--json")[1])
    assert answer["fit"]["runs"] == 32 and answer["outliers"] == []
    status, _, err = run("study", "surrogate", "s1", "--output", "z")
    assert (status, err) == (2, "rehyb: the study has no output 'z': it has y\n")


def test_a_report_says_which_files_it_wrote(run: Run, tmp_path: Path) -> None:
    status, out, _ = run("report", "s1", "--out", str(tmp_path / "r.html"), "--json")
    assert (status, json.loads(out)) == (0, {"files": [str(tmp_path / "r.html")]})
