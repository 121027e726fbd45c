"""What the fleet did during the last hour, from looks at it every few seconds."""

from bisect import bisect_left
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass

#: Seconds between two looks, and that are remembered.
EVERY_SECONDS = 20.0
REMEMBERED_SECONDS = 3600.0


@dataclass(frozen=True, kw_only=True)
class Glance:
    """The fleet at one moment."""

    at: float
    #: Instances that each worker has brought results of so far, and holds, by worker.
    done: Mapping[str, int]
    held: Mapping[str, int]
    #: The fence of the latest lease.
    fence: int


@dataclass(frozen=True, kw_only=True)
class Pulse:
    """What one worker did while it was looked at."""

    #: Share of the looks at which it held something; None before there were two.
    busy: float | None
    results_per_second: float


class FleetHistory:
    """The last hour, forgotten when the coordinator restarts."""

    def __init__(self) -> None:
        self._glances: deque[Glance] = deque()

    @property
    def since(self) -> float | None:
        """When the first of the remembered looks was; None before there is any."""
        return self._glances[0].at if self._glances else None

    @property
    def first_fence(self) -> int | None:
        """The latest fence at the first of the remembered looks."""
        return self._glances[0].fence if self._glances else None

    def add(self, glance: Glance) -> None:
        """Remember one more look, and forget what is older than an hour."""
        self._glances.append(glance)
        while self._glances[0].at < glance.at - REMEMBERED_SECONDS:
            self._glances.popleft()

    def pulse(self, worker: str) -> Pulse:
        """Return what a worker did."""
        # It may have come, and not only been seen, within the hour.
        seen = [glance for glance in self._glances if worker in glance.done]
        if len(seen) < 2:
            return Pulse(busy=None, results_per_second=0.0)
        busy = sum(glance.held.get(worker, 0) > 0 for glance in seen) / len(seen)
        return Pulse(busy=busy, results_per_second=self._rate(seen, worker))

    @staticmethod
    def _rate(seen: list[Glance], worker: str) -> float:
        # Of the last five minutes: what it does now is of more use than what it did.
        start = bisect_left([glance.at for glance in seen], seen[-1].at - 300.0)
        first, last = seen[min(start, len(seen) - 2)], seen[-1]
        return (last.done[worker] - first.done[worker]) / (last.at - first.at)
