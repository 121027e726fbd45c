"""What the coordinator makes of a posted result: accepted, duplicate, conflict and so on."""

import re
from collections.abc import Callable, Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from analysis.json_values import is_finite_number
from analysis.sensitivity.records import LARGEST_OUTPUT
from models.curves import Curve, CurveError, unfolded
from server.logic.json_values import cut, flaw_in, is_unicode
from server.logic.study.instances import (
    BUDGETS,
    RESERVED,
    RETRIED,
    STANDINGS,
    after_attempt,
    with_result,
)
from server.records import Instance, Lease, Place, Result, record
from server.states import InstanceState, Outcome, Verdict

#: Characters kept of a reason: a sentence or a traceback, not a log.
REASON_LENGTH = 4000
#: Most seconds of a run, thirty years: sums of what no clock showed would be infinite.
LONGEST_RUN = 1e9
#: Levels of nesting a state may have, and how many values and characters.
STATE_DEPTH, STATE_VALUES = 32, 100_000

_NONE: Mapping[str, Curve] = MappingProxyType({})
#: What an outcome is called, a model's own too.
OUTCOME = r"[a-z_][a-z0-9_]{0,39}"
_OUTCOME = re.compile(OUTCOME)

# Looked up once: in Python 3.11 a member of an enum takes as long as a call.
_OK, _LEASED, _ACCEPTED = Outcome.OK, InstanceState.LEASED, Verdict.ACCEPTED


@record
class Report:
    """One result as a worker reports it; nothing about its values has been checked."""

    instance: str
    outcome: Any
    outputs: Any
    reason: Any
    state: Any
    wall_seconds: Any
    #: A key that no result has; None: there is none.
    unknown: str | None = None


@record
class Judgement:
    """What the worker is told about one result, and what changes with it."""

    #: Identifies the instance.
    about: str
    verdict: Verdict
    #: One sentence; empty if there is nothing to add.
    detail: str = ""
    #: The instance as it is now; None if it stays as it was.
    instance: Instance | None = None
    #: The instance's final result; None if there is none to store.
    result: Result | None = None
    #: A result in place of the stored `lost`, which says no more than that none had come.
    instead: Result | None = None
    #: A result that contradicts the stored one; None if there is none.
    conflict: Result | None = None


def judge_all(
    reports: Sequence[Report],
    *,
    places: Mapping[str, Place],
    instances: Mapping[Place, Instance],
    stored: Mapping[Place, Result],
    superseded: Collection[Place] = (),
    **known: Any,
) -> list[Judgement]:
    """Judge reports one after the other, each in the light of those before it.

    Args:
        places: of the instances that the lease was given.
        instances: those that are named, as they stand.
        stored: the final results of those that are done.
        superseded: those whose result was superseded since the lease was granted.
        known: lease, outputs, curves and at_work as in `judge`.
    """
    instances, stored = dict(instances), dict(stored)
    judgements = []
    for report in reports:
        place = places.get(report.instance, (-1, -1))
        judgement = judge(
            report,
            instance=instances.get(place),
            stored=stored.get(place),
            superseded=place in superseded,
            **known,
        )
        if judgement.instance is not None:
            instances[place] = judgement.instance
        if (found := judgement.result or judgement.instead) is not None:
            stored[place] = found
        judgements.append(judgement)
    return judgements


def judge(
    report: Report,
    *,
    instance: Instance | None,
    stored: Result | None,
    lease: Lease,
    outputs: Sequence[str],
    curves: Mapping[str, Curve] = _NONE,
    at_work: Callable[[], Collection[str]] = tuple,
    superseded: bool = False,
) -> Judgement:
    """Judge one report on an instance.

    Args:
        instance: where the instance stands; None if the lease never held it.
        stored: its final result; None unless it is done.
        outputs: the outputs an "ok" result must carry; of a curve, every point.
        curves: those that it must carry as lists, by name.
        at_work: returns the hosts of the lease's class that work on the study now.
        superseded: whether it had a final result that was superseded since the lease was granted.
    """

    def say(verdict: Verdict, detail: str = "", **changes: Any) -> Judgement:
        return Judgement(about=report.instance, verdict=verdict, detail=detail, **changes)

    if instance is None:
        return say(Verdict.UNKNOWN, "the lease never held this instance")
    held = instance.state == _LEASED and instance.lease == lease.id
    fault = fault_in(report, outputs, curves)
    if fault is not None:
        if not held:
            return say(Verdict.INVALID, fault)
        # Otherwise a worker that only talks nonsense could lease and return an instance for ever.
        counted, final = after_attempt(
            instance, cause=Outcome.INVALID, reason=fault, host=lease.host, at_work=at_work()
        )
        return say(Verdict.INVALID, fault, instance=counted, result=final)
    result = as_result(report, instance.row, instance.position, outputs, curves)
    if result.outcome in RETRIED and not held:
        return say(Verdict.DUPLICATE, "this attempt no longer counts")
    if stored is not None and stored.outcome != Outcome.LOST:
        if stored.same_as(result):
            return say(Verdict.DUPLICATE)
        detail = f"the instance already has another result, {stored.outcome}"
        return say(Verdict.CONFLICT, detail, conflict=result)
    if not held and superseded:
        # Or the same request, repeated by a network, would undo what an operator has decided.
        return say(Verdict.DUPLICATE, "its result was taken back meanwhile: it runs again")
    if not held and instance.host_class != lease.host_class:
        # Its bits may not be mixed with those that the rest of the row will have.
        detail = (
            "the row was given to another kind of machine meanwhile"
            if instance.host_class is not None
            else "the row is to be begun anew, on any kind of machine"
        )
        return say(Verdict.CONFLICT, detail, conflict=result)
    if stored is not None:
        return say(_ACCEPTED, "the instance had been given up as lost", instead=result)
    if result.outcome not in RETRIED:
        # As `say` would, without its detour: most reports end here.
        return Judgement(
            about=report.instance, verdict=_ACCEPTED, instance=with_result(instance), result=result
        )
    counted, final = after_attempt(
        instance,
        cause=result.outcome,
        reason=result.reason,
        host=lease.host,
        at_work=at_work(),
        state=result.state,
        wall_seconds=result.wall_seconds,
    )
    count, budget = counted.attempts[result.outcome], BUDGETS[result.outcome]
    return say(
        _ACCEPTED, f"attempt {count} of {max(count, budget)}", instance=counted, result=final
    )


def fault_in(
    report: Report, outputs: Sequence[str], curves: Mapping[str, Curve] = _NONE
) -> str | None:
    """Say in a sentence what is wrong with a report; None if it can be taken.

    The outputs of a failure are ignored: they are not numbers anybody may use.
    """
    if report.unknown is not None:
        return (
            f"a result has no {report.unknown[:40]!r}: it has instance, outcome, outputs, reason, "
            "state and wall_seconds"
        )
    ok = report.outcome == _OK
    if not ok and not (isinstance(report.outcome, str) and _OUTCOME.fullmatch(report.outcome)):
        return (
            "the outcome must be 'ok' or a failure in 1 to 40 of a to z, 0 to 9 and _, beginning "
            "with no digit"
        )
    if report.outcome in RESERVED:
        return f"only the coordinator concludes {report.outcome!r}"
    if report.outcome in STANDINGS:
        return f"{report.outcome!r} is where an instance stands, and no outcome"
    wall = report.wall_seconds
    if wall is not None and not (is_finite_number(wall) and 0 <= wall <= LONGEST_RUN):
        return f"wall_seconds must be a number from 0 to {LONGEST_RUN:g}, or null"
    if report.reason is not None and not isinstance(report.reason, str):
        return "reason must be text, or null"
    if report.reason and not is_unicode(report.reason):
        return f"the reason {_HALF}"
    if report.state is not None:
        if not isinstance(report.state, Mapping):
            return "state must be an object, or null"
        flaw = flaw_in(report.state, STATE_DEPTH, STATE_VALUES)
        if flaw is not None:
            return _FLAWS[flaw]
    if not ok:
        return None
    given = {} if report.outputs is None else report.outputs
    if not isinstance(given, Mapping):
        return "outputs must be an object: numbers by name"
    if curves:
        for name in curves:
            if name not in given:
                return f"output {name} is missing"
        try:
            given = unfolded(given, curves)
        except CurveError as error:
            return str(error)
    for name in outputs:
        if name not in given:
            return f"output {name} is missing"
        if not is_finite_number(given[name]):
            return f"output {name} must be a finite number"
        if abs(given[name]) > LARGEST_OUTPUT:
            return f"output {name} must be within ±{LARGEST_OUTPUT:g}: no larger number has indices"
    return None


def as_result(
    report: Report,
    row: int,
    position: int,
    outputs: Sequence[str],
    curves: Mapping[str, Curve] = _NONE,
) -> Result:
    """Return a faultless report as a result of the instance at `row` and `position`."""
    ok = report.outcome == _OK
    wall, given = report.wall_seconds, report.outputs or {}
    if ok and curves:
        given = unfolded(given, curves)
    return Result(
        row=row,
        position=position,
        outcome=report.outcome,
        outputs={name: float(given[name]) for name in outputs} if ok else None,
        reason=cut(report.reason or "", REASON_LENGTH),
        state=report.state,
        wall_seconds=None if wall is None else float(wall),
    )


_HALF = "holds half of a character (a surrogate that is alone): send Unicode"
_FLAWS = {
    "half": f"the state {_HALF}",
    "nested": f"the state is nested more than {STATE_DEPTH} deep",
    "infinite": "the state holds a number that is not finite: send null instead",
    "long": f"the state holds more than {STATE_VALUES:,} values and characters",
}
