"""What `study indices` prints of a study that a coordinator has."""

from collections.abc import Callable

import pytest

from analysis.sensitivity.snapshot import empty_snapshot
from tests.testbed.coordinators.finished_study import FinishedStudy, weighted_sum

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(autouse=True)
def coordinator(talk_to: Callable[[FinishedStudy], None], monkeypatch: pytest.MonkeyPatch) -> None:
    """A coordinator with a study of a weighted sum."""
    monkeypatch.setenv("COLUMNS", "200")
    talk_to(weighted_sum())


def test_indices_come_with_their_ranking_and_how_many_rows_are_wanted(run: Run) -> None:
    status, out, _ = run("study", "indices", "s1", "--target", "0.01")
    assert status == 0
    assert "8 of 8 rows are complete" in out
    assert "with x1 first." in out
    assert "more rows" in out and "bring y to ±0.01" in out


def test_a_half_width_that_says_nothing_of_a_share_is_refused(run: Run) -> None:
    status, _, err = run("study", "indices", "s1", "--target", "1.5")
    assert status == 2
    assert "--target must be below 0.5, not 1.5" in err


def test_indices_that_no_analysis_keeps_up_to_date_say_so_and_what_to_start(
    run: Run, talk_to: Callable[[FinishedStudy], None]
) -> None:
    behind = weighted_sum()
    behind.indices = empty_snapshot(behind.plan)
    talk_to(behind)
    # A moment later it may be at work.
    _, out, _ = run("study", "indices", "s1")
    assert "8 of 8 rows are complete; the indices are of 0 of them" in out
    assert "wait" not in out
    behind.progress["left_by_analysis"] = len(behind.results)
    _, out, _ = run("study", "indices", "s1")
    assert f"{len(behind.results)} results wait for an analysis: if none runs, start" in out
    assert "`rehyb analysis` (or `rehyb up`)" in out
