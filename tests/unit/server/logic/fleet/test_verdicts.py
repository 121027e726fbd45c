"""What the coordinator makes of a posted result."""

from collections.abc import Callable
from dataclasses import replace
from functools import reduce
from math import inf, nan
from typing import Any

import pytest

from server.logic.fleet.verdicts import REASON_LENGTH, Judgement, Report, judge, judge_all
from server.records import Instance, Lease, Result
from server.states import REFUSALS, InstanceState

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


LOST = replace(STORED, outcome="lost", outputs=None)


@pytest.mark.parametrize("changes", [{}, {"outcome": "slipped", "outputs": None}])
def test_what_comes_after_an_instance_was_given_up_as_lost_is_its_result(
    changes: dict[str, Any], report: Reporting
) -> None:
    judgement = judged(report("i", **changes), DONE, LOST)
    assert judgement.verdict == "accepted"
    assert judgement.instead is not None
    assert judgement.instead.outcome == changes.get("outcome", "ok")
    assert (judgement.instance, judgement.result, judgement.conflict) == (None, None, None)


def test_of_what_is_final_nothing_but_a_loss_gives_way(report: Reporting) -> None:
    for outcome in ("crashed", "timed_out", "invalid", "slipped"):
        stored = replace(LOST, outcome=outcome)
        assert judged(report("i"), DONE, stored).verdict == "conflict"
    assert judged(report("i", outcome="crashed"), DONE, LOST).verdict == "duplicate"
    other = replace(DONE, host_class="other kind")
    assert judged(report("i"), other, LOST).verdict == "conflict"


def test_an_instance_the_lease_never_held_is_unknown(report: Reporting) -> None:
    judgement = judged(report("i"), None)
    assert judgement.verdict == "unknown"
    assert judgement.verdict in REFUSALS


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
    {"outcome": "diverged", "state": reduce(lambda state, _: {"inside": state}, range(900), {})},
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
    assert (judgement.verdict, judgement.detail) == ("invalid", "output y is missing")
    assert judgement.instance is None


def test_a_reason_is_cut_to_what_somebody_reads(report: Reporting) -> None:
    judgement = judged(report("i", outcome="stuck", reason="\0" + "x" * 10_000))
    assert judgement.result is not None
    assert judgement.result.reason == "x" * REASON_LENGTH


FULL = Instance(
    row=0,
    position=2,
    state=InstanceState.LEASED,
    lease="mine",
    attempts={"lost": 1},
    host_class="kind",
    avoid="a",
    hosts={"lost": ("a",)},
)
ON_B = replace(MINE, host="b", host_class="kind")


def test_what_is_said_names_the_instance_and_the_reason(report: Reporting) -> None:
    unknown = judged(report("i"), None)
    assert (unknown.about, unknown.detail) == ("i", "the lease never held this instance")
    assert (unknown.result, unknown.conflict) == (None, None)
    late = judged(report("i", outcome="crashed"), ELSEWHERE)
    assert (late.about, late.detail) == ("i", "this attempt no longer counts")
    again = judged(report("i"), DONE, STORED)
    assert (again.about, again.detail) == ("i", "")
    other = judged(report("i", outcome="stuck", reason="r"), DONE, STORED)
    assert other.detail == "the instance already has another result, ok"
    assert other.conflict is not None and other.conflict.outcome == "stuck"
    taken = judged(report("i"))
    assert (taken.about, taken.detail, taken.conflict) == ("i", "", None)


def test_a_result_is_kept_with_its_place_and_all_that_was_said(report: Reporting) -> None:
    said = report("i", outputs={"y": 2}, reason="fine", state={"t": 1.0}, wall_seconds=3)
    taken = judged(said, FULL)
    assert taken.result == Result(
        row=0,
        position=2,
        outcome="ok",
        outputs={"y": 2.0},
        reason="fine",
        state={"t": 1.0},
        wall_seconds=3.0,
    )
    assert taken.instance == replace(FULL, state="done", lease=None)
    assert judged(report("i", reason=None, wall_seconds=None)).result == replace(
        STORED, wall_seconds=None
    )


def test_a_row_given_to_another_kind_of_machine_takes_no_bits_of_this_one(
    report: Reporting,
) -> None:
    moved = replace(FULL, lease="other", host_class="other kind")
    verdict = judge(report("i"), instance=moved, stored=None, lease=ON_B, outputs=["y"])
    assert (verdict.verdict, verdict.detail) == (
        "conflict",
        "the row was given to another kind of machine meanwhile",
    )
    assert verdict.conflict is not None and verdict.result is None
    unbound = replace(FULL, state="pending", lease=None, host_class=None)
    waits = judge(report("i"), instance=unbound, stored=None, lease=ON_B, outputs=["y"])
    assert (waits.verdict, waits.detail) == (
        "conflict",
        "the row is to be begun anew, on any kind of machine",
    )
    kept = replace(moved, lease="mine")
    assert (
        judge(report("i"), instance=kept, stored=None, lease=ON_B, outputs=["y"]).verdict
        == "accepted"
    )


def test_what_was_taken_back_is_not_taken_again_but_from_who_computes_it_anew(
    report: Reporting,
) -> None:
    known: Any = {"stored": None, "lease": ON_B, "outputs": ["y"], "superseded": True}
    for again in (replace(FULL, state="pending", lease=None), replace(FULL, lease="other")):
        verdict = judge(report("i"), instance=again, **known)
        assert (verdict.verdict, verdict.instance) == ("duplicate", None)
        assert verdict.detail == "its result was taken back meanwhile: it runs again"
    assert judge(report("i"), instance=replace(FULL, lease="mine"), **known).verdict == "accepted"


@pytest.mark.parametrize("changes", [{"outcome": "crashed", "outputs": None}, {"outputs": {}}])
def test_an_attempt_that_failed_is_counted_on_its_host_among_those_at_work(
    changes: dict[str, Any], report: Reporting
) -> None:
    cause = changes.get("outcome", "invalid")
    twice = replace(FULL, attempts={cause: 2}, hosts={cause: ("b",)})
    asked = {"instance": twice, "stored": None, "lease": ON_B, "outputs": ["y"]}
    others = judge(report("i", **changes), **asked, at_work=lambda: ("b", "c"))
    assert others.about == "i" and others.result is None
    assert others.instance is not None and others.instance.avoid == "b"
    assert (others.instance.attempts, others.instance.hosts) == ({cause: 3}, {cause: ("b",)})
    alone = judge(report("i", **changes), **asked, at_work=lambda: ("b",))
    assert alone.result is not None and alone.result.outcome == cause
    if cause == "crashed":
        assert (others.detail, alone.detail) == ("attempt 3 of 3",) * 2
    else:
        assert alone.detail == alone.result.reason == "output y is missing"


def test_attempts_beyond_the_budget_are_counted_as_they_are(report: Reporting) -> None:
    often = replace(FULL, attempts={"crashed": 3}, hosts={"crashed": ("b",)})
    said = report("i", outcome="crashed", state={"t": 1.0}, wall_seconds=2, reason="r")
    asked = {"instance": often, "stored": None, "lease": ON_B, "outputs": ["y"]}
    assert judge(said, **asked, at_work=lambda: ("b", "c")).detail == "attempt 4 of 4"
    final = judge(said, **asked, at_work=lambda: ("b",)).result
    assert final is not None
    assert (final.state, final.wall_seconds, final.reason) == ({"t": 1.0}, 2.0, "r")


def test_reports_of_one_request_are_judged_in_the_light_of_those_before(report: Reporting) -> None:
    reports = [
        report("i"),
        report("i"),
        report("i", outputs={"y": 2.0}),
        report("j", outcome="crashed"),
        report("j", outcome="crashed"),
        report("stranger"),
    ]
    judgements = judge_all(
        reports,
        places={"i": (0, 2), "j": (0, 3)},
        instances={(0, 2): HELD, (0, 3): replace(HELD, position=3)},
        stored={},
        lease=MINE,
        outputs=["y"],
    )
    assert [one.verdict for one in judgements] == [
        "accepted",
        "duplicate",
        "conflict",
        "accepted",
        "duplicate",
        "unknown",
    ]
    assert [one.about for one in judgements] == ["i", "i", "i", "j", "j", "stranger"]
    found = judge_all(
        [report("i"), report("i"), report("i", outputs={"y": 2.0})],
        places={"i": (0, 2)},
        instances={(0, 2): DONE},
        stored={(0, 2): LOST},
        lease=MINE,
        outputs=["y"],
    )
    assert [one.verdict for one in found] == ["accepted", "duplicate", "conflict"]
