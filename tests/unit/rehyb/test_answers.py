"""What `study indices`, `study surrogate` and `report` print of a study that a coordinator has."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from analysis.designs.distributions import Uniform
from tests.testbed.finished_study import STUDY, FinishedStudy

Run = Callable[..., tuple[int, str, str]]

UNIT = Uniform(low=0.0, high=1.0).to_json()
SUM = STUDY | {
    "rows": 8,
    "seed": 1,
    "factors": [{"name": name, "distribution": UNIT} for name in ("x1", "x2")],
    "fixed": {"x3": 0.0},
}


@pytest.fixture(autouse=True)
def coordinator(talk_to: Callable[[FinishedStudy], None], monkeypatch: pytest.MonkeyPatch) -> None:
    """A coordinator with a study of a weighted sum."""
    monkeypatch.setenv("COLUMNS", "200")
    talk_to(FinishedStudy(SUM, lambda x: {"y": 3.0 * x["x1"] + x["x2"]}, lost=()))


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
