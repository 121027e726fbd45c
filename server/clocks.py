"""The coordinator's time: leases live on it, so it cannot go back, as a machine's clock can."""

import time
from collections.abc import Callable

#: Returns seconds since the epoch, UTC.
Clock = Callable[[], float]


def steady(wall: Clock = time.time, ticks: Clock = time.monotonic) -> Clock:
    """Return a clock that shows the wall's time now, and from then on only counts seconds."""
    offset = wall() - ticks()
    return lambda: ticks() + offset


def not_before(clock: Clock, moment: float) -> Clock:
    """Return `clock`, set forward to `moment` if it is behind."""
    ahead = max(0.0, moment - clock())
    return lambda: clock() + ahead
