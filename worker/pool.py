"""Child processes that evaluate instances, so that a segfault or a hang costs one instance only.

The children are spawned, not forked: they load MuJoCo and NumPy, the parent never does.
"""

import multiprocessing
import os
import resource
import signal
import time
import traceback
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from math import isfinite
from multiprocessing.connection import Connection, wait
from typing import Any

from models.curves import Curve, folded
from models.evaluation import Evaluation, ModelFailure
from models.processes import adopt_orphans, descendants, die_with_parent
from worker.outcomes import Outcome

#: Of {"id", "model", "parameters"}; it raises ModelFailure where a model has no answer.
Evaluate = Callable[[Mapping[str, Any]], Evaluation]
Result = dict[str, Any]

#: Spare machines belong to somebody: their own work goes first.
NICENESS = 5
#: An instance uses one core; one child per core is what uses the machine.
SINGLE_THREAD = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)
#: Seconds a killed child gets to disappear.
REAP_SECONDS = 5.0


def available_cores() -> int:
    """Return how many cores this process may use: a batch system grants fewer than there are."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def evaluate_model(instance: Mapping[str, Any]) -> Evaluation:
    """Evaluate an instance of any model, imported here so that only the child loads it."""
    from worker.models.evaluation import evaluate

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
        """How many more instances can be started now."""
        return self.processes - len(self._busy)

    @property
    def running(self) -> int:
        """How many instances are being evaluated."""
        return len(self._busy)

    def start(self, instance: Mapping[str, Any], ticket: Any) -> None:
        """Begin to evaluate `instance` {"id", "model", "parameters"}; one child must be free.

        It may hold "time_limit", in seconds of wall time, which cuts the pool's own shorter.
        """
        if not self.free:
            raise RuntimeError(f"all {self.processes} processes are busy")
        child = self._idle.pop() if self._idle else _Child(self._evaluate, self._memory_mb)
        try:
            child.begin(instance, ticket, self._seconds(instance))
        except OSError:
            # It died while idle (the kernel's out-of-memory killer does that): not this
            # instance's fault.
            child.kill()
            child = _Child(self._evaluate, self._memory_mb)
            child.begin(instance, ticket, self._seconds(instance))
        self._busy.append(child)

    def _seconds(self, instance: Mapping[str, Any]) -> float:
        return min(self._instance_seconds, instance.get("time_limit") or self._instance_seconds)

    def wait(self, seconds: float) -> list[Finished]:
        """Return what finishes within `seconds`, as soon as anything does."""
        if not self._busy:
            time.sleep(seconds)
            return []
        overdue = min(child.deadline for child in self._busy)
        seconds = max(0.0, min(seconds, overdue - time.monotonic()))
        ready = wait([child.connection for child in self._busy], seconds)
        finished = []
        for child in list(self._busy):
            if child.connection in ready:
                result = child.collect()
            elif time.monotonic() >= child.deadline:
                child.kill()
                limit = child.deadline - child.started
                result = failed(
                    child.instance, Outcome.TIMED_OUT, f"still running after {limit:g} s", limit
                )
            else:
                continue
            self._busy.remove(child)
            if child.alive:
                self._idle.append(child)
            finished.append(Finished(ticket=child.ticket, result=result))
        return finished

    def kill(self) -> None:
        """End every child now, whatever it is doing."""
        for child in self._busy + self._idle:
            child.kill()
        self._busy.clear()
        self._idle.clear()


class _Child:
    """One child process and the parent's end of the pipe to it."""

    def __init__(self, evaluate: Evaluate, memory_mb: int | None) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        self.alive = True
        self.started = self.deadline = 0.0
        self.instance: Mapping[str, Any] = {}
        self.ticket: Any = None
        self._process = context.Process(
            target=_evaluate_until_closed,
            args=(theirs, evaluate, os.getpid(), memory_mb),
            daemon=True,
        )
        self._process.start()
        # Without our copy of its end, the pipe closes when the child dies.
        theirs.close()

    def begin(self, instance: Mapping[str, Any], ticket: Any, seconds: float) -> None:
        self.connection.send(dict(instance))
        self.instance, self.ticket, self.started = instance, ticket, time.monotonic()
        self.deadline = self.started + seconds

    def collect(self) -> Result:
        try:
            report: Result = self.connection.recv()
        except (EOFError, OSError):
            self._process.join(REAP_SECONDS)
            code = self._process.exitcode
            self.kill()
            seconds = time.monotonic() - self.started
            reason = f"the process evaluating it {_how_it_ended(code)}"
            return failed(self.instance, Outcome.CRASHED, reason, seconds)
        return {"instance": self.instance["id"], **report}

    def kill(self) -> None:
        self.alive = False
        # A model's program may have started others, which nobody else would end.
        started = descendants(self._process.pid) if self._process.pid else []
        self._process.kill()
        for pid in started:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self._process.join(REAP_SECONDS)
        self.connection.close()


def failed(
    instance: Mapping[str, Any], outcome: Outcome, reason: str, seconds: float = 0.0
) -> Result:
    """Return the result of an instance that no child could evaluate to its end."""
    return {"instance": instance["id"], **_result(outcome, seconds, reason)}


def _result(
    outcome: str,
    wall_seconds: float,
    reason: str = "",
    state: object = None,
    outputs: Mapping[str, float] | None = None,
) -> Result:
    return {
        "outcome": outcome,
        "outputs": dict(outputs or {}),
        "reason": reason,
        "state": state,
        "wall_seconds": wall_seconds,
    }


def _how_it_ended(code: int | None) -> str:
    if code is not None and code < 0:
        return f"was ended by {signal.Signals(-code).name}"
    return f"exited with status {code}"


def _evaluate_until_closed(
    connection: Connection, evaluate: Evaluate, parent: int, memory_mb: int | None
) -> None:
    """Serve instances until the parent closes the pipe: the main function of a child."""
    # A terminal and a batch system signal the whole group; only the parent decides what to do.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    die_with_parent(parent, signal.SIGKILL)
    adopt_orphans()
    os.nice(NICENESS)
    os.environ.update(dict.fromkeys(SINGLE_THREAD, "1"))
    if memory_mb is not None:
        # Of what the process writes to; libraries reserve more address space than they use.
        resource.setrlimit(resource.RLIMIT_DATA, (memory_mb * 2**20, memory_mb * 2**20))
    while True:
        try:
            instance = connection.recv()
        except EOFError:
            return
        report = _report(evaluate, instance)
        try:
            connection.send(report)
        except OSError:
            return


def _report(evaluate: Evaluate, instance: Mapping[str, Any]) -> Result:
    """Evaluate one point and word the outcome as JSON that any coordinator can take."""
    started = time.monotonic()
    try:
        done = evaluate(instance)
    except ModelFailure as failure:
        seconds = time.monotonic() - started
        return _result(failure.outcome, seconds, failure.reason, _as_json(failure.state))
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        state = {"traceback": traceback.format_exc()}
        return _result(Outcome.CRASHED, time.monotonic() - started, reason, state)
    outputs = {name: float(value) for name, value in done.outputs.items()}
    state = _as_json(done.state)
    for name, value in outputs.items():
        if not isfinite(value):
            reason = f"{name} came out as {value}"
            return _result(Outcome.NOT_FINITE, done.wall_seconds, reason, state)
    asked = instance.get("curves", {})
    sent = folded(outputs, {name: Curve.from_json(said) for name, said in asked.items()})
    return _result(done.outcome, done.wall_seconds, done.reason, state, sent)


def _as_json(value: Any) -> Any:
    """Return `value` as plain JSON; a state dump of a diverged simulation is full of NaN."""
    if isinstance(value, Mapping):
        return {str(key): _as_json(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_as_json(entry) for entry in value]
    if hasattr(value, "tolist"):
        return _as_json(value.tolist())
    if isinstance(value, float):
        return value if isfinite(value) else None
    if value is None or isinstance(value, bool | int | str):
        return value
    return str(value)
