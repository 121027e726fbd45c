"""Leasing from the database: handing out, taking back, counting."""

from contextlib import suppress
from math import inf
from typing import Any

import pytest
import sqlalchemy as sa
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy.engine import Engine

from server.errors import ConflictError, NotFoundError
from server.logic.fleet.unserved import Patience
from server.logic.study.plans import MAX_ROWS
from server.logic.study.points import instance_id, parameters
from server.operations.fleet import leases, results
from server.operations.fleet.exchange import Grant
from server.operations.study import studies
from server.records import Study
from server.store.database.engine import reading, writing
from server.store.database.schema import instances as instances_table
from server.store.database.schema import results as results_table
from server.store.database.schema import studies as study_table
from server.store.fleet import workers
from tests.testbed.coordinators.leasing import (
    TTL,
    Drawing,
    Reporting,
    create,
    ids,
    lease,
    leased,
    post,
)


def recount(engine: Engine, study_id: str) -> dict[str, Any]:
    """Count a study's instances and results one by one."""
    with reading(engine) as connection:
        slots = connection.execute(
            sa.select(instances_table).where(instances_table.c.study_id == study_id)
        ).all()
        log = connection.execute(
            sa.select(results_table).where(results_table.c.study_id == study_id)
        ).all()
    done = [slot for slot in slots if slot.state == "done"]
    width = studies.get(engine, study_id).plan.width
    assert sorted(result.seq for result in log) == list(range(1, len(log) + 1))
    assert {(r.row, r.position) for r in log} == {(s.row, s.position) for s in done}
    return {
        "handed_out": len(slots),
        "leased": sum(slot.state == "leased" for slot in slots),
        "result_count": len(log),
        "ok_count": sum(result.outcome == "ok" for result in log),
        "rows_complete": sum(
            [slot.row for slot in done].count(row) == width for row in {s.row for s in done}
        ),
    }


def counted(study: Study) -> dict[str, Any]:
    return {name: getattr(study, name) for name in COUNTERS}


COUNTERS = ["handed_out", "leased", "result_count", "ok_count", "rows_complete"]


def test_leases_sort_by_age_and_no_two_are_the_same(engine: Engine, plan: Drawing) -> None:
    create(engine, plan(rows=100))
    ids = [leased(engine, n=1, now=now).lease.id for now in (0.0, 0.0, 1e-6, 3.0, 1.8e9, 1.8e9)]
    assert [one[:16] for one in ids] == sorted(one[:16] for one in ids)
    assert len({one[:16] for one in ids}) == 4
    assert len(set(ids)) == 6 and {len(one) for one in ids} == {32}


def test_of_a_model_that_a_worker_wants_fewer_of_it_gets_no_more(
    engine: Engine, plan: Drawing
) -> None:
    create(engine, plan())
    fewer = {"ishigami": 2, "elbow": 1}
    first = leased(engine, n=1000, at_most=fewer)
    assert first.lease.instances == ((0, 0), (0, 1))
    leases.release(engine, first.lease.id, fence=first.lease.fence, now=0.0)
    # Also of those that come back; and no more than of any model.
    assert len(leased(engine, n=1000, at_most=fewer).lease.instances) == 2
    assert len(leased(engine, n=1, at_most=fewer).lease.instances) == 1
    assert len(leased(engine, n=3, at_most={"elbow": 1}).lease.instances) == 3


def test_instances_are_handed_out_row_by_row_and_never_twice(engine: Engine, plan: Drawing) -> None:
    create(engine, plan())
    places = [place for _ in range(3) for place in leased(engine).lease.instances]
    assert places == [(row, position) for row in (0, 1) for position in range(4)]
    assert lease(engine) is None


def test_the_oldest_study_is_served_first(engine: Engine, plan: Drawing) -> None:
    young, old = create(engine, plan(), now=20.0), create(engine, plan(rows=1), now=10.0)
    served = [leased(engine, n=4).study.id for _ in range(3)]
    assert served == [old.id, young.id, young.id]


def test_a_worker_gets_only_models_it_can_evaluate(engine: Engine, plan: Drawing) -> None:
    create(engine, plan(model="elbow"))
    assert lease(engine) is None
    assert lease(engine, models=["ishigami", "elbow"]) is not None


def test_every_lease_has_a_higher_fence(engine: Engine, plan: Drawing) -> None:
    create(engine, plan())
    fences = [leased(engine).lease.fence for _ in range(3)]
    assert fences == sorted(set(fences))


def test_a_cancelled_study_hands_out_nothing_but_takes_what_is_under_way(
    engine: Engine, plan: Drawing, report: Reporting
) -> None:
    study = create(engine, plan())
    grant = leased(engine)
    assert studies.cancel(engine, study.id, now=5.0).state == "cancelled"
    assert studies.cancel(engine, study.id, now=6.0).finished_at == 5.0
    assert lease(engine) is None
    assert [v.verdict for v in post(engine, grant, [report(i) for i in ids(grant)])] == [
        "accepted"
    ] * 3


def test_a_complete_study_cannot_be_cancelled(
    engine: Engine, plan: Drawing, report: Reporting
) -> None:
    study = create(engine, plan(rows=1))
    grant = leased(engine, n=4)
    post(engine, grant, [report(i) for i in ids(grant)], now=7.0)
    complete = studies.get(engine, study.id)
    assert (complete.state, complete.finished_at, complete.rows_complete) == ("complete", 7.0, 1)
    with pytest.raises(ConflictError, match="already complete"):
        studies.cancel(engine, study.id, now=8.0)


def test_what_expired_leases_held_is_handed_out_again_before_new_rows(
    engine: Engine, plan: Drawing
) -> None:
    create(engine, plan())
    first = leased(engine, n=2)
    assert leases.reap(engine, now=TTL - 0.1, ttl=TTL) == 0
    assert leases.reap(engine, now=TTL, ttl=TTL) == 2
    assert leases.reap(engine, now=TTL, ttl=TTL) == 0
    again = leased(engine, n=3, now=TTL, worker="v")
    assert again.lease.instances == (*first.lease.instances, (0, 2))


def test_renewing_keeps_a_lease_and_an_expired_one_is_not_renewed(
    engine: Engine, plan: Drawing
) -> None:
    create(engine, plan())
    held = leased(engine).lease
    assert leases.renew(engine, held.id, fence=held.fence, now=50.0, ttl=TTL) == 110.0
    assert leases.reap(engine, now=100.0, ttl=TTL) == 0
    with pytest.raises(ConflictError, match=r"the lease expired 10\.0 s ago"):
        leases.renew(engine, held.id, fence=held.fence, now=120.0, ttl=TTL)
    with pytest.raises(ConflictError, match="fence"):
        leases.renew(engine, held.id, fence=held.fence + 1, now=100.0, ttl=TTL)
    with pytest.raises(ConflictError, match="no such lease"):
        leases.renew(engine, "nothing", fence=1, now=100.0, ttl=TTL)


def test_posting_keeps_a_lease_too(engine: Engine, plan: Drawing, report: Reporting) -> None:
    create(engine, plan())
    grant = leased(engine)
    post(engine, grant, [report(ids(grant)[0])], now=50.0)
    assert leases.reap(engine, now=100.0, ttl=TTL) == 0
    assert leases.reap(engine, now=110.0, ttl=TTL) == 2


def test_a_late_post_is_taken_but_revives_no_lease(
    engine: Engine, plan: Drawing, report: Reporting
) -> None:
    create(engine, plan())
    grant = leased(engine)
    assert post(engine, grant, [report(ids(grant)[0])], now=TTL)[0].verdict == "accepted"
    assert leases.reap(engine, now=TTL, ttl=TTL) == 2


def test_a_lease_is_over_with_the_last_of_its_results(
    engine: Engine, plan: Drawing, report: Reporting
) -> None:
    study = create(engine, plan())
    grant = leased(engine)
    first, *others = [report(name) for name in ids(grant)]
    post(engine, grant, [first])
    patience = Patience(seconds=3600.0, since=0.0)
    assert studies.standing(engine, study.id, now=1.0, patience=patience).workers == 1
    post(engine, grant, others)
    assert studies.standing(engine, study.id, now=1.0, patience=patience).workers == 0
    with pytest.raises(ConflictError, match="the lease is finished"):
        leases.renew(engine, grant.lease.id, fence=grant.lease.fence, now=1.0, ttl=TTL)
    assert [v.verdict for v in post(engine, grant, [first])] == ["duplicate"]


def test_a_released_instance_comes_back_at_once_and_unharmed(engine: Engine, plan: Drawing) -> None:
    create(engine, plan())
    for _ in range(20):
        held = leased(engine).lease
        assert held.instances[0] == (0, 0)
        leases.release(engine, held.id, fence=held.fence, now=1.0)
        leases.release(engine, held.id, fence=held.fence, now=1.0)
    with pytest.raises(ConflictError, match="cannot be released: the fence"):
        leases.release(engine, held.id, fence=0, now=1.0)


def test_workers_are_remembered_with_what_they_did(
    engine: Engine, plan: Drawing, report: Reporting
) -> None:
    create(engine, plan())
    grant = leased(engine, now=5.0, worker="a", versions={"mujoco": "4.0.1"})
    post(engine, grant, [report(i) for i in ids(grant)[:2]], now=9.0)
    assert lease(engine, models=["none"], now=7.0, worker="b") is None
    with reading(engine) as connection:
        first, second = workers.every(connection)
    assert (first.id, first.last_seen, first.instances_done) == ("a", 9.0, 2)
    assert first.versions == {"mujoco": "4.0.1"}
    assert (second.id, second.last_seen, second.instances_done) == ("b", 7.0, 0)


def test_a_study_that_is_not_there_is_not_found(engine: Engine) -> None:
    with pytest.raises(NotFoundError, match="there is no study 'nothing'"):
        studies.get(engine, "nothing")


ACTIONS = st.lists(
    st.tuples(
        st.sampled_from(["lease", "post", "post", "post", "release", "renew", "wait"]),
        st.integers(0, 5),
        st.sampled_from(["ok", "ok", "other", "diverged", "crashed", "timed_out", "nonsense"]),
    ),
    max_size=40,
)


@settings(
    max_examples=40,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(actions=ACTIONS)
def test_whatever_workers_do_nothing_is_lost_or_counted_twice(
    engine: Engine, plan: Drawing, report: Reporting, actions: list[tuple[str, int, str]]
) -> None:
    study = create(engine, plan(rows=2))
    grants: list[Grant] = []
    filled: dict[tuple[int, int], str] = {}
    now = 0.0
    for action, number, outcome in actions:
        if action == "lease":
            leases.reap(engine, now=now, ttl=TTL)
            if grant := lease(engine, n=number + 1, now=now):
                grants.append(grant)
        elif action == "wait":
            now += 25.0 * number
        elif grants:
            grant = grants[number % len(grants)]
            held = grant.lease
            if action == "release":
                leases.release(engine, held.id, fence=held.fence, now=now)
            elif action == "renew":
                with suppress(ConflictError):
                    leases.renew(engine, held.id, fence=held.fence, now=now, ttl=TTL)
            else:
                said = {
                    "ok": {},
                    "other": {"outputs": {"y": 2.5}},
                    "nonsense": {"outputs": {"y": inf}},
                }.get(outcome, {"outcome": outcome, "outputs": {}})
                post(engine, grant, [report(i, **said) for i in ids(grant)], now=now)
        standing = studies.get(engine, study.id)
        assert counted(standing) == recount(engine, study.id)
        stored = {(r.row, r.position): r.outcome for r, _ in results.in_order(engine, standing)}
        assert filled.items() <= stored.items(), "a final result was changed"
        # One that was given up as lost may still come.
        filled = {place: outcome for place, outcome in stored.items() if outcome != "lost"}
    # Whatever happened, one diligent worker brings the study to its end.
    for _ in range(3):
        now += TTL
        leases.reap(engine, now=now, ttl=TTL)
        while grant := lease(engine, n=8, now=now):
            post(engine, grant, [report(i) for i in ids(grant)], now=now)
    done = studies.get(engine, study.id)
    assert done.state == "complete"
    assert (done.result_count, done.rows_complete, done.leased) == (8, 2, 0)
    assert done.ok_count + sum(done.failures.values()) == 8


def test_the_last_row_of_the_largest_study_is_leased_and_done(
    engine: Engine, plan: Drawing, report: Reporting
) -> None:
    """More than 10**8 instances; all but the last row are taken as handed out."""
    study = create(engine, plan(rows=MAX_ROWS, sampling="owen_blocks"))
    width = study.plan.instances // MAX_ROWS
    assert study.plan.instances > 10**8
    with writing(engine) as connection:
        connection.execute(
            sa.update(study_table).values(
                handed_out=study.plan.instances - width, result_count=study.plan.instances - width
            )
        )
    grant = leased(engine, n=100)
    assert [*grant.lease.instances] == [(MAX_ROWS - 1, position) for position in range(width)]
    reports = [report(instance_id(study.id, *place)) for place in grant.lease.instances]
    post(engine, grant, reports)
    assert studies.get(engine, study.id).state == "complete"
    point = parameters(study.plan, MAX_ROWS - 1)
    assert len(point) == width
