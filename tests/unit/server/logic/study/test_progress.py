"""How fast a study goes."""

from collections.abc import Callable
from itertools import accumulate
from math import sqrt
from random import Random
from typing import Any

import pytest

from server.logic.study.progress import (
    BLOCKS,
    RATE_WINDOW,
    block_ends,
    first_left,
    pace,
    window_start,
)
from server.records import Plan, Study


@pytest.fixture
def study(plan: Callable[..., Plan]) -> Callable[..., Study]:
    """A study of 4000 instances, created at 100 s."""

    def make(**changes: Any) -> Study:
        standing: dict[str, Any] = {
            "state": "running",
            "finished_at": None,
            "handed_out": 0,
            "leased": 0,
            "result_count": 0,
            "ok_count": 0,
            "rows_complete": 0,
        }
        return Study(
            id="s",
            plan=plan(rows=1000),
            created_at=100.0,
            failures={},
            **{**standing, **changes},
        )

    return make


def test_nothing_is_foretold_before_the_first_result(study: Callable[..., Study]) -> None:
    speed = pace(study(), window_opened_at=100.0, now=130.0)
    assert (speed.results_per_second, speed.eta_seconds, speed.elapsed_seconds) == (0.0, None, 30.0)


def test_the_first_results_are_counted_from_the_start(study: Callable[..., Study]) -> None:
    speed = pace(study(result_count=400), window_opened_at=100.0, now=120.0)
    assert speed.results_per_second == 20.0
    assert speed.eta_seconds == 180.0


def test_later_only_the_last_results_count(study: Callable[..., Study]) -> None:
    speed = pace(study(result_count=3000), window_opened_at=190.0, now=200.0)
    assert speed.results_per_second == RATE_WINDOW / 10.0
    assert speed.eta_seconds == 1000 / (RATE_WINDOW / 10.0)


def test_silence_lowers_the_rate(study: Callable[..., Study]) -> None:
    running = study(result_count=400)
    rates = [
        pace(running, window_opened_at=100.0, now=now).results_per_second for now in (110, 120, 400)
    ]
    assert rates == sorted(rates, reverse=True)


def test_the_remaining_time_is_as_certain_as_the_last_results_were_regular(
    study: Callable[..., Study],
) -> None:
    # 100 results in 10 blocks of 10, one a second on average; 3900 are left.
    running = study(result_count=100)
    regular = [100.0 + 10.0 * k for k in range(BLOCKS + 1)]
    uneven = [at + (k % 2) for k, at in enumerate(regular)]
    calm, rough = (
        pace(running, window_opened_at=100.0, now=200.0, passed_at=at) for at in (regular, uneven)
    )
    # Nobody is certain to the second because blocks happened to take the same time.
    assert (calm.eta_low_seconds, calm.eta_seconds, calm.eta_high_seconds) == (None, 3900.0, None)
    # Blocks take 11 and 9 s in turn: a spread of sqrt(10 / 9) s. 390 blocks are left.
    half = 1.833 * sqrt(10 / 9) * sqrt(390 + 390**2 / 10)
    assert rough.eta_low_seconds == pytest.approx(3900.0 - half)
    assert rough.eta_high_seconds == pytest.approx(3900.0 + half)


def test_no_end_is_foretold_while_nobody_is_at_work(study: Callable[..., Study]) -> None:
    speed = pace(study(result_count=400), window_opened_at=100.0, now=120.0, at_work=False)
    assert speed.results_per_second == 20.0
    assert (speed.eta_seconds, speed.eta_low_seconds, speed.eta_high_seconds) == (None,) * 3


def test_a_night_in_which_no_machine_worked_is_no_measure_of_what_is_left(
    study: Callable[..., Study],
) -> None:
    # 100 results, one a second but for ten hours between the 50th and the 60th.
    running = study(result_count=100)
    took = [10.0, 11.0, 9.0, 10.0, 11.0, 36_010.0, 9.0, 10.0, 11.0, 9.0]
    at = list(accumulate(took, initial=100.0))
    speed = pace(running, window_opened_at=100.0, now=at[-1], passed_at=at)
    assert speed.results_per_second == pytest.approx(1.0)
    assert speed.eta_seconds == pytest.approx(3900.0)
    assert speed.eta_high_seconds is not None and speed.eta_high_seconds < 2 * 3900.0


def test_results_that_come_in_heaps_are_not_taken_for_a_pause(study: Callable[..., Study]) -> None:
    # 100 results in two heaps, the second 50 s after the first.
    at = [100.0] * 5 + [150.0] * (BLOCKS - 4)
    speed = pace(study(result_count=100), window_opened_at=100.0, now=150.0, passed_at=at)
    assert speed.results_per_second == 2.0


def test_nine_of_ten_predictions_hold_when_results_come_at_random(
    study: Callable[..., Study],
) -> None:
    rng = Random(4)
    held = 0
    for _ in range(400):
        arrivals = list(accumulate((rng.expovariate(1.0) for _ in range(200)), initial=100.0))
        speed = pace(
            study(result_count=200),
            window_opened_at=100.0,
            now=arrivals[200],
            passed_at=[arrivals[number] for number in block_ends(200)],
        )
        # A sum of 3800 waits is as good as normal.
        left = rng.gauss(3800.0, sqrt(3800.0))
        assert speed.eta_low_seconds is not None and speed.eta_high_seconds is not None
        held += speed.eta_low_seconds <= left <= speed.eta_high_seconds
    assert 0.85 < held / 400 < 0.95


def test_the_blocks_end_with_the_last_result_and_need_one_each() -> None:
    assert block_ends(9) == []
    assert block_ends(10) == list(range(11))
    assert block_ends(25) == [5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25]
    assert block_ends(1000)[0] == window_start(1000)


def test_a_finished_study_tells_its_average_and_has_nothing_left(
    study: Callable[..., Study],
) -> None:
    done = study(state="complete", result_count=4000, finished_at=300.0)
    speed = pace(done, window_opened_at=299.0, now=9000.0)
    assert (speed.results_per_second, speed.eta_seconds) == (20.0, 0.0)
    assert speed.elapsed_seconds == 200.0


def test_a_clock_set_back_breaks_nothing(study: Callable[..., Study]) -> None:
    speed = pace(study(result_count=10), window_opened_at=100.0, now=90.0)
    assert (speed.results_per_second, speed.eta_seconds, speed.elapsed_seconds) == (0.0, None, 0.0)


@pytest.mark.parametrize(("results", "start"), [(0, 0), (RATE_WINDOW, 0), (RATE_WINDOW + 7, 7)])
def test_the_window_is_the_last_results(results: int, start: int) -> None:
    assert window_start(results) == start


def test_what_is_pending_and_what_came_back_follows_from_the_counters(
    study: Callable[..., Study],
) -> None:
    running = study(handed_out=50, leased=8, result_count=30)
    assert (running.pending, running.returned) == (4000 - 38, 12)


def test_a_study_that_has_ended_goes_no_more_and_says_how_fast_it_was(
    study: Callable[..., Study],
) -> None:
    ended = study(state="complete", result_count=4000, finished_at=100.5)
    speed = pace(ended, window_opened_at=100.0, now=900.0)
    assert (speed.results_per_second, speed.elapsed_seconds) == (8000.0, 0.5)
    assert (speed.eta_seconds, speed.eta_low_seconds, speed.eta_high_seconds) == (0.0, 0.0, 0.0)
    at_once = pace(study(result_count=9, finished_at=100.0), window_opened_at=100.0, now=900.0)
    assert at_once.results_per_second == 0.0


def test_a_clock_that_has_not_moved_foretells_nothing(study: Callable[..., Study]) -> None:
    speed = pace(study(result_count=400), window_opened_at=100.0, now=100.0)
    assert (speed.results_per_second, speed.eta_seconds) == (0.0, None)
    assert pace(study(result_count=400), window_opened_at=100.0, now=100.5).eta_seconds == 4.5


def test_no_study_ends_before_now(study: Callable[..., Study]) -> None:
    heaps = [100.0] * BLOCKS + [139.0]
    speed = pace(study(result_count=3990), window_opened_at=100.0, now=140.0, passed_at=heaps)
    assert speed.eta_low_seconds == 0.0


def test_blocks_that_differ_by_little_foretell_little_uncertainty(
    study: Callable[..., Study],
) -> None:
    nearly = [100.0 + 10.0 * k + 0.01 * (k % 2) for k in range(BLOCKS + 1)]
    speed = pace(study(result_count=100), window_opened_at=100.0, now=200.0, passed_at=nearly)
    assert speed.eta_seconds == 3900.0
    assert speed.eta_low_seconds is not None and 3800.0 < speed.eta_low_seconds < 3900.0


@pytest.mark.parametrize(
    ("state", "results", "rows", "cursor", "rows_seen", "first"),
    [
        ("running", 20, 5, 20, 5, None),
        # Of incomplete rows: no index changes by them.
        ("running", 23, 5, 20, 5, None),
        ("paused", 23, 5, 20, 5, 23),
        ("running", 24, 6, 20, 5, 24),
        # Eleven rows cannot have been completed by fewer than the last eleven results.
        ("running", 70, 16, 20, 5, 60),
        ("complete", 4000, 1000, 0, 0, 3001),
    ],
)
def test_the_analysis_has_news_since_the_first_of_as_many_results_as_there_are_new_rows(
    study: Callable[..., Study],
    state: str,
    results: int,
    rows: int,
    cursor: int,
    rows_seen: int,
    first: int | None,
) -> None:
    now = study(state=state, result_count=results, rows_complete=rows)
    assert first_left(now, cursor=cursor, rows_seen=rows_seen) == first
