"""What `study indices` prints of a study that a coordinator has."""

from collections.abc import Callable

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
