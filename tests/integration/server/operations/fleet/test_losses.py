"""Instances whose worker fell silent, or never heard of them, and a coordinator that was away."""

from sqlalchemy.engine import Engine

from server.operations.fleet import leases, results
from server.operations.study import instances, reruns, studies
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


def test_an_instance_lost_five_times_is_final(engine: Engine, plan: Drawing) -> None:
    study = create(engine, plan(rows=1))
    now = 0.0
    for _ in range(5):
        assert studies.get(engine, study.id).state == "running"
        leased(engine, n=4, now=now)
        now += TTL
        assert leases.reap(engine, now=now, ttl=TTL) == 4
    lost = studies.get(engine, study.id)
    assert (lost.state, lost.failures, lost.rows_complete) == ("complete", {"lost": 4}, 1)
    assert lease(engine, now=now) is None
    (result, worker), *_ = results.in_order(engine, lost)
    assert worker == "w"
    assert "which fell silent" in result.reason


def test_a_result_of_an_instance_that_was_lost_and_runs_again_is_taken_however_late(
    engine: Engine, plan: Drawing, report: Reporting
) -> None:
    study = create(engine, plan(rows=1))
    grants = []
    for number in range(5):
        grants.append(leased(engine, n=4, now=number * TTL))
        leases.reap(engine, now=(number + 1) * TTL, ttl=TTL)
    now = 6 * TTL
    reruns.rerun(engine, study.id, which="failed", outcomes=None, now=now)
    first = grants[0]
    assert {v.verdict for v in post(engine, first, [report(i) for i in ids(first)], now)} == {
        "accepted"
    }
    assert studies.get(engine, study.id).ok_count == 4


def test_a_lease_of_which_its_worker_never_heard_is_noted_and_goes_to_another_host_first(
    engine: Engine, plan: Drawing
) -> None:
    study = create(engine, plan(rows=2))
    leased(engine, n=4)
    leased(engine, n=1, worker="v", host="other")
    # It speaks on, but of something else.
    lease(engine, n=1, now=TTL / 2.0, models=["none"])
    other = leased(engine, n=1, now=TTL / 2.0, worker="v", host="other")
    assert leases.reap(engine, now=TTL, ttl=TTL) == 5
    assert other.lease.instances == ((1, 1),)
    first = [(0, position) for position in range(4)]
    noted = [instances.account(engine, study.id, place)[1] for place in first]
    assert [(one["attempts"], one["hosts"]) for one in noted] == [
        ({"unheard": 1}, {"unheard": ("h",)})
    ] * 4
    assert leased(engine, n=1, now=TTL).lease.instances == ((1, 0),)
    again = leased(engine, n=4, now=TTL, worker="v", host="other")
    assert again.lease.instances == (*first,)


def test_a_worker_that_falls_silent_soon_after_its_last_word_about_a_lease_has_lost_it(
    engine: Engine, plan: Drawing
) -> None:
    study = create(engine, plan(rows=1))
    for number in range(5):
        leased(engine, n=4, now=number * TTL)
        lease(engine, now=number * TTL + TTL / 3.0)
        assert leases.reap(engine, now=(number + 1) * TTL, ttl=TTL) == 4
    assert studies.get(engine, study.id).failures == {"lost": 4}


def test_a_coordinator_that_was_away_excuses_silence(engine: Engine, plan: Drawing) -> None:
    create(engine, plan())
    held = leased(engine).lease
    leases.extend_open_leases(engine, now=500.0, ttl=TTL)
    assert leases.reap(engine, now=559.0, ttl=TTL) == 0
    assert leases.renew(engine, held.id, fence=held.fence, now=559.0, ttl=TTL) == 619.0


def test_a_clock_that_was_set_back_lengthens_no_lease(engine: Engine, plan: Drawing) -> None:
    create(engine, plan())
    leased(engine, now=3600.0)
    leases.extend_open_leases(engine, now=0.0, ttl=TTL)
    assert leases.reap(engine, now=TTL - 1.0, ttl=TTL) == 0
    assert leases.reap(engine, now=TTL, ttl=TTL) == 3
