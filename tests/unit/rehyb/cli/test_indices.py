"""What `study indices` prints of a study that a coordinator has."""

from collections.abc import Callable

import pytest

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
