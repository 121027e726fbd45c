"""The life of a study."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from analysis.sensitivity.fewer_runs.limits import MOST_RUNS
from server.errors import ConflictError, InvalidStudyError
from server.logic.study import studies
from server.logic.study.plans import MAX_ROWS
from server.records import Instance, Place, Plan, Result, Study
from server.states import InstanceState, StudyState

DONE, PENDING = InstanceState.DONE, InstanceState.PENDING
Making = Callable[..., Study]
LEASED = Instance(row=0, position=0, state=InstanceState.LEASED, lease="L", attempts={})


@pytest.fixture
def study(plan: Callable[..., Plan]) -> Making:
    """A study of three rows of four instances."""

    def make(**changes: Any) -> Study:
        standing: dict[str, Any] = {"state": "running", "created_at": 1.0, **changes}
        standing["state"] = StudyState(standing["state"])
        return Study(id="s", plan=plan(rows=3), **standing)

    return make


def row_of(*states: str, row: int = 0) -> dict[Place, Instance]:
    return {
        (row, position): replace(LEASED, row=row, position=position, state=InstanceState(state))
        for position, state in enumerate(states)
    }


def result(position: int, outcome: str = "ok", row: int = 0) -> Result:
    return Result(
        row=row,
        position=position,
        outcome=outcome,
        outputs={"y": 1.0} if outcome == "ok" else None,
        reason="",
        state=None,
        wall_seconds=None,
    )


def test_a_study_of_a_fitted_function_has_no_more_runs_than_it_can_be_fitted_to(
    study: Making,
) -> None:
    running = study()
    fitted = replace(running, plan=replace(running.plan, method="surrogate"))
    assert studies.extended(fitted, MOST_RUNS).plan.rows == MOST_RUNS
    with pytest.raises(InvalidStudyError, match=f"a function to {MOST_RUNS} rows at most, not 513"):
        studies.extended(fitted, MOST_RUNS + 1)
    assert studies.extended(running, MOST_RUNS + 1).plan.rows == MOST_RUNS + 1


@pytest.mark.parametrize(
    ("handed_out", "count", "places", "wanted"),
    [
        (0, 1, [(0, 0), (0, 1), (0, 2), (0, 3)], 1),
        (0, 4, [(0, 0), (0, 1), (0, 2), (0, 3)], 4),
        (4, 5, [(1, 0), (1, 1), (1, 2), (1, 3), (2, 0), (2, 1), (2, 2), (2, 3)], 5),
        (8, 100, [(2, 0), (2, 1), (2, 2), (2, 3)], 4),
        (12, 100, [], 0),
    ],
)
def test_rows_are_begun_whole_and_none_beyond_the_last(
    study: Making, handed_out: int, count: int, places: list[Place], wanted: int
) -> None:
    assert studies.new_rows(study(handed_out=handed_out), count) == (places, wanted)


def test_the_first_lease_binds_the_study_to_its_code_and_later_ones_do_not(study: Making) -> None:
    begun = studies.handed_out(study(), begun=4, leased=3, identity={"code": "a"})
    assert (begun.handed_out, begun.leased, begun.identity) == (4, 3, {"code": "a"})
    later = studies.handed_out(begun, begun=8, leased=2, identity={"code": "b"})
    assert (later.handed_out, later.leased, later.identity) == (12, 5, {"code": "a"})


@pytest.mark.parametrize(
    ("changes", "bound"),
    [
        ({}, False),
        ({"leased": 1}, True),
        ({"result_count": 1, "ok_count": 1}, True),
        ({"result_count": 1, "failures": {"strap_lost": 1}}, True),
        ({"result_count": 2, "failures": {"lost": 2}}, False),
        ({"result_count": 2, "failures": {"lost": 1, "crashed": 1}}, True),
    ],
)
def test_a_study_belongs_to_the_code_that_has_computed_or_holds_some_of_it(
    study: Making, changes: dict[str, Any], bound: bool
) -> None:
    begun = study(identity={"code": "a"}, **changes)
    assert begun.bound_to == ({"code": "a"} if bound else None)
    after = studies.handed_out(begun, begun=0, leased=1, identity={"code": "b"})
    assert after.identity == {"code": "a" if bound else "b"}


def test_a_row_is_complete_with_the_last_of_its_results(study: Making) -> None:
    before = row_of("done", "done", "leased", "leased")
    running = study(handed_out=4, leased=2, result_count=2, ok_count=1, failures={"diverged": 1})
    one = studies.with_changes(
        running,
        before=before,
        after={(0, 2): replace(before[0, 2], state=DONE)},
        filed=[result(2)],
        now=5.0,
    )
    assert (one.leased, one.result_count, one.ok_count, one.rows_complete) == (1, 3, 2, 0)
    assert one.failures == {"diverged": 1}
    both = studies.with_changes(
        running,
        before=before,
        after={place: replace(before[place], state=DONE) for place in ((0, 2), (0, 3))},
        filed=[result(2, "diverged"), result(3, "lost")],
        now=5.0,
    )
    assert (both.leased, both.result_count, both.ok_count, both.rows_complete) == (0, 4, 1, 1)
    assert both.failures == {"diverged": 2, "lost": 1}
    assert (both.state, both.finished_at) == ("running", None)


def test_an_instance_that_came_back_is_held_by_nobody_and_is_no_result(study: Making) -> None:
    before = row_of("leased", "pending", "leased", "done")
    after = {place: replace(before[place], state=PENDING) for place in ((0, 0), (0, 1))}
    back = studies.with_changes(
        study(handed_out=4, leased=2, result_count=1, ok_count=1),
        before=before,
        after=after,
        filed=[],
        now=5.0,
    )
    assert (back.leased, back.result_count, back.rows_complete) == (1, 1, 0)


@pytest.mark.parametrize(
    ("state", "ends", "finished_at"),
    [("running", "complete", 5.0), ("paused", "complete", 5.0), ("cancelled", "cancelled", 2.0)],
)
def test_a_study_is_complete_with_its_last_result_unless_it_was_cancelled(
    study: Making, state: str, ends: str, finished_at: float
) -> None:
    before = row_of("done", "done", "done", "leased", row=2)
    standing = study(
        state=state,
        handed_out=12,
        leased=1,
        result_count=11,
        ok_count=11,
        rows_complete=2,
        finished_at=2.0 if state == "cancelled" else None,
    )
    after = {(2, 3): replace(before[2, 3], state=DONE)}
    done = studies.with_changes(
        standing, before=before, after=after, filed=[result(3, row=2)], now=5.0
    )
    assert (done.state, done.finished_at, done.rows_complete) == (ends, finished_at, 3)


def test_a_study_that_is_complete_is_not_finished_a_second_time(study: Making) -> None:
    complete = study(state="complete", result_count=12, ok_count=12, handed_out=12, finished_at=4.0)
    same = studies.with_changes(complete, before={}, after={}, filed=[], now=9.0)
    assert same == complete


def test_a_draining_study_pauses_when_its_begun_rows_are_done(study: Making) -> None:
    draining = study(state="draining", handed_out=4, result_count=3, leased=1)
    assert studies.drained(draining).state == "draining"
    assert studies.drained(replace(draining, result_count=4)).state == "paused"
    assert studies.drained(study(handed_out=4, result_count=4)).state == "running"
    assert studies.switched(study(), StudyState.DRAINING).state == "paused"


def test_results_that_are_taken_back_open_a_complete_study_again(study: Making) -> None:
    complete = study(state="complete", finished_at=4.0, result_count=12, ok_count=12, edition=3)
    again = studies.recounted(complete, outcomes={"ok": 8, "lost": 2}, rows_complete=2, leased=1)
    assert (again.state, again.finished_at, again.edition) == ("running", None, 4)
    assert (again.result_count, again.ok_count, again.failures) == (10, 8, {"lost": 2})
    assert (again.rows_complete, again.leased) == (2, 1)
    whole = studies.recounted(complete, outcomes={"ok": 12}, rows_complete=3, leased=0)
    assert (whole.state, whole.finished_at, whole.edition) == ("complete", 4.0, 4)
    paused = studies.recounted(
        study(state="paused"), outcomes={"diverged": 1}, rows_complete=0, leased=0
    )
    assert (paused.state, paused.ok_count) == ("paused", 0)


def test_what_is_found_after_all_is_no_longer_lost_and_makes_earlier_readings_obsolete(
    study: Making,
) -> None:
    before = study(result_count=12, ok_count=8, failures={"lost": 3, "slipped": 1}, edition=3)
    good = Result(
        row=0, position=0, outcome="ok", outputs={}, reason="", state=None, wall_seconds=None
    )
    after = studies.with_found(before, [good, replace(good, outcome="slipped")])
    assert (after.ok_count, after.failures) == (9, {"lost": 1, "slipped": 2})
    assert (after.result_count, after.edition) == (12, 4)
    assert studies.with_found(after, [good]).failures == {"slipped": 2}


@pytest.mark.parametrize("state", ["complete", "cancelled"])
def test_what_has_ended_is_not_paused(study: Making, state: str) -> None:
    with pytest.raises(ConflictError) as refused:
        studies.switched(study(state=state), StudyState.PAUSED)
    assert str(refused.value) == f"study s is {state}: it cannot become paused"


def test_cancelling_ends_a_study_once_and_never_one_that_is_complete(study: Making) -> None:
    gone = studies.cancelled(study(), now=7.0)
    assert (gone.state, gone.finished_at) == ("cancelled", 7.0)
    assert studies.cancelled(gone, now=8.0) == gone
    with pytest.raises(ConflictError, match=r"^study s is already complete$"):
        studies.cancelled(study(state="complete"), now=7.0)


def test_more_rows_let_a_complete_study_run_and_leave_others_as_they_are(study: Making) -> None:
    complete = study(state="complete", finished_at=4.0, edition=1)
    more = studies.extended(complete, 5)
    assert (more.plan.rows, more.state, more.finished_at, more.edition) == (5, "running", None, 2)
    assert more.plan == replace(complete.plan, rows=5)
    paused = studies.extended(study(state="paused"), MAX_ROWS)
    assert (paused.plan.rows, paused.state, paused.edition) == (MAX_ROWS, "paused", 1)
    assert studies.extended(complete, 3) == complete


@pytest.mark.parametrize(
    ("state", "rows", "why"),
    [
        ("cancelled", 5, "it was cancelled"),
        ("running", 2, "it has 3 rows, and a study never shrinks"),
    ],
)
def test_a_study_says_why_it_cannot_have_so_many_rows(
    study: Making, state: str, rows: int, why: str
) -> None:
    with pytest.raises(ConflictError) as refused:
        studies.extended(study(state=state), rows)
    assert str(refused.value) == f"study s cannot have {rows} rows: {why}"


def test_what_no_study_can_have_is_said_as_of_a_new_one(study: Making) -> None:
    # Whatever has become of it: another state would not help.
    for state in ("running", "cancelled"):
        with pytest.raises(InvalidStudyError, match=f"between 1 and {MAX_ROWS}, not") as refused:
            studies.extended(study(state=state), MAX_ROWS + 1)
        assert refused.value.pointer == "/rows"
