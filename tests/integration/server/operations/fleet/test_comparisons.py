"""A share of the results is computed again on another host, and nothing else changes by it."""

from collections.abc import Callable
from typing import Any

import pytest
from fastapi.testclient import TestClient
from pydantic import SecretStr
from sqlalchemy.engine import Engine

from server.app import create_app
from server.logic.fleet.comparisons import (
    GATHER_SECONDS,
    Reputation,
    agree,
    difference,
    is_chosen,
)
from server.logic.fleet.verdicts import Report
from server.logic.study.points import instance_id
from server.operations import check
from server.operations.fleet import comparisons, leases, results
from server.operations.fleet.exchange import Grant
from server.operations.study import instances, reruns, studies
from server.records import Plan, Result
from server.settings import Settings
from server.states import StudyState
from tests.testbed.coordinators import exchanges

Drawing = Callable[..., Plan]
Reporting = Callable[..., Report]
TTL = 60.0


def create(engine: Engine, plan: Plan) -> str:
    return studies.create(engine, plan, key=None, digest="", now=0.0)[0].id


def lease(engine: Engine, host: str, n: int = 4, now: float = 0.0, **more: Any) -> Grant | None:
    asked = {"models": ["ishigami"], "versions": {}, "worker": f"of-{host}", **more}
    return exchanges.grant(engine, host=host, max_instances=n, now=now, ttl=TTL, **asked)


def post(engine: Engine, grant: Grant | None, report: Reporting, **changes: Any) -> list[str]:
    assert grant is not None
    held = grant.lease
    policy = {"share": 1.0, "tolerance": 1e-3, "now": 0.0}
    for name in policy:
        policy[name] = changes.pop(name, policy[name])
    reports = [report(instance_id(held.study, *place), **changes) for place in held.instances]
    proof = {"lease_id": held.id, "fence": held.fence, "worker": held.worker}
    verdicts = exchanges.post(engine, reports, ttl=TTL, **proof, **policy)  # type: ignore[arg-type]
    return [verdict.verdict for verdict in verdicts]


def asked_of(grant: Grant | None) -> list[tuple[int, int]]:
    return list(grant.lease.instances) if grant is not None and grant.lease.compares else []


def result(outcome: str = "ok", **outputs: float) -> Result:
    return Result(
        row=0,
        position=0,
        outcome=outcome,
        outputs=outputs if outcome == "ok" else None,
        reason="",
        state=None,
        wall_seconds=None,
    )


def test_the_chosen_instances_are_the_share_and_always_the_same() -> None:
    chosen = {(r, p) for r in range(2000) for p in range(10) if is_chosen(7, r, p, 0.01)}
    # 200 expected; six standard deviations of a binomial are 84.
    assert 116 < len(chosen) < 284
    more = {(r, p) for r in range(2000) for p in range(10) if is_chosen(7, r, p, 0.02)}
    assert chosen < more
    assert not any(is_chosen(7, r, 0, 0.0) for r in range(1000))
    assert all(is_chosen(7, r, 0, 1.0) for r in range(1000))
    assert chosen != {(r, p) for r, p in more if is_chosen(8, r, p, 0.01)}


def test_the_difference_is_relative_and_that_of_the_worst_output() -> None:
    assert difference(result(a=2.0, b=1.0), result(a=2.0, b=1.1)) == pytest.approx(0.1 / 1.1)
    assert difference(result(a=-4.0), result(a=4.0)) == 2.0
    # Two large numbers cancelled: what is left has no digits to compare.
    assert difference(result(a=1e-9), result(a=-1e-9)) == pytest.approx(2e-6)
    assert difference(result(), result("slipped")) is None
    assert difference(result("slipped"), result("slipped")) == 0.0


def test_two_results_agree_up_to_the_tolerance_and_never_with_other_outcomes() -> None:
    assert agree(result(a=1.0), result(a=1.0), 0.0)
    assert agree(result(a=1.0), result(a=1.0009), 1e-3)
    assert not agree(result(a=1.0), result(a=1.0011), 1e-3)
    assert not agree(result(a=1.0), result("slipped"), 1e9)


def test_a_stranger_is_trusted_and_every_disagreement_costs() -> None:
    assert Reputation().trust == Reputation(agreed=9).trust == 1.0
    assert Reputation(disagreed=1).trust == 0.5
    assert Reputation(agreed=98, disagreed=1).trust == 0.99


def test_another_host_computes_it_again_and_nothing_is_counted_twice(
    engine: Engine, plan: Drawing, report: Reporting
) -> None:
    study = create(engine, plan(rows=1))
    assert set(post(engine, lease(engine, "a"), report)) == {"accepted"}
    assert studies.get(engine, study).state == "complete"
    assert lease(engine, "a", worker="another process of a") is None
    grant = lease(engine, "b")
    assert asked_of(grant) == [(0, position) for position in range(4)]
    assert set(post(engine, grant, report)) == {"accepted"}
    assert set(post(engine, grant, report)) == {"duplicate"}
    assert lease(engine, "c") is None
    done = studies.get(engine, study)
    assert (done.result_count, done.leased, done.rows_complete) == (4, 0, 1)
    assert comparisons.reputations(engine) == {"a": Reputation(agreed=4), "b": Reputation(agreed=4)}
    assert check.faults(engine) == []


def test_a_host_that_computes_nonsense_is_found_in_most_disagreements(
    engine: Engine, plan: Drawing, report: Reporting
) -> None:
    study = create(engine, plan(rows=3))
    truth = {"good": 1.5, "broken": 1.6, "sound": 1.5}
    rows = {host: lease(engine, host) for host in truth}
    for host, y in truth.items():
        post(engine, rows[host], report, outputs={"y": y})
    for _ in range(12):
        for host, y in truth.items():
            if grant := lease(engine, host, n=1):
                post(engine, grant, report, outputs={"y": y})
    standings = comparisons.reputations(engine)
    assert standings["broken"].trust < min(standings["good"].trust, standings["sound"].trust)
    told = instances.account(engine, study, (0, 0))[1]["comparisons"]
    assert [opinion["state"] for opinion in told] in (["agreed"], ["disagreed"])
    assert {"first_host", "second_host", "difference", "outputs"} <= set(told[0])


def test_a_disagreement_is_recorded_and_changes_no_result(
    engine: Engine, plan: Drawing, report: Reporting, caplog: pytest.LogCaptureFixture
) -> None:
    study = create(engine, plan(rows=1))
    post(engine, lease(engine, "a"), report)
    post(engine, lease(engine, "b"), report, outputs={"y": 3.0})
    assert comparisons.reputations(engine)["b"] == Reputation(disagreed=4)
    (opinion,) = instances.account(engine, study, (0, 2))[1]["comparisons"]
    assert opinion["state"] == "disagreed"
    assert (opinion["outputs"], opinion["difference"]) == ({"y": 3.0}, 0.5)
    kept = [found.outputs for found, _ in results.in_order(engine, studies.get(engine, study))]
    assert kept == [{"y": 1.5}] * 4
    assert "hosts a and b disagree" in caplog.text


def test_a_failed_simulation_is_compared_by_its_name(
    engine: Engine, plan: Drawing, report: Reporting
) -> None:
    create(engine, plan(rows=1))
    post(engine, lease(engine, "a"), report, outcome="slipped")
    post(engine, lease(engine, "b", n=2), report, outcome="slipped")
    post(engine, lease(engine, "b", n=2), report, outcome="penetrated")
    assert comparisons.reputations(engine)["b"] == Reputation(agreed=2, disagreed=2)


def test_a_second_opinion_that_does_not_come_is_asked_for_three_times(
    engine: Engine, plan: Drawing, report: Reporting
) -> None:
    create(engine, plan(rows=1))
    post(engine, lease(engine, "a"), report)
    now = 0.0
    # Silence, a crash and nonsense count; giving it back does not.
    returned = lease(engine, "b")
    assert returned is not None
    leases.release(engine, returned.lease.id, fence=returned.lease.fence, now=now)
    assert len(asked_of(lease(engine, "b", now=now))) == 4
    now += TTL
    assert leases.reap(engine, now=now, ttl=TTL) == 0
    crashed = lease(engine, "c", now=now)
    assert set(post(engine, crashed, report, outcome="crashed", now=now)) == {"accepted"}
    nonsense = lease(engine, "b", now=now)
    assert set(post(engine, nonsense, report, outputs={}, now=now)) == {"invalid"}
    assert lease(engine, "b", now=now) is None
    assert comparisons.reputations(engine) == {}
    assert check.faults(engine) == []


def test_a_second_opinion_that_comes_too_late_is_told_from_lost_work(
    engine: Engine, plan: Drawing, report: Reporting
) -> None:
    create(engine, plan(rows=1))
    post(engine, lease(engine, "a"), report)
    late = lease(engine, "b")
    assert late is not None and len(asked_of(late)) == 4
    leases.reap(engine, now=TTL, ttl=TTL)
    assert set(post(engine, lease(engine, "c", now=TTL), report, now=TTL)) == {"accepted"}
    name = instance_id(late.lease.study, *late.lease.instances[0])
    told = exchanges.post(
        engine,
        [report(name), report(name), report("another:0:0")],
        lease_id=late.lease.id,
        fence=late.lease.fence,
        worker=late.lease.worker,
        now=TTL,
        ttl=TTL,
        share=1.0,
        tolerance=1e-3,
    )
    too_late = ("duplicate", "a second opinion that is no longer asked for")
    assert [(one.verdict, one.detail) for one in told] == [
        too_late,
        too_late,
        ("unknown", "the lease does not hold this instance"),
    ]
    assert comparisons.reputations(engine)["c"].agreed == 4
    assert check.faults(engine) == []


def test_what_a_paused_study_or_another_version_has_waits(
    engine: Engine, plan: Drawing, report: Reporting
) -> None:
    study = create(engine, plan(rows=2))
    post(engine, lease(engine, "a"), report)
    studies.switch(engine, study, StudyState.PAUSED)
    assert lease(engine, "b") is None
    studies.switch(engine, study, StudyState.RUNNING)
    assert lease(engine, "b", models=["elbow"]) is None
    other = {"mujoco": "3.0"}
    with pytest.raises(Exception, match="was begun with"):
        lease(engine, "b", versions=other)
    assert len(asked_of(lease(engine, "b", now=GATHER_SECONDS))) == 4


def test_second_opinions_gather_for_some_seconds_while_there_is_other_work(
    engine: Engine, plan: Drawing, report: Reporting
) -> None:
    create(engine, plan(rows=4))
    post(engine, lease(engine, "a"), report)
    early = lease(engine, "b", now=GATHER_SECONDS - 0.01)
    assert early is not None and not early.lease.compares
    post(engine, lease(engine, "a", now=4.0), report, now=4.0)
    # As soon as one of them has waited long enough, all go that fit.
    assert len(asked_of(lease(engine, "b", n=6, now=GATHER_SECONDS))) == 6
    last = lease(engine, "b", now=GATHER_SECONDS)
    assert last is not None and not last.lease.compares
    # Nothing else is left.
    assert len(asked_of(lease(engine, "b", now=GATHER_SECONDS))) == 2


def test_results_taken_back_are_compared_when_they_are_there_again(
    engine: Engine, plan: Drawing, report: Reporting
) -> None:
    study = create(engine, plan(rows=1))
    post(engine, lease(engine, "a"), report, outcome="diverged")
    held = lease(engine, "b", n=2)
    assert len(asked_of(held)) == 2
    reruns.rerun(engine, study, which="failed", outcomes=None, now=0.0)
    assert set(post(engine, held, report)) == {"duplicate"}
    assert set(post(engine, lease(engine, "a"), report)) == {"accepted"}
    assert len(asked_of(lease(engine, "b"))) == 4
    assert check.faults(engine) == []


def test_a_study_can_be_deleted_with_its_comparisons(
    engine: Engine, plan: Drawing, report: Reporting
) -> None:
    study = create(engine, plan(rows=1))
    post(engine, lease(engine, "a"), report)
    held = lease(engine, "b", n=2)
    studies.delete(engine, study)
    assert set(post(engine, held, report)) == {"unknown"}
    assert lease(engine, "b") is None


def test_nobody_is_asked_for_ever_about_a_study_that_has_ended(
    engine: Engine, plan: Drawing, report: Reporting
) -> None:
    create(engine, plan(rows=1))
    post(engine, lease(engine, "a"), report)
    comparisons.give_up(engine, now=3000.0, patience=3600.0)
    assert len(asked_of(lease(engine, "b", n=1))) == 1
    comparisons.give_up(engine, now=4000.0, patience=3600.0)
    assert lease(engine, "b") is None


def test_over_rest_a_worker_is_shown_with_its_hosts_trust(upgraded: str) -> None:
    settings = Settings(database_url=upgraded, token=SecretStr("t"), recompute_share=1.0)
    study = {"name": "s", "model": "ishigami", "method": "morris", "rows": 1}
    headers = {"Authorization": "Bearer t"}
    with TestClient(create_app(settings), headers=headers) as client:
        study_id = client.post("/v1/studies", json=study).json()["id"]
        for host, y in (("sound", 1.0), ("broken", 2.0)):
            worker = {"id": f"of-{host}", "host": host}
            asking = {"worker": worker, "models": ["ishigami"], "max_instances": 4}
            lease = client.post("/v1/leases", json=asking).json()
            found = [
                {"instance": instance["id"], "outcome": "ok", "outputs": {"y": y}}
                for instance in lease["instances"]
            ]
            body = {"lease": lease["id"], "fence": lease["fence"], "worker": f"of-{host}"}
            posted = client.post("/v1/results", json={**body, "results": found})
            assert posted.status_code == 200
        for worker in client.get("/v1/workers").json()["workers"]:
            assert (worker["agreed"], worker["disagreed"], worker["trust"]) == (0, 4, 0.2)
        told = client.get(f"/v1/studies/{study_id}/instances/0/0").json()
        assert told["result"]["outputs"] == {"y": 1.0}
        (opinion,) = told["comparisons"]
        assert (opinion["state"], opinion["second_host"]) == ("disagreed", "broken")
        assert (opinion["outputs"], opinion["difference"]) == ({"y": 2.0}, 0.5)
        metrics = client.get("/metrics").text
        assert 'rehyb_comparisons{state="disagreed"} 4.0' in metrics
        assert "rehyb_lease_seconds_count 2.0" in metrics
