"""The last hour of the fleet, from looks at it."""

import pytest

from server.logic.fleet.history import REMEMBERED_SECONDS, FleetHistory, Glance, Pulse


def glance(at: float, done: int, held: int, fence: int = 0) -> Glance:
    return Glance(at=at, done={"w": done}, held={"w": held} if held else {}, fence=fence)


def test_a_worker_is_as_busy_as_often_as_it_held_something() -> None:
    history = FleetHistory()
    for number, held in enumerate([3, 0, 2, 1]):
        history.add(glance(20.0 * number, 10 * number, held))
    assert history.pulse("w").busy == 0.75
    assert history.pulse("w").results_per_second == pytest.approx(0.5)


def test_its_rate_is_that_of_the_last_minutes() -> None:
    history = FleetHistory()
    for number in range(100):
        history.add(glance(20.0 * number, min(number, 50), 1))
    assert history.pulse("w").results_per_second == 0.0


def test_who_was_not_seen_twice_has_no_share_yet() -> None:
    history = FleetHistory()
    assert history.since is None and history.first_fence is None
    history.add(glance(0.0, 5, 1))
    assert history.pulse("w").busy is None and history.pulse("other").busy is None


def test_what_is_older_than_an_hour_is_forgotten() -> None:
    history = FleetHistory()
    for number in range(400):
        history.add(glance(20.0 * number, 0, 0, fence=number))
    assert history.since == 20.0 * 399 - REMEMBERED_SECONDS
    assert history.first_fence == 399 - REMEMBERED_SECONDS / 20.0


def test_of_two_looks_there_is_a_rate_and_of_one_there_is_none() -> None:
    history = FleetHistory()
    history.add(glance(1000.0, 5, 1))
    assert history.pulse("w") == Pulse(busy=None, results_per_second=0.0)
    history.add(glance(1020.0, 15, 0))
    assert history.pulse("w") == Pulse(busy=0.5, results_per_second=0.5)


def test_its_rate_is_that_of_five_minutes_to_the_look_or_of_the_last_two_looks() -> None:
    history = FleetHistory()
    for at, done in ((0.0, 0), (99.5, 7), (100.0, 100), (250.0, 350), (400.0, 400)):
        history.add(glance(at, done, 1))
    assert history.pulse("w").results_per_second == 1.0
    history.add(glance(1000.0, 460, 1))
    assert history.pulse("w").results_per_second == 0.1
