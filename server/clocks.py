"""The coordinator's time: leases live on it, so it cannot go back, as a machine's clock can."""

import time
from collections.abc import Callable

#: Returns seconds since the epoch, UTC.
Clock = Callable[[], float]


def steady(wall: Clock = time.time, ticks: Clock = time.monotonic) -> Clock:
    """Return a clock that shows the wall's time now, and from then on only counts seconds."""
    offset = wall() - ticks()
    return lambda: ticks() + offset


class Forward:
    """A clock that can be set forward, and never back."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._ahead = 0.0

    def __call__(self) -> float:
        return self._clock() + self._ahead

    def follow(self, moment: float) -> float:
        """Go on from `moment` if this clock is behind it; return by how many seconds it was."""
        behind = max(0.0, moment - self())
        self._ahead += behind
        return behind
