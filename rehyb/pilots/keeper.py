"""Keeps as many pilots as there is work for, until told to stop."""

import logging
import os
import secrets
import shlex
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from rehyb.client import Client, Json
from rehyb.errors import FleetError, ServerError, Unreachable
from rehyb.pilots.engines import Engine, JobState
from rehyb.pilots.job import ENVIRONMENT, JOB, MARKS, TICKETS, digits, script
from rehyb.pilots.marks import Marks
from rehyb.pilots.scaling import Work, head_start, may_start, step
from rehyb.pilots.settings import Settings
from rehyb.whole_files import whole_file

log = logging.getLogger(__name__)

NO_WORK = Work(waiting=0, under_way=0)

#: Seconds in which whoever drains says goodbye, after the last instance.
FAREWELL_SECONDS = 30.0
#: Pilots that end within so many seconds, so often in a row, will not be better for another.
SHORT_LIFE_SECONDS, SHORT_LIVES = 10.0, 5
#: After a batch system has refused something, nothing more is asked of it for so long.
REFUSED_SECONDS = 30.0
#: A batch system's list that lacks a job has ended it if it does so for so many seconds.
MISSING_SECONDS = 60.0


@dataclass(frozen=True, kw_only=True)
class Status:
    """How things stand."""

    waiting: int
    under_way: int
    wanted: int
    pilots_waiting: int
    pilots_running: int
    #: Pilots that are counted although they are not wanted: they finish what they run.
    pilots_leaving: int
    submitted: int
    #: What goes wrong; empty: nothing.
    trouble: str


@dataclass(kw_only=True)
class Keeper:
    """The pilots of one coordinator in one batch system."""

    settings: Settings
    engine: Engine
    client: Client
    #: What pilots show the coordinator.
    token: str
    #: Where the jobs find what they need; made by `prepare`.
    folder: Path
    jobs: dict[str, JobState] = field(default_factory=dict)
    submitted: int = 0
    #: What its pilots' workers know it by; a new one by each `prepare`.
    name: str = ""
    _tickets: dict[str, Path] = field(default_factory=dict)
    _standing: set[str] = field(default_factory=set)
    _starts: deque[float] = field(default_factory=lambda: deque(maxlen=10_000))
    _started_at: dict[str, float] = field(default_factory=dict)
    _short_lives: int = 0
    _silent_until: float = 0.0
    #: The pilots that are there, by their tickets' names.
    _marks: Marks = field(init=False)
    #: When the batch system's list was first seen to lack a job.
    _missing_since: dict[str, float] = field(default_factory=dict)
    #: When it was last looked, in seconds of `look`'s clock.
    _now: float = 0.0
    #: What there was to do when the coordinator was last asked.
    _work: Work = NO_WORK
    #: What the batch system said when it refused a pilot.
    _refusal: str = ""

    def __post_init__(self) -> None:
        self._marks = Marks(folder=self.folder / MARKS)

    def prepare(self) -> None:
        """Write what pilots need to find the coordinator, for the owner's eyes only.

        Pilots that an earlier keeper of the folder left behind when it was killed may be others
        than these. They are told to finish and leave, and counted until they have left.
        """
        for name in (TICKETS, MARKS):
            (self.folder / name).mkdir(parents=True, exist_ok=True)
        self.name = secrets.token_hex(4)
        told = {
            "REHYB_URL": self.client.url,
            "REHYB_TOKEN": self.token,
            "REHYB_WORKER_GROUP": self.group,
        }
        text = "".join(f"export {name}={shlex.quote(value)}\n" for name, value in told.items())
        path = self.folder / ENVIRONMENT
        path.unlink(missing_ok=True)
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(text)
        # Shells read a script as they go on: what they have begun must stay what it was.
        with whole_file(self.folder / JOB) as draft:
            draft.write_text(script(self.settings, self.folder))
        self._withdraw_tickets()

    @property
    def group(self) -> str:
        """What the coordinator knows the workers of its pilots by."""
        return f"pilots-{self.name}"

    def look(self, now: float) -> Status:
        """Look at work and jobs, and do what follows.

        Raises:
            FleetError: pilots end at once, again and again.
            Unauthorized: the coordinator refuses the token.
        """
        gone = self._mend()
        trouble = gone or self._note_ended(now)
        leaving = len(self._leaving())
        try:
            told = self.client.work(self.group)
        except (Unreachable, ServerError) as error:
            # Pilots keep what they have; none is started for nobody knows what.
            return self._status(self._work, len(self.jobs), str(error))
        self._work = work = Work(waiting=told["waiting"], under_way=told["under_way"])
        settings, quiet = self.settings, bool(gone) or now < self._silent_until
        room = may_start(self._starts, now=now, a_minute=settings.starts_a_minute)
        next_step = step(
            work,
            self.jobs,
            cores=settings.cores,
            minimum=settings.minimum,
            maximum=max(0, settings.maximum - leaving),
            may_start=0 if quiet else room,
        )
        try:
            if not quiet:
                self._cancel(next_step.cancel)
            for number in range(next_step.submit):
                self._submit(number, now)
        except FleetError as error:
            # A limit of the batch system, or it is away: pilots that end make room.
            self._silent_until = now + REFUSED_SECONDS
            self._refusal = f"no more pilots for now: {error}"
        if now < self._silent_until:
            trouble = trouble or self._refusal
        trouble = trouble or _what_others_must_do(told)
        return self._status(work, next_step.wanted, trouble)

    def drain(self, wait: Callable[[float], None], on_status: Callable[[Status], None]) -> None:
        """Have every pilot finish what it runs and leave; cancel what is not gone by then.

        Args:
            wait: waits so many seconds.
            on_status: is told how things stand after each wait.
        """
        self._withdraw_tickets()
        left = quiet_until = self.settings.instance + FAREWELL_SECONDS
        while True:
            self._note_ended(self._now, judging=False)
            waiting = [job for job, state in self.jobs.items() if state == JobState.WAITING]
            try:
                if left <= quiet_until:
                    self._cancel(waiting)
            except FleetError as error:
                log.warning("%s", error)
                quiet_until = left - REFUSED_SECONDS
            on_status(self._status(self._work, 0, ""))
            if not self.jobs or left <= 0.0:
                break
            wait(1.0)
            left -= 1.0
            self._now += 1.0
        self.end()

    def end(self) -> None:
        """Cancel every job that is left."""
        self._cancel(list(self.jobs))

    def _submit(self, number: int, now: float) -> None:
        standing = len(self._standing) < self.settings.minimum
        idle = "" if standing else f" --max-idle {digits(self.settings.idle)}"
        path = shlex.quote(str(self.folder / JOB))
        ticket = self.folder / TICKETS / secrets.token_hex(8)
        command = f"sh {path} {ticket.name} {head_start(number):g}{idle}"
        try:
            ticket.touch()
            job = self.engine.submit(command, "rehyb-pilot")
        except OSError as error:
            raise FleetError(f"{ticket.parent}: {error.strerror}") from None
        except FleetError:
            ticket.unlink(missing_ok=True)
            raise
        self._tickets[job] = ticket
        self.jobs[job] = JobState.WAITING
        self.submitted += 1
        self._starts.append(now)
        if standing:
            self._standing.add(job)
        log.info("submitted pilot %s", job)

    def _mend(self) -> str:
        """Make anew what somebody removed; return what is wrong if it cannot be made."""
        tickets = self.folder / TICKETS
        try:
            self._marks.make()
            if not tickets.is_dir():
                tickets.mkdir()
                # Who works has seen it, and leaves; who waits need not.
                for job, state in self.jobs.items():
                    if state == JobState.WAITING:
                        self._tickets[job].touch()
            (self.folder / JOB).stat()
        except OSError:
            return (
                f"{self.folder} is gone or not whole, without which no pilot works: "
                "start rehyb pilots again"
            )
        return ""

    def _withdraw_tickets(self) -> None:
        with suppress(FileNotFoundError):
            for ticket in (self.folder / TICKETS).iterdir():
                ticket.unlink(missing_ok=True)

    def _cancel(self, jobs: Iterable[str]) -> None:
        chosen = list(jobs)
        self.engine.cancel(chosen)
        for job in chosen:
            self._forget(job)

    def _note_ended(self, now: float, *, judging: bool = True) -> str:
        """Forget jobs that have ended; return what is wrong if the batch system does not say."""
        self._now = now
        self._marks.look(now)
        self._marks.clear_stale(now, {ticket.name for ticket in self._tickets.values()})
        try:
            found = self.engine.states(list(self.jobs)) if self.jobs else {}
        except FleetError as error:
            return str(error)
        for job, state in found.items():
            if state == JobState.ENDED or (state == JobState.MISSING and self._is_over(job)):
                if judging:
                    self._judge(job)
                self._marks.remove(self._tickets[job].name)
                self._forget(job)
            elif state != JobState.MISSING:
                self.jobs[job] = state
                self._missing_since.pop(job, None)
                if state == JobState.RUNNING:
                    self._started_at.setdefault(job, now)
        return ""

    def _is_over(self, job: str) -> bool:
        """Say whether a job has ended that the batch system's list lacks now."""
        since = self._missing_since.setdefault(job, self._now)
        ticket = self._tickets[job]
        if ticket.name in self._marks.fresh(self._now):
            self.jobs[job] = JobState.RUNNING
            return False
        # By its own account, or by the list's again and again.
        by_itself = self._marks.left(ticket.name) or _is_gone(ticket)
        return by_itself or self._now >= since + MISSING_SECONDS

    def _leaving(self) -> set[str]:
        """Return the pilots that are there though nobody wants them, by their tickets' names."""
        return self._marks.fresh(self._now) - {ticket.name for ticket in self._tickets.values()}

    def _judge(self, job: str) -> None:
        """Count pilots that end at once: a worker that cannot start costs allocation for ever."""
        ended = self._missing_since.get(job, self._now)
        lived = ended - self._started_at.get(job, ended)
        short = lived < min(SHORT_LIFE_SECONDS, self.settings.idle)
        self._short_lives = self._short_lives + 1 if short else 0
        log.info("pilot %s ended", job)
        if self._short_lives >= SHORT_LIVES:
            raise FleetError(
                f"{SHORT_LIVES} pilots in a row ended as soon as they began: "
                f"what they said is in {self.folder}"
            )

    def _forget(self, job: str) -> None:
        """Count a job no more; if it is there after all, it finishes what it runs and leaves."""
        self.jobs.pop(job, None)
        if (ticket := self._tickets.pop(job, None)) is not None:
            ticket.unlink(missing_ok=True)
        self._standing.discard(job)
        self._started_at.pop(job, None)
        self._missing_since.pop(job, None)

    def _status(self, work: Work, wanted: int, trouble: str) -> Status:
        waiting = sum(state == JobState.WAITING for state in self.jobs.values())
        return Status(
            waiting=work.waiting,
            under_way=work.under_way,
            wanted=wanted,
            pilots_waiting=waiting,
            pilots_running=len(self.jobs) - waiting,
            pilots_leaving=len(self._leaving()),
            submitted=self.submitted,
            trouble=trouble,
        )


def _is_gone(path: Path) -> bool:
    """Say whether a file is surely not there: a network's folder may be away."""
    try:
        path.stat()
    except FileNotFoundError:
        return True
    except OSError:
        return False
    return False


def _what_others_must_do(told: Json) -> str:
    """Return in a sentence what waits for workers of another kind; empty: nothing does.

    Pilots are taken to be alike: more of the same would come, wait, leave and come again for ever.
    """
    # An older coordinator does not know.
    unfit = told.get("unfit", 0)
    if not unfit:
        return ""
    return (
        f"no pilot is started for {unfit} more instance{'s' * (unfit > 1)}, which these pilots "
        f"cannot take: {told['why']}; change the pilots and start rehyb pilots again"
    )
