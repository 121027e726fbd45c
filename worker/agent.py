"""The parent process of a worker: keeps leases alive, children busy and results safe."""

import logging
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from http import HTTPStatus
from random import Random
from typing import Any

from rehyb.client import Client
from rehyb.errors import Conflict, Invalid, NotFound, RehybError, ServerError, Unreachable
from worker.backoff import full_jitter
from worker.close_loop_jobs import Desk
from worker.leases import Lease, Ticket, lease_size
from worker.pool import Finished, Pool
from worker.spool import Batch, Spool

log = logging.getLogger(__name__)

#: Seconds the loop waits for a child before it looks at the clock and at its signals again.
TICK_SECONDS = 0.2
#: Results wait at most this long for company before they are posted.
POST_SECONDS = 0.5
#: Weight of the newest instance in the running mean of how long one takes.
NEWEST_WEIGHT = 0.2
#: A draining worker stays this long for a coordinator that is away; then the results stay on disk.
FAREWELL_SECONDS = 10.0
#: Results at which the coordinator itself fails are posted so often before they are set aside:
#: others must get through.
TRIES = 5
#: Seconds after which what was set aside is posted again; the next worker that starts does so too.
ASIDE_SECONDS = 600.0


class Agent:
    """One worker, from its first lease to its last result.

    Args:
        client: the coordinator.
        pool: the children.
        spool: where results wait to be acknowledged.
        worker: {"id", "host", "versions", "tags"} as the coordinator is to know this worker.
        models: names of the models the children can evaluate.
        batch: the most instances to ask for at once.
        max_idle: leave after this many seconds without work; None: never.
        max_instances: leave after having begun this many; None: never.
        desk: where it closes loops; None: it cannot.
        rng: spreads the waits of many workers.
    """

    def __init__(
        self,
        *,
        client: Client,
        pool: Pool,
        spool: Spool,
        worker: Mapping[str, Any],
        models: Sequence[str],
        batch: int,
        max_idle: float | None,
        rng: Random,
        max_instances: int | None = None,
        desk: Desk | None = None,
    ) -> None:
        self._client = client
        self._pool = pool
        self._spool = spool
        self._worker = worker
        self._models = models
        self._batch = batch
        self._max_idle = max_idle
        self._rng = rng
        self._left = max_instances
        self._desk = desk
        self._misfit = ""
        self._leases: list[Lease] = []
        self._queue: deque[Ticket] = deque()
        self._requests_to_stop = 0
        self._draining_since: float | None = None
        self._failures = 0
        self._silent_until = 0.0
        self._ask_at = 0.0
        self._post_at = 0.0
        self._seconds_each: float | None = None
        #: How often the coordinator has failed at a batch, by the first of its keys.
        self._tries: Counter[int] = Counter()
        self._bring_back_at = 0.0
        self.finished = 0

    def stop(self) -> None:
        """Drain: finish what runs, post it, release the rest. Called again: release at once.

        Safe to call from a signal handler.
        """
        self._requests_to_stop += 1

    def run(self) -> None:
        """Work until stopped or idle for too long.

        Raises:
            Unauthorized: the coordinator refuses the token; finished results stay on disk.
        """
        if adopted := self._spool.adopt():
            log.info("found %d results of an earlier worker that nobody has acknowledged", adopted)
        busy_at = time.monotonic()
        if self._desk is not None:
            self._desk.start()
        try:
            while self._requests_to_stop < 2:
                self._keep(self._pool.wait(TICK_SECONDS))
                now = time.monotonic()
                if self._requests_to_stop and self._draining_since is None:
                    self._drain(now)
                self._feed()
                if now >= self._silent_until:
                    self._speak(now)
                    self._feed()
                if self._queue or self._pool.running or self._lent:
                    busy_at = now
                elif (
                    self._max_idle is not None
                    and self._draining_since is None
                    and now - busy_at >= self._max_idle
                ):
                    log.info("no work for %g s: leaving", self._max_idle)
                    self.stop()
                    self._drain(now)
                if self._left == 0 and self._draining_since is None and not self._queue:
                    log.info("that was the last instance asked for: leaving")
                    self.stop()
                    self._drain(now)
                if self._draining_since is not None and self._drained(now):
                    break
        finally:
            self._leave()

    def _drain(self, now: float) -> None:
        log.info("draining: %d instances still run", self._pool.running)
        self._draining_since = now
        if self._desk is not None:
            self._desk.drain()
        self._give_up(self._queue)
        self._queue.clear()

    def _drained(self, now: float) -> bool:
        if self._pool.running or self._lent:
            # The farewell is counted from the moment the last result is there.
            self._draining_since = now
            return False
        return not (self._leases or len(self._spool)) or (
            now - (self._draining_since or now) > FAREWELL_SECONDS
        )

    def _leave(self) -> None:
        """Tell the coordinator all it should know, once; what it does not hear expires or waits."""
        self._pool.kill()
        if self._desk is not None:
            self._desk.close()
        for lease in self._leases:
            lease.given_up |= bool(lease.open)
            lease.open.clear()
        try:
            while batch := self._spool.next_batch():
                self._post(batch)
            self._release()
        except RehybError as error:
            log.warning("left without a farewell: %s", error)
        if left := len(self._spool):
            log.warning("%d results stay on disk for the next worker to post", left)
        self._spool.close()
        log.info("finished %d instances", self.finished)

    def _keep(self, finished: Sequence[Finished]) -> None:
        for done in finished:
            lease = done.ticket.lease
            self._spool.add(lease=lease.id, fence=lease.fence, result=done.result)
            lease.open.discard(done.result["instance"])
            self.finished += 1
            seconds = done.result["wall_seconds"]
            before = seconds if self._seconds_each is None else self._seconds_each
            self._seconds_each = before + NEWEST_WEIGHT * (seconds - before)

    @property
    def _lent(self) -> int:
        """How many of the pool's processes stay idle while a loop is closed in another."""
        return 0 if self._desk is None else self._desk.busy

    def _feed(self) -> None:
        while self._queue and self._pool.free > self._lent:
            ticket = self._queue.popleft()
            self._pool.start(ticket.instance, ticket)

    def _speak(self, now: float) -> None:
        """Post, renew, release and lease as is due; stay silent for a while if nobody answers."""
        try:
            if now >= self._post_at or any(not lease.open for lease in self._leases):
                if now >= self._bring_back_at and (waiting := self._spool.bring_back()):
                    log.info("trying again to post %d results that were set aside", waiting)
                while batch := self._spool.next_batch():
                    self._post(batch, wish=self._wish(now))
                self._post_at = now + POST_SECONDS
                self._release()
            self._renew(now)
            if wish := self._wish(now):
                self._lease(wish, now)
        except (Unreachable, ServerError) as error:
            self._failures += 1
            wait = full_jitter(self._failures, self._rng)
            self._silent_until = now + wait
            if self._failures == 1:
                log.warning("%s; trying again, results are kept on disk", error)
        else:
            if self._failures:
                log.info("the coordinator answers again")
            self._failures = 0

    def _post(
        self, batch: Batch, *, wish: Mapping[str, Any] | None = None, hopeless: bool = False
    ) -> None:
        """Post a batch, and lease what is wished for in the same request.

        `hopeless`: the coordinator has failed too often at what the batch is part of.
        """
        posted: dict[str, Any] = {
            "lease": batch.lease,
            "fence": batch.fence,
            "worker": batch.worker,
            "results": batch.results,
        }
        answer: Mapping[str, Any]
        try:
            if wish is None:
                answer = {"verdicts": self._client.post_results(**posted)}
            else:
                answer = self._client.exchange(**posted, wish=wish)
        except Invalid as error:
            if wish is not None:
                # An older coordinator grants no wishes.
                self._post(batch, hopeless=hopeless)
                return
            if len(batch.results) > 1:
                # One of them spoils the request for the others.
                self._post_one_by_one(batch, hopeless)
                return
            log.error("the coordinator cannot use a result: %s: %s", error, batch.results[0])
            self._spool.acknowledge(batch.keys)
            return
        except ServerError as error:
            if error.problem.get("status") != HTTPStatus.INTERNAL_SERVER_ERROR:
                # It has had enough, or something before it has; what is posted has no part in it.
                raise
            self._tries[batch.keys[0]] += 1
            if not hopeless and self._tries[batch.keys[0]] < TRIES:
                raise
            del self._tries[batch.keys[0]]
            if len(batch.results) > 1:
                self._post_one_by_one(batch, hopeless=True)
                return
            log.error(
                "the coordinator fails at the result of %s, which stays on disk: it is posted "
                "again in %g minutes, and by the next worker on this machine (%s)",
                batch.results[0]["instance"],
                ASIDE_SECONDS / 60.0,
                error,
            )
            self._spool.set_aside(batch.keys)
            self._bring_back_at = time.monotonic() + ASIDE_SECONDS
            return
        self._tries.pop(batch.keys[0], None)
        # Whatever the verdict, it is final: posting the same result again would not change it.
        self._spool.acknowledge(batch.keys)
        for verdict in answer["verdicts"]:
            if verdict["verdict"] not in ("accepted", "duplicate"):
                log.warning(
                    "instance %s: %s: %s",
                    verdict["instance"],
                    verdict["verdict"],
                    verdict.get("detail"),
                )
        for lease in self._leases:
            if lease.id == batch.lease:
                lease.extend(time.monotonic())
        if wish is not None:
            self._take(answer.get("next"), answer.get("misfit"), time.monotonic())

    def _post_one_by_one(self, batch: Batch, hopeless: bool) -> None:
        for key, result in zip(batch.keys, batch.results, strict=True):
            self._post(replace(batch, keys=(key,), results=(result,)), hopeless=hopeless)

    def _release(self) -> None:
        """Let go of the leases in which nothing is open."""
        for lease in [lease for lease in self._leases if not lease.open]:
            if lease.given_up:
                self._if_still_ours(partial(self._client.release, lease.id, lease.fence))
            self._leases.remove(lease)

    def _renew(self, now: float) -> None:
        for lease in [lease for lease in self._leases if lease.open and now >= lease.renew_at]:
            if self._if_still_ours(partial(self._client.renew, lease.id, lease.fence)):
                lease.extend(now)
                continue
            log.warning("lease %s expired: its instances go to other workers", lease.id)
            self._leases.remove(lease)
            # What runs goes on: a result that arrives late is still taken if nobody was faster.
            self._queue = deque(ticket for ticket in self._queue if ticket.lease is not lease)

    @staticmethod
    def _if_still_ours(call: Callable[[], object]) -> bool:
        try:
            call()
        except (Conflict, NotFound):
            return False
        return True

    def _wish(self, now: float) -> Mapping[str, Any] | None:
        """Return what to ask for now; None if there is enough to do, or it is too early."""
        wanted = self._pool.processes - self._lent
        enough = self._draining_since is not None or len(self._queue) >= wanted
        if enough or now < self._ask_at or self._left == 0:
            return None
        size = lease_size(self._seconds_each, self._pool.processes, self._batch)
        if self._left is not None:
            size = min(size, self._left)
        return {"worker": self._worker, "models": self._models, "max_instances": size}

    def _lease(self, wish: Mapping[str, Any], now: float) -> None:
        try:
            self._take(self._client.lease(**wish), None, now)
        except Conflict as error:
            self._take(None, str(error), now)

    def _take(self, granted: Mapping[str, Any] | None, misfit: str | None, now: float) -> None:
        """Queue the instances of a new lease; wait for a while if there is none."""
        if misfit is not None:
            # There is work, but not for this machine as it is: once in its log is enough.
            if misfit != self._misfit:
                log.warning("%s", misfit)
            self._misfit = misfit
        if granted is None:
            self._ask_at = now + self._client.retry_after * self._rng.uniform(0.5, 1.0)
            return
        if self._left is not None:
            self._left -= len(granted["instances"])
        lease = Lease(
            id=granted["id"],
            fence=granted["fence"],
            ttl_seconds=granted["ttl_seconds"],
            renew_at=now + granted["ttl_seconds"] / 3.0,
            open={instance["id"] for instance in granted["instances"]},
        )
        self._leases.append(lease)
        self._queue.extend(
            Ticket(lease=lease, instance=instance) for instance in granted["instances"]
        )

    @staticmethod
    def _give_up(tickets: Iterable[Ticket]) -> None:
        for ticket in tickets:
            ticket.lease.open.discard(ticket.instance["id"])
            ticket.lease.given_up = True
