"""Jobs on sessions of a worker: one at a time, in a thread beside the agent's.

A session takes a while to fetch and a report to hand in; meanwhile the agent goes on, and another
thread keeps the job's lease. The work itself is done by a child process, which may crash or hang:
the thread only waits.
"""

import hashlib
import logging
import time
from collections.abc import Callable, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from random import Random
from threading import Event, Thread
from typing import Any

from models.running.outcomes import Outcome
from models.running.pool import Pool
from rehyb.client import Client
from rehyb.client.states import JobKind
from rehyb.errors import Conflict, Invalid, NotFound, RehybError, ServerError, Unreachable
from worker import backoff
from worker.close_loop.child import OUT, PROGRESS
from worker.close_loop.scratch import Scratch, file_name, sweep
from worker.leases import patience, renewal_time
from worker.renewing import Renewals

log = logging.getLogger(__name__)

#: Seconds the thread waits for its child before it looks at the clock and for signals again.
TICK_SECONDS = 0.2
#: Progress is sent at most this often, seconds.
PROGRESS_SECONDS = 0.5
#: Seconds before the next job after one that came to nothing for the worker's own reasons.
PAUSE_SECONDS = 5.0
#: Characters sent of a reason, and of a file's or a column's name.
REASON_LENGTH, PLACE_LENGTH = 4000, 1000
#: A worker that leaves at once waits no longer for an answer under way.
LEAVE_SECONDS = 10.0
#: A coordinator that fails at a report so often will not take it.
TRIES = 10

Job = Mapping[str, Any]


@dataclass(kw_only=True)
class Held:
    """The lease of the job under way."""

    client: Client
    job: Job
    renew_at: float
    #: What the job is at; empty before it has said.
    stage: str = ""
    #: Why the coordinator says that the lease is over; empty: it is not.
    lost: str = ""
    _sent: str = ""
    _send_at: float = 0.0

    def renew(self, now: float) -> None:
        """Renew the lease if it is time, or the job has come to another stage."""
        stage = self.stage
        news = stage != self._sent and now >= self._send_at
        if self.lost or (now < self.renew_at and not news):
            return
        try:
            self.client.renew_close_loop(self.job, stage or None)
        except (Conflict, NotFound) as error:
            self.lost = str(error)
        else:
            self._sent, self._send_at = stage, now + PROGRESS_SECONDS
            self.renew_at = renewal_time(now, self.job["ttl_seconds"])


@dataclass(kw_only=True)
class CloseLoopJobs:
    """Closes the loop on one session after the other; with a bank it interprets, too."""

    #: The coordinator; a connection of its own, beside the agent's.
    client: Client
    #: One child, which calls `worker.close_loop.child.work`.
    pool: Pool
    #: Shared by the workers of one machine for one coordinator; made when needed.
    folder: Path
    #: {"id", "host", "versions", "tags"} as the coordinator knows this worker.
    worker: Mapping[str, Any]
    #: Digest of the code that closes loops here.
    code: str
    #: Spreads the waits of many workers.
    rng: Random
    #: A bank's id and its file; None: it interprets nothing.
    bank: tuple[str, Path] | None = None
    #: How many processes of the machine it uses: 1 while it has a job, 0 otherwise.
    busy: int = 0

    def __post_init__(self) -> None:
        self._draining = Event()
        self._cut_short = Event()
        self._thread = Thread(target=self._run, name="close-loop jobs", daemon=True)

    def start(self) -> None:
        """Ask for work from now on."""
        self._thread.start()

    def drain(self) -> None:
        """Finish the job under way and ask for no other."""
        self._draining.set()

    def close(self) -> None:
        """End now: a job under way is given back."""
        self._draining.set()
        self._cut_short.set()
        if self._thread.ident is not None:
            self._thread.join(LEAVE_SECONDS)

    def _run(self) -> None:
        with suppress(OSError):
            sweep(self.folder)
        failures = 0
        while not self._draining.is_set():
            try:
                job = self.client.lease_close_loop(self.worker, self.bank and self.bank[0])
                wait, failures = backoff.without_work(self.client.retry_after, self.rng), 0
            except RehybError as error:
                # The agent says what is wrong with the coordinator.
                log.debug("no close-loop job: %s", error)
                job, failures = None, failures + 1
                wait = backoff.full_jitter(failures, self.rng)
            if job is None:
                self._draining.wait(wait)
                continue
            self.busy = 1
            try:
                self._close_loop(job)
            except (OSError, RehybError) as error:
                log.warning("job %s: %s", job["id"], error)
                self._give_up(job, error)
                # What went wrong is likely to go wrong again at once.
                self._draining.wait(PAUSE_SECONDS)
            finally:
                self.busy = 0

    def _close_loop(self, job: Job) -> None:
        kind = job.get("kind", JobKind.CLOSE_LOOP)
        log.info("%s of session %s", kind, job["session"]["name"])
        renew_at = renewal_time(time.monotonic(), job["ttl_seconds"])
        held = Held(client=self.client, job=job, renew_at=renew_at)
        renewals = Renewals(
            renew=held.renew, patience=partial(patience, job["ttl_seconds"]), rng=self.rng
        )
        with closing(renewals), Scratch(self.folder, job["lease"]) as folder:
            renewals.start()
            archive = folder / f"{file_name(job['session']['name'])}.zip"
            self._fetch(job, archive, renewals.progress)
            parameters = {"archive": str(archive)}
            if kind == JobKind.INTERPRETATION and self.bank is not None:
                parameters |= {"bank": str(self.bank[1]), "options": job["options"]}
            try:
                self.pool.start({"id": job["id"], "model": kind, "parameters": parameters}, None)
                result = self._wait_for_child(held, folder / PROGRESS, renewals.progress)
            finally:
                # Whatever one session did to the process, the next one gets a fresh one.
                self.pool.kill()
            if result is not None and result["outcome"] == Outcome.OK:
                code = self._code(result["state"])
                result = self._hand_in(job, folder / OUT, code)
            if result is not None:
                log.warning("job %s: %s", job["id"], result["reason"])
                self._until_heard(partial(self._report_failure, job, result))

    def _fetch(self, job: Job, archive: Path, on_chunk: Callable[[], object]) -> None:
        """Download a job's session."""
        session = job["session"]
        self.client.session_archive(session["id"], archive, on_chunk)
        with archive.open("rb") as file:
            if hashlib.file_digest(file, "sha256").hexdigest() != session["sha256"]:
                raise ServerError(f"session {session['id']} did not arrive as it was uploaded")

    def _wait_for_child(
        self, held: Held, progress: Path, on_look: Callable[[], object]
    ) -> dict[str, Any] | None:
        """Return what the child reports; None if the job is lost or given back."""
        while True:
            if finished := self.pool.wait(TICK_SECONDS):
                return finished[0].result
            if self._cut_short.is_set():
                self._give_back(held.job)
                return None
            if held.lost:
                log.warning("job %s is no longer ours: %s", held.job["id"], held.lost)
                return None
            on_look()
            held.stage = _read(progress)

    def _code(self, state: Mapping[str, Any] | None) -> str:
        """Return the digest of what made a report: of an interpretation with the bank it used."""
        if state is None:
            return self.code
        from analysis.interpretation.contract import code

        return code(state["bank"])

    def _hand_in(self, job: Job, out: Path, code: str) -> dict[str, Any] | None:
        """Hand in the report; returns the failure to report if the coordinator cannot use it."""
        maker = {"worker": self.worker["id"], "code": code}
        try:
            self._until_heard(partial(self.client.hand_in_report, job, out, **maker))
        except Invalid as error:
            return _crashed(f"the coordinator cannot use the report: {error}")
        except ServerError as error:
            return _crashed(f"the coordinator fails at the report: {error}")
        return None

    def _report_failure(self, job: Job, result: Mapping[str, Any]) -> None:
        bad = result["outcome"] == Outcome.BAD_SESSION
        self.client.fail_close_loop(
            job,
            worker=self.worker["id"],
            outcome=result["outcome"],
            reason=result["reason"][:REASON_LENGTH],
            where={name: _cut(value) for name, value in result["state"].items()} if bad else None,
        )

    def _until_heard(self, call: Callable[[], object]) -> None:
        """Tell the coordinator what came of a job, as often as it takes.

        Raises:
            ServerError: it has failed at it TRIES times.
            RehybError: it refuses it.
        """
        failures, refusals, leave_at = 0, 0, float("inf")
        while not self._cut_short.is_set():
            try:
                call()
                return
            except Unreachable:
                failures += 1
            except ServerError as error:
                failures, refusals = failures + 1, refusals + error.is_at_request
                if refusals >= TRIES:
                    raise
            # An event would wake up at once when draining begins, and ask without a pause.
            time.sleep(backoff.full_jitter(failures, self.rng))
            if self._draining.is_set():
                leave_at = min(leave_at, time.monotonic() + backoff.FAREWELL_SECONDS)
            if time.monotonic() > leave_at:
                log.warning("left without handing in a report: another worker will do it again")
                return

    def _give_up(self, job: Job, error: Exception) -> None:
        """Say that a job came to nothing here: counted if it is this machine's fault."""
        if isinstance(error, OSError):
            with suppress(RehybError):
                self._report_failure(job, _crashed(f"on the worker: {error}"))
        else:
            self._give_back(job)

    def _give_back(self, job: Job) -> None:
        # If it is not heard, the lease expires.
        with suppress(RehybError):
            self.client.release_close_loop(job)


def _crashed(reason: str) -> dict[str, Any]:
    return {"outcome": Outcome.CRASHED, "reason": reason, "state": None}


def _cut(value: Any) -> Any:
    return value[:PLACE_LENGTH] if isinstance(value, str) else value


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        return ""
