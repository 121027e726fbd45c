"""How many pilots there are to be."""

import pytest

from rehyb.pilots.engines import JobState
from rehyb.pilots.scaling import Work, may_start, step


@pytest.mark.parametrize(
    ("work", "jobs", "wanted", "submit", "cancel"),
    [
        ((0, 0), "", 1, 1, ""),
        ((9, 0), "", 3, 3, ""),
        ((1000, 0), "", 5, 4, ""),
        ((9, 4), "RR", 4, 2, ""),
        # Who has all there is needs no company.
        ((0, 16), "RR", 4, 0, ""),
        # Nothing waits: jobs that have not begun go, those that run leave by themselves.
        ((0, 4), "RRWW", 1, 0, "32"),
        ((0, 0), "RRR", 1, 0, ""),
        # The last to come goes first.
        ((8, 0), "WWW", 2, 0, "2"),
    ],
)
def test_there_are_as_many_pilots_as_there_is_work_for(
    work: tuple[int, int], jobs: str, wanted: int, submit: int, cancel: str
) -> None:
    there = {
        str(n): JobState.WAITING if letter == "W" else JobState.RUNNING
        for n, letter in enumerate(jobs)
    }
    found = step(
        Work(waiting=work[0], under_way=work[1]), there, cores=4, minimum=1, maximum=5, may_start=4
    )
    assert (found.wanted, found.submit, "".join(found.cancel)) == (wanted, submit, cancel)


def test_no_more_are_started_within_a_minute_than_allowed() -> None:
    assert may_start([0.0, 1.0, 50.0], now=59.0, a_minute=3) == 0
    assert may_start([0.0, 1.0, 50.0], now=60.5, a_minute=3) == 1
