"""Which signals of a log are the derivatives of which, and what that tells."""

import numpy as np
import pytest

from analysis.closeloop.logs.clock import clock_of
from analysis.closeloop.logs.inspection import believe
from analysis.closeloop.logs.log import Channel, Log


def test_a_fast_motion_tells_the_rate_as_well_as_a_slow_one() -> None:
    """A position's slope is smoothed more than its velocity was: of a leg's 227 Hz it made 244."""
    time = np.arange(0.0, 10.0, 0.005)
    speeds = 2 * np.pi * np.array([3.0, 5.0, 7.0])
    signals = {"q": np.sin(np.outer(time, speeds)), "dq": speeds * np.cos(np.outer(time, speeds))}
    channels = [
        Channel(name=f"{name}{n}", values=table[:, n])
        for name, table in signals.items()
        for n in range(3)
    ]
    for belief in believe(Log(kind="CSV", channels=channels)):
        found = belief.channel.time
        assert found is not None and clock_of(found).rate == pytest.approx(200.0, rel=1e-3)
