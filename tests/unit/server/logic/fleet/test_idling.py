"""The more workers wait for work, the later each of them asks again."""

import pytest

from server.logic.fleet.hosts import GONE_SECONDS
from server.logic.fleet.idling import ASKS_A_SECOND, LONGEST_SECONDS, Idle, ask_for_jobs_in


@pytest.mark.parametrize(
    ("workers", "seconds"), [(1, 1), (50, 1), (51, 2), (500, 10), (1500, 30), (10_000, 30)]
)
def test_the_wait_grows_with_the_idle_fleet_up_to_a_limit(workers: int, seconds: int) -> None:
    idle = Idle()
    told = [idle.tell(f"w{n}", 0.0) for n in range(workers)]
    assert (told[0], told[-1]) == (1, seconds)
    assert idle.tell("w0", 1.0) == seconds, "who asks again is not another worker"


def test_it_shrinks_when_work_comes_and_when_workers_leave() -> None:
    idle = Idle()
    for n in range(500):
        idle.tell(f"w{n}", 0.0)
    for n in range(450):
        idle.busy(f"w{n}")
    idle.busy("never seen")
    assert idle.tell("w499", 1.0) == 1
    for n in range(500):
        idle.tell(f"w{n}", 2.0)
    assert idle.tell("w0", 2.0 + 2 * LONGEST_SECONDS) == 10
    assert idle.tell("w0", 3.0 + 2 * LONGEST_SECONDS) == 1


def test_nobody_is_told_to_wait_until_it_is_taken_for_gone() -> None:
    assert 2 * LONGEST_SECONDS <= GONE_SECONDS
    assert ASKS_A_SECOND >= 1.0


@pytest.mark.parametrize(("workers", "seconds"), [(0, 2), (1, 2), (10, 2), (50, 10), (1000, 15)])
def test_many_workers_without_a_job_ask_no_more_than_a_few(workers: int, seconds: int) -> None:
    assert ask_for_jobs_in(workers) == seconds
