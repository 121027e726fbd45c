"""Child processes that evaluate instances, so that a segfault or a hang costs one instance only.

The children are spawned, not forked: they load MuJoCo and NumPy, the parent never does.
"""

import json
import multiprocessing
import os
import signal
import time
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import wait
from typing import Any

from models.evaluation import Evaluation
from models.processes import descendants
from models.running.child import Evaluate, Result, evaluate_until_closed, failed, needed
from models.running.outcomes import Outcome

#: Seconds a killed child gets to disappear.
REAP_SECONDS = 5.0
#: That a child may take to start, or to load a model, beyond the first instance's own limit.
LOAD_SECONDS = 60.0
#: Bytes read at once.
CHUNK = 65_536


def available_cores() -> int:
    """Return how many cores this process may use: a batch system grants fewer than there are."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def evaluate_model(instance: Mapping[str, Any]) -> Evaluation:
    """Evaluate an instance of any model, imported here so that only the child loads it."""
    from models.running.place import evaluate

    return evaluate(instance)


@dataclass(frozen=True, kw_only=True)
class Finished:
    """One instance that is done, one way or another."""

    #: What the caller passed to `start`.
    ticket: Any
    #: As `POST /v1/results` takes it.
    result: Result


class Pool:
    """A fixed number of child processes.

    Args:
        processes: how many instances run at once.
        instance_seconds: an instance that takes longer is killed and reported "timed_out".
        evaluate: what a child calls with an instance; it can be pickled.
        memory_mb: an instance that takes more memory has crashed; None: no limit.
    """

    def __init__(
        self,
        processes: int,
        instance_seconds: float,
        evaluate: Evaluate = evaluate_model,
        memory_mb: int | None = None,
    ) -> None:
        self.processes = processes
        self._instance_seconds = instance_seconds
        self._evaluate = evaluate
        self._memory_mb = memory_mb
        self._idle: list[_Child] = []
        self._busy: list[_Child] = []

    @property
    def free(self) -> int:
        """How many processes have nothing to do."""
        return self.processes - len(self._busy)

    @property
    def running(self) -> int:
        """How many instances have been started and have no result."""
        return sum(len(child.open) for child in self._busy)

    def start(self, instance: Mapping[str, Any], ticket: Any) -> None:
        """Begin to evaluate `instance` {"id", "model", "parameters"}; one child must be free.

        It may hold "time_limit", in seconds of wall time, which cuts the pool's own shorter.
        """
        self.start_bundle([(instance, ticket)])

    def start_bundle(self, bundle: Sequence[tuple[Mapping[str, Any], Any]]) -> None:
        """Have one child evaluate instances, each with its ticket, one after another.

        Each has its own time limit, which begins when its model is loaded, and its own result, as
        soon as it is done. If one of them ends the child, those after it go to another one.
        """
        if not self.free:
            raise RuntimeError(f"all {self.processes} processes are busy")
        child = self._idle.pop() if self._idle else _Child(self._evaluate, self._memory_mb)
        work = [_Begun(dict(one), ticket, self._seconds(one)) for one, ticket in bundle]
        try:
            child.begin(work)
        except OSError:
            # It died while idle (the kernel's out-of-memory killer does that): not this
            # instance's fault.
            child.kill()
            child = _Child(self._evaluate, self._memory_mb)
            child.begin(work)
        self._busy.append(child)

    def _seconds(self, instance: Mapping[str, Any]) -> float:
        return min(self._instance_seconds, instance.get("time_limit") or self._instance_seconds)

    def wait(self, seconds: float) -> list[Finished]:
        """Return what finishes within `seconds`, soon after anything does."""
        if not self._busy:
            time.sleep(seconds)
            return []
        overdue = min(child.deadline for child in self._busy)
        seconds = max(0.0, min(seconds, overdue - time.monotonic()))
        ready = wait([child.bell for child in self._busy], seconds)
        finished = []
        for child in list(self._busy):
            finished += child.collect(called=child.bell in ready)
            if child.open and child.alive:
                continue
            self._busy.remove(child)
            if child.alive:
                self._idle.append(child)
            elif child.open:
                self._begin_afresh(list(child.open))
        return finished

    def _begin_afresh(self, work: list["_Begun"]) -> None:
        """Have a new child do what another one did not come to."""
        child = _Child(self._evaluate, self._memory_mb)
        child.begin(work)
        self._busy.append(child)

    def kill(self) -> None:
        """End every child now, whatever it is doing."""
        for child in self._busy + self._idle:
            child.kill()
        self._busy.clear()
        self._idle.clear()


@dataclass(frozen=True)
class _Begun:
    """One instance that a child has, its ticket, and the seconds that it may take."""

    instance: dict[str, Any]
    ticket: Any
    seconds: float

    @property
    def model(self) -> Any:
        """What its child must have loaded."""
        return needed(self.instance)


class _Child:
    """One child process and the parent's ends of the pipes to it."""

    def __init__(self, evaluate: Evaluate, memory_mb: int | None) -> None:
        context = multiprocessing.get_context("spawn")
        #: Bundles go out, and one line of JSON for each result comes back.
        self._connection, theirs = context.Pipe()
        #: Whatever arrives here says that there are results; its end, that the child is gone.
        self.bell, their_bell = context.Pipe(duplex=False)
        self.alive = True
        #: What has no result, in the child's order: it is at the first.
        self.open: deque[_Begun] = deque()
        self._started = 0.0
        #: The models that it has loaded, as it says.
        self._at_hand: set[Any] = set()
        self._said = b""
        self._process = context.Process(
            target=evaluate_until_closed,
            args=(theirs, their_bell, evaluate, os.getpid(), memory_mb),
            daemon=True,
        )
        self._process.start()
        # Without our copies of its ends, the pipes close when the child dies.
        theirs.close()
        their_bell.close()
        os.set_blocking(self.bell.fileno(), False)

    @property
    def deadline(self) -> float:
        """When the instance that it is at has taken too long, on the monotonic clock."""
        return self._started + self._limit

    @property
    def _limit(self) -> float:
        begun = self.open[0]
        return begun.seconds + (0.0 if begun.model in self._at_hand else LOAD_SECONDS)

    def begin(self, work: Sequence[_Begun]) -> None:
        """Send instances to the child, which has none."""
        self._connection.send([one.instance for one in work])
        self.open.extend(work)
        self._started = time.monotonic()

    def collect(self, *, called: bool) -> list[Finished]:
        """Return what is done; a child that is gone, or too slow, is ended with what it was at."""
        finished: list[Finished] = []
        gone = called and self._gone()
        sound = self._read(finished)
        if gone or not sound:
            if gone:
                self._process.join(REAP_SECONDS)
            how = _how_it_ended(self._process.exitcode) if sound else "wrote what is no result"
            self.kill()
            if self.open:
                seconds = time.monotonic() - self._started
                reason = f"the process evaluating it {how}"
                finished.append(self._lost(Outcome.CRASHED, reason, seconds))
        elif self.open and time.monotonic() >= self.deadline:
            self.kill()
            limit = self._limit
            reason = f"still running after {limit:g} s"
            finished.append(self._lost(Outcome.TIMED_OUT, reason, limit))
        return finished

    def _gone(self) -> bool:
        """Empty the bell; returns whether the child has closed it."""
        try:
            return not os.read(self.bell.fileno(), CHUNK)
        except BlockingIOError:
            return False

    def _read(self, finished: list[Finished]) -> bool:
        """Add the results that the child has written; returns False if something else came."""
        descriptor = self._connection.fileno()
        os.set_blocking(descriptor, False)
        try:
            while chunk := os.read(descriptor, CHUNK):
                *lines, self._said = (self._said + chunk).split(b"\n")
                # One by one: what came before a line that is none has left `open`, and counts.
                for line in lines:
                    if done := self._heard(line):
                        finished.append(done)
        except (LookupError, TypeError, ValueError):
            return False
        except (BlockingIOError, ConnectionError):
            pass
        finally:
            os.set_blocking(descriptor, True)
        return True

    def _heard(self, line: bytes) -> Finished | None:
        """Return the result of the instance that the child is at; None: it is only beginning.

        Raises:
            LookupError, TypeError, ValueError: the line is none; a model's own process wrote it.
        """
        identity, now, report = json.loads(line)
        begun = self.open[0]
        if identity is None:
            self._at_hand.add(begun.model)
            self._started = float(now)
            return None
        if identity != begun.instance["id"]:
            raise ValueError("a result of another instance")
        done = Finished(ticket=begun.ticket, result={"instance": identity, **report})
        self._started = float(now)
        self.open.popleft()
        return done

    def _lost(self, outcome: Outcome, reason: str, seconds: float) -> Finished:
        begun = self.open.popleft()
        return Finished(
            ticket=begun.ticket, result=failed(begun.instance, outcome, reason, seconds)
        )

    def kill(self) -> None:
        self.alive = False
        # A model's program may have started others, which nobody else would end.
        started = descendants(self._process.pid) if self._process.pid else []
        self._process.kill()
        for pid in started:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self._process.join(REAP_SECONDS)
        self._connection.close()
        self.bell.close()


def _how_it_ended(code: int | None) -> str:
    if code is not None and code < 0:
        return f"was ended by {signal.Signals(-code).name}"
    return f"exited with status {code}"
