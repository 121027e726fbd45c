"""The coordinator's time cannot go back, whatever the machine's clock does."""

import pytest

from server.clocks import Forward, steady
from tests.testbed.clock import Clock


def test_a_steady_clock_only_counts_on_from_what_the_wall_showed() -> None:
    wall, ticks = Clock(), Clock()
    clock = steady(wall, ticks)
    began = wall()
    for moved in (-3600.0, 7200.0):
        wall.advance(moved)
        assert clock() == began
    ticks.advance(2.5)
    assert clock() == pytest.approx(began + 2.5)


def test_a_clock_that_is_behind_a_known_moment_goes_on_from_there() -> None:
    clock = Clock()
    ahead = Forward(clock)
    assert ahead.follow(clock() + 10.0) == 10.0
    assert ahead() == clock() + 10.0
    clock.advance(1.0)
    assert ahead() == clock() + 10.0
    assert ahead.follow(clock() + 9.0) == 0.0
    assert ahead() == clock() + 10.0
