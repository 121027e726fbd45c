"""What the model of the coordinator keeps of studies, instances and leases."""

from collections import Counter
from dataclasses import dataclass, field
from math import inf
from typing import Any

Place = tuple[int, int]
#: Final outcomes and outputs by place.
Done = dict[Place, tuple[str, float | None]]
Json = dict[str, Any]

#: How often an instance must be tried for a cause at least, and at most twice as often.
BUDGETS = {"crashed": 3, "timed_out": 3, "invalid": 3, "lost": 5}
RETRIED = ("crashed", "timed_out")
SERVED = ("running", "draining")
ENDED = ("complete", "cancelled")


@dataclass
class Slot:
    """An instance of a begun row."""

    #: The kind of machine that its row is bound to; None: any.
    kind: str | None
    #: Id of the lease that holds it; None if it waits or is done.
    lease: str | None = None
    #: Its final outcome and output; None as long as it has none.
    result: tuple[str, float | None] | None = None
    #: How often it came back, by cause.
    counts: Counter[str] = field(default_factory=Counter)
    #: When a result that a worker had reported was last taken back.
    taken_back_at: float = -inf

    def reopen(self, *, unbound: bool, now: float) -> None:
        """Have it run again, with nothing held against it."""
        if self.result is not None and self.result[0] not in BUDGETS:
            self.taken_back_at = now
        self.lease = self.result = None
        self.counts = Counter()
        if unbound:
            self.kind = None


@dataclass
class Study:
    """A study."""

    id: str
    rows: int
    width: int
    state: str = "running"
    slots: dict[Place, Slot] = field(default_factory=dict)

    @property
    def instances(self) -> int:
        return self.rows * self.width

    def done(self) -> Done:
        """Return final results by place."""
        return {at: one.result for at, one in self.slots.items() if one.result is not None}

    def may_be_given_up(self) -> bool:
        """Say whether an instance came back so often that the coordinator may end it."""
        return any(
            one.result is None and any(one.counts[cause] >= most for cause, most in BUDGETS.items())
            for one in self.slots.values()
        )

    def held(self) -> int:
        """Return how many instances workers hold."""
        return sum(one.lease is not None for one in self.slots.values())

    def settle(self, *, filed: bool) -> None:
        """Draw the conclusions of instances having come back or results having come in."""
        done = len(self.done())
        if filed and done == self.instances and self.state != "cancelled":
            self.state = "complete"
        self.settle_draining()

    def settle_draining(self) -> None:
        """Pause it if it drains and all of its begun rows are done."""
        if self.state == "draining" and len(self.done()) == len(self.slots):
            self.state = "paused"

    def recount(self) -> None:
        """Have it run again if results were taken back."""
        if self.state == "complete" and len(self.done()) < self.instances:
            self.state = "running"

    def progress(self) -> Json:
        """Return what the coordinator must say of it."""
        done = self.done()
        failures = Counter(outcome for outcome, _ in done.values() if outcome != "ok")
        rows = Counter(row for row, _ in done)
        return {
            "state": self.state,
            "instances": self.instances,
            "pending": self.instances - len(done) - self.held(),
            "leased": self.held(),
            "ok": len(done) - failures.total(),
            "failed": failures.total(),
            "failures": dict(failures),
            "rows_complete": sum(count == self.width for count in rows.values()),
        }


@dataclass
class Lease:
    """A lease, as a worker knows it."""

    id: str
    fence: int
    study: str
    host: str
    kind: str
    places: list[Place]
    granted: float
    expires: float
    #: Whether it asks for second opinions, which are never results.
    compares: bool
    state: str = "open"

    @property
    def worker(self) -> str:
        return f"of-{self.host}"
