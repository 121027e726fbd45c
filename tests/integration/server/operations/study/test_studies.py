"""Pausing, extending, running again and deleting, without losing or counting anything twice."""

from collections.abc import Callable
from typing import Any

import pytest
import sqlalchemy as sa
from sqlalchemy.engine import Engine

from analysis.sensitivity.records import NoSuchStudyError
from analysis.sensitivity.service import analyse, catch_up
from server.errors import ConflictError, NotFoundError
from server.logic.fleet.verdicts import Report
from server.logic.study.points import for_analysis, instance_id
from server.operations import check
from server.operations.fleet import leases, results
from server.operations.fleet.exchange import Grant
from server.operations.study import reruns, studies
from server.operations.study.result_log import StoreResultLog
from server.records import Plan, Study
from server.states import StudyState
from server.store.database.engine import reading
from server.store.database.schema import metadata, superseded
from tests.testbed.coordinators import exchanges

Drawing = Callable[..., Plan]
TTL = 60.0


def create(engine: Engine, plan: Plan, now: float = 0.0, **more: Any) -> Study:
    return studies.create(engine, plan, key=None, digest="", now=now, **more)[0]


def lease(engine: Engine, n: int = 4, now: float = 0.0, **changes: Any) -> Grant | None:
    asked = {"models": ["ishigami"], "host": "h", "versions": {}, "worker": "w", **changes}
    return exchanges.grant(engine, max_instances=n, now=now, ttl=TTL, **asked)


def work_off(engine: Engine, *, now: float = 0.0, fail: Any = (), **who: Any) -> int:
    """Evaluate whatever there is: y is the instance's number; `fail` are places that diverge."""
    done = 0
    while grant := lease(engine, now=now, **who):
        reports = [
            Report(
                instance=instance_id(grant.study.id, row, position),
                outcome="diverged" if (row, position) in fail else "ok",
                outputs={"y": 10.0 * row + position**2},
                reason="",
                state=None,
                wall_seconds=0.1,
            )
            for row, position in grant.lease.instances
        ]
        assert set(exchanges.hand_in(engine, grant.lease, reports, now=now)) == {"accepted"}
        done += len(reports)
    return done


def in_one_go(engine: Engine, study_id: str) -> dict[str, Any]:
    log = StoreResultLog(engine)
    plan = for_analysis(studies.get(engine, study_id))
    return analyse(plan, log.results_after(study_id, 0, 10_000))


def indices(engine: Engine, study_id: str) -> dict[str, Any]:
    log = StoreResultLog(engine)
    catch_up(log, study_id)
    found = log.snapshot(study_id)
    assert found is not None
    return found


def test_a_paused_study_hands_out_nothing_until_it_is_resumed(
    engine: Engine, plan: Drawing
) -> None:
    study = create(engine, plan())
    assert studies.switch(engine, study.id, StudyState.PAUSED).state == "paused"
    assert studies.switch(engine, study.id, StudyState.PAUSED).state == "paused"
    assert lease(engine) is None
    assert studies.switch(engine, study.id, StudyState.RUNNING).state == "running"
    assert lease(engine) is not None


def test_a_draining_study_finishes_the_rows_it_has_begun_and_is_then_paused(
    engine: Engine, plan: Drawing
) -> None:
    study = create(engine, plan(rows=3))
    held = lease(engine, n=2)
    assert held is not None
    assert studies.switch(engine, study.id, StudyState.DRAINING).state == "draining"
    with pytest.raises(ConflictError, match="is draining: pause or cancel it first"):
        studies.delete(engine, study.id)
    leases.release(engine, held.lease.id, fence=held.lease.fence, now=0.0)
    assert work_off(engine) == 4
    drained = studies.get(engine, study.id)
    assert (drained.state, drained.rows_complete, drained.pending) == ("paused", 1, 8)
    # Nothing is begun: there is nothing to wait for.
    assert studies.switch(engine, study.id, StudyState.DRAINING).state == "paused"
    assert studies.switch(engine, study.id, StudyState.RUNNING).state == "running"
    assert work_off(engine) == 8
    assert studies.get(engine, study.id).state == "complete"


def test_a_study_that_drains_with_its_last_row_is_complete(engine: Engine, plan: Drawing) -> None:
    study = create(engine, plan(rows=1))
    lease(engine, n=1)
    studies.switch(engine, study.id, StudyState.DRAINING)
    leases.reap(engine, now=TTL, ttl=TTL)
    work_off(engine, now=TTL)
    assert studies.get(engine, study.id).state == "complete"


def test_a_paused_study_can_be_cancelled(engine: Engine, plan: Drawing) -> None:
    study = create(engine, plan())
    studies.switch(engine, study.id, StudyState.PAUSED)
    assert studies.cancel(engine, study.id, now=3.0).state == "cancelled"
    with pytest.raises(ConflictError, match="is cancelled: it cannot become running"):
        studies.switch(engine, study.id, StudyState.RUNNING)


def test_a_study_paused_before_its_last_result_still_completes(
    engine: Engine, plan: Drawing
) -> None:
    study = create(engine, plan(rows=1))
    grant = lease(engine)
    assert grant is not None
    studies.switch(engine, study.id, StudyState.PAUSED)
    leases.release(engine, grant.lease.id, fence=grant.lease.fence, now=0.0)
    studies.switch(engine, study.id, StudyState.RUNNING)
    work_off(engine)
    assert studies.get(engine, study.id).state == "complete"
    with pytest.raises(ConflictError, match="is complete: it cannot become paused"):
        studies.switch(engine, study.id, StudyState.PAUSED)


def test_the_higher_priority_is_served_first_and_may_change(engine: Engine, plan: Drawing) -> None:
    old, urgent = create(engine, plan(), now=1.0), create(engine, plan(), now=2.0, priority=5)
    first, second = lease(engine, 1), None
    studies.prioritise(engine, old.id, 6)
    second = lease(engine, 1)
    assert first is not None
    assert second is not None
    assert (first.study.id, second.study.id) == (urgent.id, old.id)


def test_extending_adds_rows_and_leaves_what_is_there(engine: Engine, plan: Drawing) -> None:
    study = create(engine, plan(rows=2))
    work_off(engine)
    before = list(results.in_order(engine, study))
    assert indices(engine, study.id)["rows_complete"] == 2
    longer = studies.extend(engine, study.id, 3)
    assert (longer.state, longer.plan.rows, longer.plan.instances) == ("running", 3, 12)
    assert studies.extend(engine, study.id, 3) == longer
    assert work_off(engine) == 4
    assert list(results.in_order(engine, longer))[:8] == before
    assert studies.get(engine, study.id).state == "complete"
    assert indices(engine, study.id) == in_one_go(engine, study.id)
    with pytest.raises(ConflictError, match="has 3 rows, and a study never shrinks"):
        studies.extend(engine, study.id, 2)


def test_only_the_failed_run_again_and_the_indices_forget_the_failure(
    engine: Engine, plan: Drawing
) -> None:
    study = create(engine, plan(rows=6))
    work_off(engine, fail={(0, 1), (3, 2)})
    failed = indices(engine, study.id)
    assert failed["evaluations"]["diverged"] == 2
    again, taken = reruns.rerun(engine, study.id, which="failed", outcomes=None, now=9.0)
    assert (taken, again.state, again.pending, again.failures) == (2, "running", 2, {})
    assert (again.result_count, again.rows_complete) == (22, 4)
    assert work_off(engine) == 2
    undisturbed = create(engine, plan(rows=6))
    work_off(engine)
    clean = indices(engine, undisturbed.id)
    assert indices(engine, study.id) == {**clean, "study": study.id}
    with reading(engine) as connection:
        kept = connection.execute(sa.select(superseded.c.outcome, superseded.c.why)).all()
    assert [tuple(row) for row in kept] == [("diverged", "failed")] * 2


def test_a_result_that_comes_after_its_instance_was_lost_for_good_is_counted_like_any(
    engine: Engine, plan: Drawing
) -> None:
    study = create(engine, plan(rows=3))
    grants = []
    for number in range(5):
        grants.append(lease(engine, now=number * TTL))
        leases.reap(engine, now=(number + 1) * TTL, ttl=TTL)
    work_off(engine, now=5 * TTL)
    before = indices(engine, study.id)
    late = grants[1]
    assert late is not None
    reports = [
        Report(
            instance=instance_id(study.id, row, position),
            outcome="slipped" if position == 3 else "ok",
            outputs={"y": 10.0 * row + position**2},
            reason="",
            state={"note": "late"},
            wall_seconds=0.1,
        )
        for row, position in late.lease.instances
    ]
    for verdict in ("accepted", "duplicate"):
        told = exchanges.hand_in(engine, late.lease, reports, now=400.0)
        assert [*told] == [verdict] * 4
    found = studies.get(engine, study.id)
    assert (found.state, found.ok_count, found.failures) == ("complete", 11, {"slipped": 1})
    assert check.faults(engine) == []
    after = indices(engine, study.id)
    assert after == in_one_go(engine, study.id) != before
    with reading(engine) as connection:
        kept = connection.execute(sa.select(superseded)).all()
    assert {(one.outcome, one.why) for one in kept} == {("lost", "lost")}
    again = create(engine, plan(rows=3), now=500.0)
    work_off(engine, now=500.0, fail={(0, 3)})
    other = indices(engine, again.id)
    assert after["outputs"] == other["outputs"]


def test_only_failures_of_the_named_kind_run_again(engine: Engine, plan: Drawing) -> None:
    study = create(engine, plan())
    work_off(engine, fail={(0, 0)})
    _, taken = reruns.rerun(engine, study.id, which="failed", outcomes=["slipped"], now=9.0)
    assert taken == 0
    assert studies.get(engine, study.id).state == "complete"


def test_running_all_again_binds_the_study_to_the_next_version(
    engine: Engine, plan: Drawing
) -> None:
    study = create(engine, plan())
    work_off(engine, versions={"mujoco": "4.0.1"})
    again, taken = reruns.rerun(engine, study.id, which="all", outcomes=None, now=9.0)
    assert (taken, again.identity, again.pending) == (8, None, 8)
    assert work_off(engine, versions={"mujoco": "4.0.2"}) == 8
    assert studies.get(engine, study.id).identity == {"mujoco": "4.0.2"}


def test_what_an_analysis_made_of_results_taken_back_is_refused(
    engine: Engine, plan: Drawing
) -> None:
    study = create(engine, plan())
    work_off(engine, fail={(0, 0)})
    slow = StoreResultLog(engine)
    slow.plan(study.id)
    reruns.rerun(engine, study.id, which="failed", outcomes=None, now=9.0)
    assert slow.results_after(study.id, 0, 10) == []
    stale = {"expected_cursor": 0, "cursor": 8, "state": b"", "snapshot": {"rows": 0}}
    assert not slow.commit(study.id, **stale)
    assert slow.snapshot(study.id) is None


def test_a_deleted_study_leaves_nothing_behind(engine: Engine, plan: Drawing) -> None:
    study = create(engine, plan())
    work_off(engine, fail={(0, 0)})
    indices(engine, study.id)
    reruns.rerun(engine, study.id, which="failed", outcomes=None, now=9.0)
    with pytest.raises(ConflictError, match="pause or cancel it first"):
        studies.delete(engine, study.id)
    studies.switch(engine, study.id, StudyState.PAUSED)
    studies.delete(engine, study.id)
    with pytest.raises(NotFoundError):
        studies.get(engine, study.id)
    with pytest.raises(NoSuchStudyError):
        StoreResultLog(engine).plan(study.id)
    with reading(engine) as connection:
        for table in metadata.tables.values():
            if "study_id" in table.c:
                count = sa.select(sa.func.count()).select_from(table)
                assert connection.scalar(count) == 0, table.name
