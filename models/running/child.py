"""What a child process of a pool does: evaluate what it is given, and write down each result."""

import json
import os
import resource
import signal
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from math import isfinite
from multiprocessing.connection import Connection
from typing import Any

from models.curves import Curve, folded
from models.evaluation import Evaluation, ModelAway, ModelFailure
from models.processes import adopt_orphans, die_with_parent
from models.running.outcomes import Outcome

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
#: A child that has several instances calls for its results to be read this often, s, and once
#: there are so many bytes of them: each call wakes the parent up, which costs more than a result.
CALL_SECONDS, CALL_BYTES = 0.02, 32_768
#: The models that this process has loaded, or tried to: see `needed`.
_AT_HAND: set[Any] = set()


def evaluate_until_closed(
    connection: Connection,
    bell: Connection,
    evaluate: Evaluate,
    parent: int,
    memory_mb: int | None,
) -> None:
    """Serve instances until the parent closes the pipe: the main function of a child."""
    # A terminal and a batch system signal the whole group; only the parent decides what to do.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    die_with_parent(parent, signal.SIGKILL)
    adopt_orphans()
    os.nice(NICENESS)
    os.environ.update(dict.fromkeys(SINGLE_THREAD, "1"))
    # A model of somebody's own, or a program that it runs, has no use for a fleet's token.
    for name in [name for name in os.environ if name.startswith("REHYB_")]:
        del os.environ[name]
    if memory_mb is not None:
        # Of what the process writes to; libraries reserve more address space than they use.
        resource.setrlimit(resource.RLIMIT_DATA, (memory_mb * 2**20, memory_mb * 2**20))
    while True:
        try:
            bundle = connection.recv()
        except EOFError:
            return
        try:
            _work_through(bundle, evaluate, connection.fileno(), bell.fileno())
        except OSError:
            return


def _work_through(
    bundle: Sequence[Mapping[str, Any]], evaluate: Evaluate, out: int, bell: int
) -> None:
    """Evaluate instances and write each result before the next is begun, so that none is lost.

    A line without an instance says when a model was at hand: its time limit begins there.
    """
    called, unread = time.monotonic(), 0
    for left, instance in enumerate(bundle, start=1 - len(bundle)):
        if _loaded(instance):
            _write(out, json.dumps((None, time.monotonic(), None)).encode() + b"\n")
        report = _report(evaluate, instance)
        ended = time.monotonic()
        line = json.dumps((instance["id"], ended, report)).encode() + b"\n"
        _write(out, line)
        unread += len(line)
        if not left or ended - called >= CALL_SECONDS or unread >= CALL_BYTES:
            _write(bell, b"!")
            called, unread = ended, 0


def needed(instance: Mapping[str, Any]) -> Any:
    """Return what stands for the model that an instance needs: its place; of rehyb's own the name.

    They do not share one entry: the closed forms need nothing, the elbow needs MuJoCo.
    """
    place = instance.get("place")
    return instance.get("model") if place is None else place


def _loaded(instance: Mapping[str, Any]) -> bool:
    """Load a model; returns False if it was there. What is wrong with it, its evaluation says."""
    model = needed(instance)
    if model in _AT_HAND:
        return False
    _AT_HAND.add(model)
    from models.running.place import load

    with suppress(Exception):
        load(instance)
    return True


def _write(descriptor: int, text: bytes) -> None:
    while text:
        text = text[os.write(descriptor, text) :]


def _report(evaluate: Evaluate, instance: Mapping[str, Any]) -> Result:
    """Evaluate one point and word the outcome as JSON that any coordinator can take."""
    started = time.monotonic()
    try:
        done = evaluate(instance)
    except ModelFailure as failure:
        seconds = time.monotonic() - started
        return result_of(failure.outcome, seconds, failure.reason, _as_json(failure.state))
    except ModelAway as away:
        return result_of(Outcome.AWAY, time.monotonic() - started, str(away))
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        state = {"traceback": traceback.format_exc()}
        return result_of(Outcome.CRASHED, time.monotonic() - started, reason, state)
    outputs = {name: float(value) for name, value in done.outputs.items()}
    state = _as_json(done.state)
    for name, value in outputs.items():
        if not isfinite(value):
            reason = f"{name} came out as {value}"
            return result_of(Outcome.NOT_FINITE, done.wall_seconds, reason, state)
    asked = instance.get("curves", {})
    sent = folded(outputs, {name: Curve.from_json(said) for name, said in asked.items()})
    return result_of(done.outcome, done.wall_seconds, done.reason, state, sent)


def _as_json(value: Any) -> Any:
    """Return `value` as plain JSON; a state dump of a diverged simulation is full of NaN."""
    if isinstance(value, Mapping):
        return {_text(str(key)): _as_json(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_as_json(entry) for entry in value]
    if hasattr(value, "tolist"):
        return _as_json(value.tolist())
    if isinstance(value, float):
        return value if isfinite(value) else None
    if value is None or isinstance(value, bool | int):
        return value
    return _text(str(value))


def _text(value: str) -> str:
    """Return `value` without halves of characters, which JSON can write, and no UTF-8."""
    return value.encode(errors="replace").decode()


def failed(
    instance: Mapping[str, Any], outcome: Outcome, reason: str, seconds: float = 0.0
) -> Result:
    """Return the result of an instance that no child could evaluate to its end."""
    return {"instance": instance["id"], **result_of(outcome, seconds, reason)}


def result_of(
    outcome: str,
    wall_seconds: float,
    reason: str,
    state: object = None,
    outputs: Mapping[str, float] | None = None,
) -> Result:
    return {
        "outcome": outcome,
        "outputs": dict(outputs or {}),
        "reason": _text(reason),
        "state": state,
        "wall_seconds": wall_seconds,
    }
