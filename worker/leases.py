"""What a worker has promised to compute, and how much it asks for."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

#: Work to ask for at once: little enough that the last rows of a study are spread over all
#: workers, and much enough that asking does not matter.
LEASE_SECONDS = 2.0


@dataclass(kw_only=True)
class Lease:
    """Instances this worker has promised to compute."""

    id: str
    fence: int
    ttl_seconds: float
    renew_at: float
    #: Instances without a result.
    open: set[Any] = field(default_factory=set)
    #: Some of it will not be computed here, so the coordinator is to be told.
    given_up: bool = False

    def extend(self, now: float) -> None:
        self.renew_at = now + self.ttl_seconds / 3.0


@dataclass(frozen=True, kw_only=True)
class Ticket:
    """One instance of a lease, while it waits for a child or is with one."""

    lease: Lease
    instance: Mapping[str, Any]


def lease_size(seconds_each: float | None, processes: int, batch: int) -> int:
    """Return how many instances to ask for at once.

    Args:
        seconds_each: how long one instance takes; None before the first is done.
        processes: how many run at the same time.
        batch: the most to ask for.
    """
    if seconds_each is None:
        return min(processes, batch)
    if seconds_each * batch <= LEASE_SECONDS * processes:
        return batch
    return max(1, int(LEASE_SECONDS * processes / seconds_each))
