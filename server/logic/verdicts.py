"""What becomes of a posted result: accepted, duplicate, conflict, unknown or invalid."""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from math import isfinite
from typing import Any

from server.logic.records import record
from server.logic.slots import BUDGETS, Result, Slot, after_attempt, settled

#: Failures a worker may report that say more about the machine than about the simulation.
RETRIED = ("crashed", "timed_out")
#: Outcomes only the coordinator may conclude.
RESERVED = ("lost", "invalid")
#: Characters kept of a reason: a sentence or a traceback, not a log.
REASON_LENGTH = 4000
#: Levels of nesting a state may have.
STATE_DEPTH = 32

_OUTCOME = re.compile(r"[a-z_]{1,40}")


@record
class Report:
    """One result as a worker reports it; nothing about its values has been checked."""

    instance: str
    outcome: str
    outputs: Mapping[str, Any]
    reason: str
    state: Mapping[str, Any] | None
    wall_seconds: Any


@record
class Verdict:
    """What the worker is told about one result."""

    instance: str
    #: "accepted", "duplicate", "conflict", "unknown" or "invalid".
    verdict: str
    #: One sentence; empty if there is nothing to add.
    detail: str = ""

    @property
    def refused(self) -> bool:
        """Whether the result was turned away."""
        return self.verdict in ("conflict", "unknown", "invalid")


@record
class Judgement:
    """A verdict and what the store must do about it."""

    verdict: Verdict
    #: The slot as it is now; None if it stays as it was.
    slot: Slot | None = None
    #: The instance's final result; None if there is none to store.
    result: Result | None = None
    #: A result that contradicts the stored one; None if there is none.
    conflict: Result | None = None


def judge(
    report: Report,
    *,
    slot: Slot | None,
    stored: Result | None,
    lease: str,
    outputs: Sequence[str],
    host: str | None = None,
    host_class: str | None = None,
    at_work: Callable[[], Collection[str]] = tuple,
) -> Judgement:
    """Judge one report on an instance.

    Args:
        report: what the worker says.
        slot: where the instance stands; None if the lease never held it.
        stored: its final result; None unless the slot is done.
        lease: the lease the report came under.
        outputs: the outputs an "ok" result must carry.
        host: the machine the report comes from.
        host_class: the class it belonged to when it took the lease.
        at_work: returns the hosts of that class that work on the study now.
    """

    def say(verdict: str, detail: str = "") -> Verdict:
        return Verdict(instance=report.instance, verdict=verdict, detail=detail)

    if slot is None:
        return Judgement(verdict=say("unknown", "the lease never held this instance"))
    held = slot.state == "leased" and slot.lease == lease
    fault = fault_in(report, outputs)
    if fault is not None:
        verdict = say("invalid", fault)
        if not held:
            return Judgement(verdict=verdict)
        # Otherwise a worker that only talks nonsense could lease and return an instance for ever.
        counted, final = after_attempt(
            slot, cause="invalid", reason=fault, host=host, at_work=at_work()
        )
        return Judgement(verdict=verdict, slot=counted, result=final)
    result = as_result(report, slot.row, slot.position, outputs)
    if result.outcome in RETRIED and not held:
        return Judgement(verdict=say("duplicate", "this attempt no longer counts"))
    if stored is not None:
        if stored.same_as(result):
            return Judgement(verdict=say("duplicate"))
        detail = f"the instance already has another result, {stored.outcome}"
        return Judgement(verdict=say("conflict", detail), conflict=result)
    if not held and slot.host_class != host_class:
        # Its bits may not be mixed with those that the rest of the row will have.
        detail = "the row was given to another kind of machine meanwhile"
        return Judgement(verdict=say("conflict", detail), conflict=result)
    if result.outcome not in RETRIED:
        return Judgement(verdict=say("accepted"), slot=settled(slot), result=result)
    counted, final = after_attempt(
        slot,
        cause=result.outcome,
        reason=result.reason,
        host=host,
        at_work=at_work(),
        state=result.state,
        wall_seconds=result.wall_seconds,
    )
    count, budget = counted.attempts[result.outcome], BUDGETS[result.outcome]
    tries = f"attempt {count} of {max(count, budget)}"
    return Judgement(verdict=say("accepted", tries), slot=counted, result=final)


def fault_in(report: Report, outputs: Sequence[str]) -> str | None:
    """Say in a sentence what is wrong with a report; None if it can be taken.

    The outputs of a failure are ignored: they are not numbers anybody may use.
    """
    ok = report.outcome == "ok"
    if not ok and not _OUTCOME.fullmatch(report.outcome):
        return "the outcome must be 'ok' or a failure in 1 to 40 lower-case letters and underscores"
    if report.outcome in RESERVED:
        return f"only the coordinator concludes {report.outcome!r}"
    if report.wall_seconds is not None and not _is_finite(report.wall_seconds):
        return "wall_seconds must be a finite number or null"
    if (fault := _fault_in_state(report.state)) is not None:
        return fault
    if not ok:
        return None
    for name in outputs:
        if name not in report.outputs:
            return f"output {name} is missing"
        if not _is_finite(report.outputs[name]):
            return f"output {name} must be a finite number"
    return None


def as_result(report: Report, row: int, position: int, outputs: Sequence[str]) -> Result:
    """Return a faultless report as a result of the instance at `row` and `position`."""
    ok = report.outcome == "ok"
    wall = report.wall_seconds
    return Result(
        row=row,
        position=position,
        outcome=report.outcome,
        outputs={name: float(report.outputs[name]) for name in outputs} if ok else None,
        # PostgreSQL cannot store the character NUL.
        reason=report.reason.replace("\0", "")[:REASON_LENGTH],
        state=report.state,
        wall_seconds=None if wall is None else float(wall),
    )


def _is_finite(value: Any) -> bool:
    """Say whether a JSON value is a number that a float can hold."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    try:
        return isfinite(value)
    except OverflowError:
        return False


def _fault_in_state(state: Any) -> str | None:
    """Say in a sentence why a parsed value cannot be stored as JSON; None if it can."""
    if state is None:
        return None
    left = [(state, 0)]
    while left:
        value, depth = left.pop()
        if depth > STATE_DEPTH:
            return f"the state is nested more than {STATE_DEPTH} deep"
        if isinstance(value, Mapping):
            left.extend((item, depth + 1) for item in value.values())
        elif isinstance(value, list):
            left.extend((item, depth + 1) for item in value)
        elif isinstance(value, float) and not isfinite(value):
            return "the state holds a number that is not finite: send null instead"
    return None
