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
from dataclasses import dataclass
from math import isfinite
from multiprocessing.connection import Connection, wait
from typing import Any

from worker.outcomes import Outcome
from worker.parent_death import die_with_parent

Evaluate = Callable[[str, Mapping[str, Any]], Any]
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


def evaluate_with_sim(model: str, parameters: Mapping[str, float]) -> Any:
    """Evaluate with `sim`, imported here so that only the child loads it."""
    from sim.evaluation import evaluate

    return evaluate(model, parameters)


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
        evaluate: what a child calls with a model's name and parameters; importable by name.
        memory_mb: an instance that takes more memory has crashed; None: no limit.
    """

    def __init__(
        self,
        processes: int,
        instance_seconds: float,
        evaluate: Evaluate = evaluate_with_sim,
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
        """Begin to evaluate `instance` {"id", "model", "parameters"}; one child must be free."""
        if not self.free:
            raise RuntimeError(f"all {self.processes} processes are busy")
        child = self._idle.pop() if self._idle else _Child(self._evaluate, self._memory_mb)
        try:
            child.begin(instance, ticket)
        except OSError:
            # It died while idle (the kernel's out-of-memory killer does that): not this
            # instance's fault.
            child.kill()
            child = _Child(self._evaluate, self._memory_mb)
            child.begin(instance, ticket)
        self._busy.append(child)

    def wait(self, seconds: float) -> list[Finished]:
        """Return what finishes within `seconds`, as soon as anything does."""
        if not self._busy:
            time.sleep(seconds)
            return []
        overdue = min(child.started for child in self._busy) + self._instance_seconds
        seconds = max(0.0, min(seconds, overdue - time.monotonic()))
        ready = wait([child.connection for child in self._busy], seconds)
        finished = []
        for child in list(self._busy):
            if child.connection in ready:
                result = child.collect()
            elif time.monotonic() - child.started >= self._instance_seconds:
                child.kill()
                result = child.failed(
                    Outcome.TIMED_OUT, f"still running after {self._instance_seconds:g} s"
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
        self.started = 0.0
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

    def begin(self, instance: Mapping[str, Any], ticket: Any) -> None:
        self.connection.send((instance["model"], dict(instance["parameters"])))
        self.instance, self.ticket, self.started = instance, ticket, time.monotonic()

    def collect(self) -> Result:
        try:
            report: Result = self.connection.recv()
        except (EOFError, OSError):
            self._process.join(REAP_SECONDS)
            code = self._process.exitcode
            self.kill()
            return self.failed(Outcome.CRASHED, f"the process evaluating it {_how_it_ended(code)}")
        return {"instance": self.instance["id"], **report}

    def failed(self, outcome: Outcome, reason: str) -> Result:
        seconds = time.monotonic() - self.started
        return {"instance": self.instance["id"], **_result(outcome, seconds, reason)}

    def kill(self) -> None:
        self.alive = False
        self._process.kill()
        self._process.join(REAP_SECONDS)
        self.connection.close()


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
    os.nice(NICENESS)
    os.environ.update(dict.fromkeys(SINGLE_THREAD, "1"))
    if memory_mb is not None:
        # Of what the process writes to; libraries reserve more address space than they use.
        resource.setrlimit(resource.RLIMIT_DATA, (memory_mb * 2**20, memory_mb * 2**20))
    while True:
        try:
            model, parameters = connection.recv()
        except EOFError:
            return
        report = _report(evaluate, model, parameters)
        try:
            connection.send(report)
        except OSError:
            return


def _report(evaluate: Evaluate, model: str, parameters: Mapping[str, float]) -> Result:
    """Evaluate one point and word the outcome as JSON that any coordinator can take."""
    started = time.monotonic()
    try:
        done = evaluate(model, parameters)
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
    return _result(done.outcome, done.wall_seconds, done.reason, state, outputs)


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
