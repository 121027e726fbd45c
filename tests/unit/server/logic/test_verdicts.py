"""What the coordinator makes of a posted result."""

from collections.abc import Callable
from math import inf, nan
from typing import Any

import pytest

from server.logic.verdicts import REASON_LENGTH, Judgement, Report, judge
from server.records import Instance, Lease, Result
from server.states import REFUSALS

Reporting = Callable[..., Report]

MINE = Lease(
    id="mine", fence=1, worker="w", study="s", state="open", expires_at=9.0, instances=((0, 2),)
)
HELD = Instance(row=0, position=2, state="leased", lease="mine", attempts={})
ELSEWHERE = Instance(row=0, position=2, state="leased", lease="other", attempts={})
RETURNED = Instance(row=0, position=2, state="pending", lease=None, attempts={"lost": 1})
DONE = Instance(row=0, position=2, state="done", lease=None, attempts={})
STORED = Result(
    row=0,
    position=2,
    outcome="ok",
    outputs={"y": 1.5},
    reason="",
    state=None,
    wall_seconds=9.0,
)


def judged(
    report: Report, instance: Instance | None = HELD, stored: Result | None = None
) -> Judgement:
    return judge(report, instance=instance, stored=stored, lease=MINE, outputs=["y"])


@pytest.mark.parametrize("instance", [HELD, ELSEWHERE, RETURNED])
def test_a_result_for_an_empty_slot_is_taken_however_late(
    instance: Instance, report: Reporting
) -> None:
    judgement = judged(report("i"), instance)
    assert judgement.verdict == "accepted"
    assert judgement.instance is not None and judgement.instance.state == "done"
    assert judgement.result is not None
    assert (judgement.result.outcome, judgement.result.outputs) == ("ok", {"y": 1.5})


def test_a_failed_simulation_is_a_result_at_once(report: Reporting) -> None:
    state = {"time": 0.5, "q": [None, 1.0]}
    judgement = judged(report("i", outcome="diverged", outputs={}, reason="q1", state=state))
    assert judgement.verdict == "accepted"
    assert judgement.result is not None
    assert judgement.result.outcome == "diverged"
    assert (judgement.result.outputs, judgement.result.state) == (None, state)


def test_the_outputs_of_a_failure_are_not_kept(report: Reporting) -> None:
    judgement = judged(report("i", outcome="diverged", outputs={"y": nan}))
    assert judgement.result is not None and judgement.result.outputs is None


def test_outputs_the_study_does_not_keep_are_dropped(report: Reporting) -> None:
    judgement = judged(report("i", outputs={"y": 1, "z": 2.0}))
    assert judgement.result is not None and judgement.result.outputs == {"y": 1.0}


@pytest.mark.parametrize("outcome", ["crashed", "timed_out"])
def test_a_crash_of_the_holder_is_tried_again(outcome: str, report: Reporting) -> None:
    judgement = judged(report("i", outcome=outcome, outputs={}))
    assert judgement.verdict == "accepted"
    assert judgement.detail == "attempt 1 of 3"
    assert judgement.instance is not None and judgement.instance.state == "pending"
    assert judgement.result is None


@pytest.mark.parametrize("outcome", ["crashed", "timed_out"])
def test_the_third_crash_is_the_result(outcome: str, report: Reporting) -> None:
    instance = Instance(row=0, position=2, state="leased", lease="mine", attempts={outcome: 2})
    judgement = judged(report("i", outcome=outcome, reason="signal 11"), instance)
    assert judgement.result is not None
    assert (judgement.result.outcome, judgement.result.reason) == (outcome, "signal 11")


@pytest.mark.parametrize(
    ("instance", "stored"), [(ELSEWHERE, None), (RETURNED, None), (DONE, STORED)]
)
def test_a_crash_told_again_or_too_late_is_not_counted(
    instance: Instance, stored: Result | None, report: Reporting
) -> None:
    judgement = judged(report("i", outcome="crashed"), instance, stored)
    assert judgement.verdict == "duplicate"
    assert (judgement.instance, judgement.result, judgement.conflict) == (None, None, None)


def test_the_same_result_again_is_a_duplicate(report: Reporting) -> None:
    judgement = judged(report("i", wall_seconds=1.0, reason="again"), DONE, STORED)
    assert judgement.verdict == "duplicate"
    assert judgement.verdict not in REFUSALS
    assert judgement.result is None


@pytest.mark.parametrize("changes", [{"outputs": {"y": 1.5000000000000002}}, {"outcome": "stuck"}])
def test_another_result_for_a_filled_slot_is_a_conflict_and_kept_as_one(
    changes: dict[str, Any], report: Reporting
) -> None:
    judgement = judged(report("i", **changes), DONE, STORED)
    assert judgement.verdict == "conflict"
    assert judgement.verdict in REFUSALS
    assert judgement.conflict is not None
    assert (judgement.instance, judgement.result) == (None, None)


def test_an_instance_the_lease_never_held_is_unknown(report: Reporting) -> None:
    judgement = judged(report("i"), None)
    assert judgement.verdict == "unknown"
    assert judgement.verdict in REFUSALS


def _nested(levels: int) -> dict[str, Any]:
    state: dict[str, Any] = {}
    for _ in range(levels):
        state = {"inside": state}
    return state


INVALID: list[dict[str, Any]] = [
    {"outputs": {}},
    {"outputs": {"y": nan}},
    {"outputs": {"y": -inf}},
    {"outputs": {"y": -1.1e100}},
    {"outputs": {"y": None}},
    {"outputs": {"y": "1.5"}},
    {"outputs": {"y": True}},
    {"outputs": {"y": 10**400}},
    {"outcome": ""},
    {"outcome": "Diverged"},
    {"outcome": "diverged\n"},
    {"outcome": "d" * 41},
    {"outcome": "lost"},
    {"outcome": "invalid"},
    {"wall_seconds": nan},
    {"wall_seconds": -5},
    {"wall_seconds": "fast"},
    {"outcome": "diverged", "state": {"q": [0.0, {"deep": nan}]}},
    {"outcome": "diverged", "state": _nested(900)},
]


@pytest.mark.parametrize("changes", INVALID)
def test_a_report_that_makes_no_sense_is_invalid_and_costs_its_holder_an_attempt(
    changes: dict[str, Any], report: Reporting
) -> None:
    judgement = judged(report("i", **changes))
    assert judgement.verdict == "invalid"
    assert judgement.detail
    assert judgement.instance is not None and judgement.instance.attempts == {"invalid": 1}
    assert judgement.result is None


@pytest.mark.parametrize("instance", [ELSEWHERE, RETURNED])
def test_nonsense_from_a_former_holder_changes_nothing(
    instance: Instance, report: Reporting
) -> None:
    judgement = judged(report("i", outputs={}), instance)
    assert judgement.verdict == "invalid"
    assert judgement.instance is None


def test_a_reason_is_cut_to_what_somebody_reads(report: Reporting) -> None:
    judgement = judged(report("i", outcome="stuck", reason="\0" + "x" * 10_000))
    assert judgement.result is not None
    assert judgement.result.reason == "x" * REASON_LENGTH
