"""Renews leases from a thread of its own, however long the worker waits for an answer."""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from threading import Event, Thread

from rehyb.errors import RehybError
from worker import backoff

log = logging.getLogger(__name__)

#: Seconds between two looks for leases that are due.
TICK_SECONDS = 0.1
#: A worker that has brought nothing about for so long keeps no leases: it hangs, or its results do
#: not get through although renewals do. Many times what an answer may take.
STUCK_SECONDS = 300.0
#: A worker that leaves waits no longer for an answer under way.
LEAVE_SECONDS = 10.0


@dataclass(kw_only=True)
class Renewals:
    """Keeps leases of one worker while it computes, and while it posts or hands in a report."""

    #: Renews what is due at a time of the monotonic clock; not on a connection that may be busy.
    renew: Callable[[float], object]
    #: The most seconds until a renewal that failed is tried again, by the leases that there are.
    patience: Callable[[], float]
    #: Spreads the waits of many workers.
    rng: Random

    def __post_init__(self) -> None:
        self._ended = Event()
        self._thread = Thread(target=self._run, name="renewals", daemon=True)
        self._progress_at = 0.0

    def start(self) -> None:
        """Renew leases from now on."""
        self.progress()
        self._thread.start()

    def progress(self) -> None:
        """Note that the worker has told its coordinator all there was to tell, or some of it."""
        self._progress_at = time.monotonic()

    def close(self) -> None:
        """End."""
        self._ended.set()
        if self._thread.ident is not None:
            self._thread.join(LEAVE_SECONDS)

    def _run(self) -> None:
        failures, wait = 0, TICK_SECONDS
        while not self._ended.wait(wait):
            now = time.monotonic()
            if now - self._progress_at > STUCK_SECONDS:
                continue
            try:
                self.renew(now)
                failures, wait = 0, TICK_SECONDS
            except RehybError as error:
                # The agent says what is wrong with the coordinator.
                log.debug("no lease can be renewed: %s", error)
                failures += 1
                wait = min(backoff.full_jitter(failures, self.rng), self.patience())
