"""What a worker has promised to compute: its leases, asked for, renewed and released."""

import logging
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import islice, takewhile
from math import inf
from random import Random
from typing import Any

from rehyb.client import Client
from rehyb.errors import Conflict, Invalid, NotFound
from worker.backoff import without_work

log = logging.getLogger(__name__)

#: {"worker", "models", "max_instances", "at_most"} as `Client.lease` takes them.
LeaseRequest = Mapping[str, Any]

#: Work to ask for at once: little enough that the last rows of a study are spread over all
#: workers, and much enough that asking does not matter.
WORK_SECONDS = 2.0
#: What an instance takes at least, by all that is done about it.
LEAST_SECONDS = 0.002
#: More work is asked for when what waits for a child is done in this time.
AHEAD_SECONDS = 0.1
#: A child is given so much work at once: more than it takes to hand it the next, and little enough
#: that others hardly wait for it.
BUNDLE_SECONDS = 0.05
#: Before a worker's time is up, it needs so long to give back what runs.
LAST_WORDS_SECONDS = 5.0
#: Weight of the newest instance in the running mean of how long one takes.
NEWEST_WEIGHT = 0.2


@dataclass(kw_only=True)
class Lease:
    """Instances this worker has promised to compute."""

    id: str
    fence: int
    ttl_seconds: float
    renew_at: float
    #: Instances without a result.
    open: set[Any] = field(default_factory=set)
    #: Some of it will not be computed here; the coordinator must hear of it.
    given_up: bool = False
    #: The coordinator has said that it is over.
    lost: bool = False


@dataclass(frozen=True, kw_only=True)
class Ticket:
    """One instance of a lease, while it waits for a child or is with one."""

    lease: Lease
    instance: Mapping[str, Any]


@dataclass(kw_only=True)
class Leases:
    """The leases of one worker."""

    client: Client
    #: {"id", "host", "versions", "tags"} as the coordinator knows this worker.
    worker: Mapping[str, Any]
    #: The models that the children can evaluate, at a time of the monotonic clock, each with its
    #: canary; empty where it has none.
    models: Callable[[float], Mapping[str, str]]
    #: Those that they cannot, each with why.
    refused: Callable[[], Mapping[str, str]] = dict
    #: How many instances run at the same time.
    processes: int
    #: The most instances to ask for at once.
    batch: int
    #: How many instances may still be begun; None: any number.
    left: int | None = None
    #: When the worker must be gone, on the monotonic clock; infinite: it may stay.
    leave_at: float = inf
    #: Spreads the waits of many workers.
    rng: Random
    #: Instances that no child has begun.
    queue: deque[Ticket] = field(default_factory=deque)
    _held: list[Lease] = field(default_factory=list)
    _ask_at: float = 0.0
    #: How long an instance takes, by its model: one of another may take ten thousand times as long.
    _seconds_each: dict[str, float] = field(default_factory=dict)
    #: Instances of the last lease.
    _granted: int = 0
    #: Of the instance that took longest here.
    _slowest: float = 0.0
    #: Why no work fits this machine, as it was last told.
    _ineligible: str = ""
    #: What was said once and is not said again.
    _told: set[str] = field(default_factory=set)

    def __len__(self) -> int:
        return len(self._held)

    @property
    def last_words_at(self) -> float:
        """When what still runs is given back, on the monotonic clock."""
        return self.leave_at - LAST_WORDS_SECONDS

    @property
    def any_finished(self) -> bool:
        """Whether a lease has a result for each of its instances."""
        return any(not lease.open for lease in self._held)

    @property
    def bundle_size(self) -> int:
        """How many of the queue to give to one child at once; all of one model."""
        model = self._next_model
        size = bundle_size(self._seconds_each.get(model), self.processes, len(self.queue))
        alike = takewhile(lambda ticket: ticket.instance["model"] == model, self.queue)
        return sum(1 for _ in islice(alike, size))

    @property
    def ahead(self) -> int:
        """How many of the queue are few enough to ask for more: what is done in AHEAD_SECONDS.

        Never more than half a lease as the coordinator grants them.
        """
        each = self._seconds_each.get(self._next_model)
        if each is None:
            return 0
        soon = int(AHEAD_SECONDS * self.processes / max(each, LEAST_SECONDS))
        return min(soon, self._granted // 2)

    @property
    def _next_model(self) -> str:
        """The model of what is next in the queue; empty: nothing is."""
        model: str = self.queue[0].instance["model"] if self.queue else ""
        return model

    def request(self, now: float) -> LeaseRequest | None:
        """Return what to ask for; None if it is too early, or no more may be begun."""
        if now < self._ask_at or self.left == 0:
            return None
        models = self.models(now)
        sizes = {model: self._size(model, now) for model in models}
        size = max(sizes.values(), default=0)
        if size == 0:
            return None
        canaries = {name: canary for name, canary in models.items() if canary}
        said = {"canaries": canaries, "refused": self.refused()}
        worker = {**self.worker, **{name: told for name, told in said.items() if told}}
        request = {"worker": worker, "models": list(models), "max_instances": size}
        fewer = {model: wanted for model, wanted in sizes.items() if wanted < size}
        return {**request, "at_most": fewer} if fewer else request

    def _size(self, model: str, now: float) -> int:
        """Return how many instances of a model to ask for at once; 0: none can be finished."""
        each = self._seconds_each.get(model)
        size = lease_size(each, self.processes, self.batch)
        if self.left is not None:
            size = min(size, self.left)
        if self.leave_at < inf:
            left = self._time_left(now)
            size = min(size, fitting(left, each or 0.0, self._slowest, self.processes))
        return size

    def ends_too_soon(self, now: float) -> bool:
        """Say whether an instance begun now could not be finished before the worker must leave."""
        return self._time_left(now) <= self._slowest

    def time_is_up(self, now: float) -> bool:
        """Say whether what still runs must be given back now."""
        return self._time_left(now) <= 0.0

    def _time_left(self, now: float) -> float:
        """Return the seconds left for instances."""
        return self.last_words_at - now

    def ask_soon(self) -> None:
        """Wait no longer: there is more now that can be asked for."""
        self._ask_at = 0.0

    def ask(self, request: LeaseRequest, now: float) -> None:
        """Ask for work by itself, without results."""
        try:
            self.take(self.client.lease(**request), None, now)
        except Conflict as error:
            self.take(None, str(error), now)
        except Invalid:
            if "at_most" not in request:
                raise
            # An older coordinator knows one size for all models: that of the dearest.
            fewest = min(request["at_most"].values())
            self.ask({**_without(request, "at_most"), "max_instances": fewest}, now)

    def take(self, granted: Mapping[str, Any] | None, ineligible: str | None, now: float) -> None:
        """Queue the instances of a new lease; wait for a while if there is none.

        Args:
            granted: {"id", "fence", "ttl_seconds", "instances"}.
            ineligible: why there is no lease although there is work.
            now: seconds of a monotonic clock, as everywhere here.
        """
        if ineligible is not None:
            # There is work, but not for this machine as it is: once in its log is enough.
            if ineligible != self._ineligible:
                log.warning("%s", ineligible)
            self._ineligible = ineligible
        if granted is None:
            if ineligible is None and not self._told:
                self._tell("there is no work for now: asks again and again")
            self._ask_at = now + without_work(self.client.retry_after, self.rng)
            return
        instances = granted["instances"]
        study = str(instances[0]["id"]).partition(":")[0]
        self._tell(f"works on study {study}")
        self._granted = len(instances)
        if self.left is not None:
            self.left -= len(instances)
        lease = Lease(
            id=granted["id"],
            fence=granted["fence"],
            ttl_seconds=granted["ttl_seconds"],
            renew_at=renewal_time(now, granted["ttl_seconds"]),
            open={instance["id"] for instance in instances},
        )
        self._held.append(lease)
        self.queue.extend(Ticket(lease=lease, instance=instance) for instance in instances)

    def _tell(self, sentence: str) -> None:
        """Say something unless it was said before."""
        if sentence not in self._told:
            self._told.add(sentence)
            log.info("%s", sentence)

    def finish(self, ticket: Ticket, seconds: float) -> None:
        """Note that an instance has a result, and how long it took."""
        ticket.lease.open.discard(ticket.instance["id"])
        model = ticket.instance["model"]
        before = self._seconds_each.get(model, seconds)
        self._seconds_each[model] = before + NEWEST_WEIGHT * (seconds - before)
        self._slowest = max(self._slowest, seconds)

    def extend(self, lease_id: str, now: float) -> None:
        """Note that the coordinator has just extended a lease; it need not be one of these."""
        for lease in self._held:
            if lease.id == lease_id:
                lease.renew_at = renewal_time(now, lease.ttl_seconds)

    def renew(self, client: Client, now: float) -> None:
        """Renew what is due, also if only its results are still to be posted.

        Another thread may call this, on a connection of its own, whatever is done meanwhile.
        """
        for lease in [*self._held]:
            if now < lease.renew_at or lease.lost or (lease.given_up and not lease.open):
                continue
            if _if_still_held(partial(client.renew, lease.id, lease.fence)):
                lease.renew_at = renewal_time(now, lease.ttl_seconds)
            else:
                lease.lost = True

    def patience(self) -> float:
        """Return the most seconds until a renewal that failed is tried again."""
        return min((patience(lease.ttl_seconds) for lease in [*self._held]), default=inf)

    def drop_lost(self) -> None:
        """Begin nothing more of leases that are over."""
        for lease in [one for one in self._held if one.lost]:
            # One that has all its results may have ended by the very post that is under way.
            if lease.open:
                log.warning(
                    "lease %s expired: what is not begun goes to other workers, and what runs is "
                    "posted all the same",
                    lease.id,
                )
            self._held.remove(lease)
            # What runs goes on: a result that arrives late is still taken if nobody was faster.
            self.queue = deque(ticket for ticket in self.queue if ticket.lease is not lease)

    def release(self) -> None:
        """Let go of the leases in which nothing is open."""
        for lease in [one for one in self._held if not one.open]:
            if lease.given_up:
                _if_still_held(partial(self.client.release, lease.id, lease.fence))
            self._held.remove(lease)

    def give_up_queue(self) -> None:
        """Leave to others what no child has begun."""
        for ticket in self.queue:
            ticket.lease.open.discard(ticket.instance["id"])
            ticket.lease.given_up = True
        self.queue.clear()

    def give_up_model(self, ticket: Ticket) -> None:
        """Leave to others an instance, and what no child has begun of its model."""
        model = ticket.instance["model"]
        queued = [other for other in self.queue if other.instance["model"] == model]
        for one in (ticket, *queued):
            one.lease.open.discard(one.instance["id"])
            one.lease.given_up = True
        self.queue = deque(other for other in self.queue if other.instance["model"] != model)

    def give_up(self) -> None:
        """Leave to others whatever has no result."""
        for lease in self._held:
            lease.given_up |= bool(lease.open)
            lease.open.clear()


def _without(request: LeaseRequest, name: str) -> dict[str, Any]:
    return {key: value for key, value in request.items() if key != name}


def lease_size(seconds_each: float | None, processes: int, batch: int) -> int:
    """Return how many instances to ask for at once.

    `seconds_each`: how long one instance takes; None before the first is done.
    """
    if seconds_each is None:
        return min(processes, batch)
    wanted = int(WORK_SECONDS * processes / max(seconds_each, LEAST_SECONDS))
    return max(1, min(batch, wanted))


def bundle_size(seconds_each: float | None, processes: int, waiting: int) -> int:
    """Return how many of the instances that wait to give to one child at once.

    Only of those that take next to no time are there several; towards the end of the queue fewer,
    so that all children are done at about the same time (Polychronopoulos and Kuck 1987, *IEEE
    Transactions on Computers* 36, 1425-1439).

    `seconds_each`: how long one instance takes; None before the first is done.
    """
    if seconds_each is None:
        return 1
    quick = int(BUNDLE_SECONDS / max(seconds_each, LEAST_SECONDS / 4))
    return max(1, min(quick, waiting // (2 * processes)))


def fitting(seconds_left: float, seconds_each: float, slowest: float, processes: int) -> int:
    """Return how many instances can be finished in the time that is left.

    `seconds_each`: how long one takes, `slowest`: the one that took longest; 0 before the first.
    """
    if seconds_left <= slowest:
        return 0
    # The last of a process may be a slow one.
    rounds = 1 + int((seconds_left - slowest) / seconds_each) if seconds_each > 0.0 else 1
    return rounds * processes


def renewal_time(now: float, ttl_seconds: float) -> float:
    """Return when to renew a lease that lives for `ttl_seconds` from `now`: two tries to spare."""
    return now + ttl_seconds / 3.0


def patience(ttl_seconds: float) -> float:
    """Return the most seconds until a renewal that failed is tried again.

    A coordinator that was away gives what is open as long again as a lease lives, at least.
    """
    return ttl_seconds / 6.0


def _if_still_held(call: Callable[[], object]) -> bool:
    """Make a call about a lease; returns False if the lease is no longer this worker's."""
    try:
        call()
    except (Conflict, NotFound):
        return False
    return True
