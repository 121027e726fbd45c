"""Taking back what silent workers hold, as far as somebody was there to hear them."""

import logging
from collections.abc import Callable
from math import inf
from time import monotonic

from sqlalchemy.engine import Engine

from server.clocks import Clock
from server.operations.fleet import leases
from server.store.audit import write_nothing_new
from server.store.database.engine import writing
from server.store.fleet import workers

log = logging.getLogger(__name__)

#: Seconds between two looks, however many ask for work.
SWEEP_SECONDS = 1.0
#: A coordinator that is late by less is busy, and not away.
BUSY_SECONDS = 1.0


class Sweep:
    """Takes back expired leases, unless the coordinator or its database was away meanwhile.

    A worker renews at every third of a lease. If nobody looked after leases for half of one, its
    silence is not the worker's: those that are open last anew.

    Args:
        engine: of the database.
        clock: the coordinator's.
        ttl: seconds that a lease lasts.
        ticks: seconds by a clock that nobody sets.
        follow: sets the coordinator's clock forward to a moment, and returns how far it was behind.
    """

    def __init__(
        self,
        engine: Engine,
        clock: Clock,
        ttl: float,
        ticks: Callable[[], float] = monotonic,
        *,
        follow: Callable[[float], float] = lambda _: 0.0,
    ) -> None:
        self._engine, self._clock, self._ttl, self._ticks = engine, clock, ttl, ticks
        self._follow = follow
        self._looked_at = self._none_before = -inf
        self._there_at = ticks()

    def begin(self) -> None:
        """Have all that is open last anew, which nobody can have lost before it has run out.

        Until then a lease that seems to have, was granted by a coordinator whose clock is behind:
        it has as long to notice.
        """
        now = self._clock()
        leases.extend_open_leases(self._engine, now=now, ttl=self._ttl)
        self._none_before = now + self._ttl
        self._there_at = self._ticks()

    def is_due(self) -> bool:
        """Say whether the last look was not just before."""
        return not self._looked_at <= self._clock() < self._looked_at + SWEEP_SECONDS

    def __call__(self) -> int:
        """Return how many instances came back."""
        self._looked_at = self._clock()
        # Whoever keeps the database to itself keeps workers from renewing, too.
        with writing(self._engine) as connection:
            # Nor does one renew that finds no room on the disk.
            if workers.any_holds_a_lease(connection, now=-inf):
                write_nothing_new(connection)
        self._follow_others()
        self.catch_up()
        now = self._clock()
        lost = leases.reap(self._engine, now=now, ttl=self._ttl) if now >= self._none_before else 0
        self._there_at = self._ticks()
        return lost

    def catch_up(self) -> None:
        """Have open leases last anew if nobody was there to renew them."""
        away = self._ticks() - self._there_at
        if away <= max(self._ttl / 2.0, BUSY_SECONDS):
            return
        leases.extend_open_leases(self._engine, now=self._clock(), ttl=self._ttl)
        self._there_at = self._ticks()
        log.warning("nobody could renew a lease for %.0f s: those that are open last anew", away)

    def _follow_others(self) -> None:
        """Go on from the latest time that another coordinator of the database has written.

        The database's clock was set before that one began, or this one's machine slept: what this
        one grants would seem to have expired long ago.
        """
        behind = self._follow(leases.latest(self._engine))
        if behind > BUSY_SECONDS:
            leases.extend_open_leases(self._engine, now=self._clock(), ttl=self._ttl)
            log.warning("another coordinator's clock is %.0f s ahead: this one follows", behind)
