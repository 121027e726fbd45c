"""The parent process of a worker: keeps children busy and results safe."""

import logging
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from random import Random
from typing import Any

from models.running.child import Result, failed
from models.running.outcomes import Outcome
from models.running.places import NoModelError
from models.running.pool import Pool
from rehyb.errors import RehybError, ServerError, Unreachable, WrongProtocol
from worker import backoff
from worker.close_loop.jobs import CloseLoopJobs
from worker.leases import LeaseRequest, Leases, Ticket
from worker.posting import Posting
from worker.renewing import Renewals
from worker.spool import Spool

log = logging.getLogger(__name__)

#: Seconds the loop waits for a child before it looks at the clock and at its signals again.
TICK_SECONDS = 0.2
#: Results wait at most this long for company before they are posted.
POST_SECONDS = 0.5


@dataclass(kw_only=True)
class Agent:
    """One worker, from its first lease to its last result."""

    leases: Leases
    renewals: Renewals
    pool: Pool
    #: Where results wait to be acknowledged.
    spool: Spool
    #: Leave after this many seconds without work; None: never.
    max_idle: float | None
    #: Spreads the waits of many workers.
    rng: Random
    #: Makes of an instance what a child needs, and may have to fetch its model.
    prepare: Callable[[Mapping[str, Any]], Mapping[str, Any]] = dict
    #: Goes on checking the models that it may not ask work for yet, and says whether there are any.
    check_models: Callable[[], bool] = lambda: False
    #: Is told of a model by name and digest whose server does not answer any more, and why.
    lose_model: Callable[[str, str], None] = lambda version, why: None
    #: Closes loops beside; None: this worker cannot.
    close_loop_jobs: CloseLoopJobs | None = None
    #: How many instances it has finished.
    finished: int = 0

    def __post_init__(self) -> None:
        self._posting = Posting(client=self.leases.client, spool=self.spool, leases=self.leases)
        self._stop_requests = 0
        self._draining_since: float | None = None
        self._failures = 0
        #: Whether the coordinator was ever reached: whoever was is no mistake.
        self._answered = False
        self._silent_until = 0.0
        self._post_at = 0.0
        self._checking = False

    def stop(self) -> None:
        """Drain: finish what runs, post it, release the rest. Called again: release at once.

        Safe to call from a signal handler.
        """
        self._stop_requests += 1

    def run(self) -> None:
        """Work until stopped or idle for too long.

        Raises:
            Unauthorized: the coordinator refuses the token; finished results stay on disk.
            WrongProtocol: what answered first is no coordinator.
        """
        if adopted := self.spool.adopt():
            log.info("posts %d results that an earlier worker here left on disk", adopted)
        busy_at = time.monotonic()
        # Who waits for an answer sees no clock.
        self.leases.client.answer_by = self.leases.last_words_at
        self.renewals.start()
        if self.close_loop_jobs is not None:
            self.close_loop_jobs.start()
        try:
            while self._stop_requests < 2:
                self._collect()
                self._check_models()
                now = time.monotonic()
                if self._stop_requests and self._draining_since is None:
                    self._drain(now)
                if self.leases.time_is_up(now):
                    log.info("the time is up: what still runs is given back")
                    break
                self._start_children()
                if now >= self._silent_until:
                    self._talk(now)
                    self._start_children()
                if self._busy:
                    busy_at = now
                reason = self._reason_to_leave(now - busy_at)
                if reason and self._draining_since is None:
                    log.info("%s", reason)
                    self.stop()
                    self._drain(now)
                if self._draining_since is not None and self._drained(now):
                    break
            else:
                log.info("told to stop again: what still runs is given back")
        finally:
            self._leave()

    @property
    def _lent(self) -> int:
        """How many of the pool's processes stay idle while a loop is closed in another."""
        return 0 if self.close_loop_jobs is None else self.close_loop_jobs.busy

    @property
    def _running(self) -> int:
        """How many instances and close-loop jobs are under way."""
        return self.pool.running + self._lent

    @property
    def _busy(self) -> bool:
        return bool(self.leases.queue or self._running or self._checking)

    def _check_models(self) -> None:
        before, self._checking = self._checking, self.check_models()
        if before and not self._checking:
            self.leases.ask_soon()

    def _collect(self, seconds: float = TICK_SECONDS) -> None:
        """Put what the children have finished into the spool."""
        self._finish((done.ticket, done.result) for done in self.pool.wait(seconds))

    def _finish(self, done: Iterable[tuple[Ticket, Result]]) -> None:
        finished = []
        for ticket, result in done:
            if result["outcome"] != Outcome.AWAY:
                finished.append((ticket, result))
                continue
            self.lose_model(ticket.instance["model"], result["reason"])
            self.leases.give_up_model(ticket)
        self.spool.add([(t.lease.id, t.lease.fence, result) for t, result in finished])
        for ticket, result in finished:
            self.leases.finish(ticket, result["wall_seconds"])
        self.finished += len(finished)

    def _start_children(self) -> None:
        self.leases.drop_lost()
        while self.leases.queue and self.pool.free > self._lent:
            bundle, away = self._next_bundle()
            if bundle:
                self.pool.start_bundle(bundle)
            if away:
                return

    def _next_bundle(self) -> tuple[list[tuple[Mapping[str, Any], Ticket]], bool]:
        """Return what to give to one child, and whether a model that it needs cannot be fetched."""
        bundle = []
        for _ in range(self.leases.bundle_size):
            ticket = self.leases.queue.popleft()
            try:
                bundle.append((self.prepare(ticket.instance), ticket))
            except (Unreachable, ServerError):
                self.leases.queue.appendleft(ticket)
                return bundle, True
            except (RehybError, NoModelError) as error:
                bad = failed(ticket.instance, Outcome.BAD_MODEL, str(error))
                self._finish([(ticket, bad)])
        return bundle, False

    def _talk(self, now: float) -> None:
        """Post, release and lease as is due; stay silent for a while if nobody answers."""
        try:
            # A request for work takes along what there is to post, which saves a request.
            asks = self._request(now) is not None and len(self.spool) > 0
            if asks or now >= self._post_at or self.leases.any_finished:
                self._posting.bring_back(now)
                for number, batch in enumerate(iter(self.spool.next_batch, None)):
                    if number:
                        # An answer may take a while, in which the children must not stand idle.
                        self._collect(0.0)
                        self._start_children()
                    self._posting.post(batch, self._request(now))
                    self.renewals.progress()
                self._post_at = now + POST_SECONDS
                self.leases.release()
            if request := self._request(now):
                self.leases.ask(request, now)
        except (Unreachable, ServerError) as error:
            if isinstance(error, WrongProtocol) and not self._answered:
                raise
            self._failures += 1
            self._silent_until = now + backoff.full_jitter(self._failures, self.rng)
            if self._failures == 1:
                log.warning("%s; %s", error, self._what_follows(error))
        else:
            if self._failures:
                log.info("the coordinator answers%s", " again" if self._answered else "")
            self._failures = 0
            self._answered = True
            self.renewals.progress()

    def _what_follows(self, error: RehybError) -> str:
        """Say what is done about a coordinator that does not answer, and what if that is wrong."""
        if self._answered:
            return "trying again, results are kept on disk"
        if isinstance(error, Unreachable):
            return "trying again until one answers"
        url = self.leases.client.url
        return f"trying again until {url} answers; set REHYB_URL if the coordinator is elsewhere"

    def _request(self, now: float) -> LeaseRequest | None:
        """Return what to ask for now; None if there is enough to do, or it is too early."""
        processes = self.pool.processes - self._lent
        enough = max(processes, self.leases.ahead)
        if self._draining_since is not None or len(self.leases.queue) >= enough:
            return None
        return self.leases.request(now)

    def _reason_to_leave(self, idle_seconds: float) -> str:
        """Return why the worker leaves by itself; empty if it does not."""
        if self.leases.left == 0 and not self.leases.queue:
            return "that was the last instance asked for: leaving"
        if self.leases.ends_too_soon(time.monotonic()):
            return "another instance would not be finished in time: leaving"
        if self.max_idle is not None and not self._busy and idle_seconds >= self.max_idle:
            return f"no work for {self.max_idle:g} s: leaving"
        return ""

    def _drain(self, now: float) -> None:
        log.info("takes no more work, and leaves when what runs is done (%d)", self._running)
        self._draining_since = now
        if self.close_loop_jobs is not None:
            self.close_loop_jobs.drain()
        self.leases.give_up_queue()

    def _drained(self, now: float) -> bool:
        if self._running:
            # The farewell is counted from the moment the last result is there.
            self._draining_since = now
            return False
        return not (self.leases or len(self.spool)) or (
            now - (self._draining_since or now) > backoff.FAREWELL_SECONDS
        )

    def _leave(self) -> None:
        """Tell the coordinator all it should know, once; what it does not hear expires or waits."""
        self.leases.client.answer_by = self.leases.leave_at
        self.pool.kill()
        if self.close_loop_jobs is not None:
            self.close_loop_jobs.close()
        self.leases.give_up()
        try:
            while batch := self.spool.next_batch():
                self._posting.post(batch)
            self.leases.release()
        except RehybError as error:
            log.warning("could not say that it leaves, so that its leases expire: %s", error)
        if left := len(self.spool):
            log.warning("%d results stay on disk for the next worker to post", left)
        self.renewals.close()
        self.spool.close()
        log.info("left, after %d instances", self.finished)
