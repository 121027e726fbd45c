"""What goes wrong on one host after the other is at fault itself, and can be replayed."""

from collections.abc import Callable
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy.engine import Engine

from server.logic.fleet.hosts import GONE_SECONDS
from server.logic.fleet.verdicts import Report
from server.logic.study.instances import BUDGETS, PATIENCE, after_attempt, may_try
from server.logic.study.points import instance_id
from server.operations import check
from server.operations.fleet import leases
from server.operations.fleet.exchange import Grant
from server.operations.study import instances, studies
from server.records import Instance, Plan
from tests.testbed.coordinators import exchanges
from tests.testbed.coordinators.rest_bodies import STUDY, Json, asking, posting, result

TTL = 60.0
HELD = Instance(row=3, position=1, state="leased", lease="L", attempts={})
NAMES = ["a", "b", 'the "third" PC', "café_%", "lab/5"]


def crash(slot: Instance, host: str, at_work: set[str]) -> tuple[Instance, bool]:
    """Return the slot after a crash on `host`, and whether it is in quarantine."""
    after, final = after_attempt(slot, cause="crashed", reason="", host=host, at_work=at_work)
    return after, final is not None


def test_three_hosts_are_enough() -> None:
    slot = HELD
    for host, last in (("a", False), ("b", False), ("c", True)):
        slot, final = crash(slot, host, {"a", "b", "c", "d"})
        assert final is last
    assert slot.hosts == {"crashed": ("a", "b", "c")}


def test_where_another_host_is_at_work_three_attempts_are_not_enough() -> None:
    slot = HELD
    for host, last in (("a", False), ("a", False), ("b", False), ("c", True)):
        slot, final = crash(slot, host, {"a", "b", "c"})
        assert final is last


def test_in_a_lab_of_two_three_attempts_are_enough() -> None:
    slot = HELD
    for host, last in (("a", False), ("b", False), ("a", True)):
        slot, final = crash(slot, host, {"a", "b"})
        assert final is last


@pytest.mark.parametrize("cause", list(BUDGETS))
def test_nothing_is_tried_for_ever(cause: str) -> None:
    slot, most = HELD, PATIENCE * BUDGETS[cause]
    for count in range(1, most + 1):
        slot, final = after_attempt(
            slot, cause=cause, reason="", host="a", at_work={"a", "busy with something else"}
        )
        assert (final is not None) == (count == most)


def test_of_another_cause_a_host_counts_anew() -> None:
    slot, _ = crash(HELD, "a", {"a", "b"})
    slot, final = after_attempt(slot, cause="timed_out", reason="", host="a")
    assert final is None
    assert slot.hosts == {"crashed": ("a",), "timed_out": ("a",)}
    assert slot.tried == {"a"}


@pytest.mark.parametrize(
    ("host", "at_work", "may"),
    [
        ("c", {"a", "b", "c"}, True),
        # One that has not tried it is at work.
        ("a", {"a", "b", "c"}, False),
        ("b", {"a", "b", "c"}, False),
        # Both have: not the last one again.
        ("a", {"a", "b"}, True),
        ("b", {"a", "b"}, False),
        ("b", {"b"}, True),
        ("b", set(), True),
    ],
)
def test_who_has_not_tried_it_comes_first_and_who_failed_last_comes_last(
    host: str, at_work: set[str], may: bool
) -> None:
    slot, _ = crash(HELD, "a", set())
    slot, _ = crash(slot, "b", set())
    assert may_try(slot, host, at_work) is may


def lease(engine: Engine, host: str, n: int = 1, now: float = 0.0) -> Grant:
    grant = exchanges.grant(
        engine,
        worker=f"of {host}",
        host=host,
        versions={},
        models=["ishigami"],
        max_instances=n,
        now=now,
        ttl=TTL,
    )
    assert grant is not None
    return grant


def post(engine: Engine, grant: Grant, report: Callable[..., Report], **said: Any) -> None:
    reports = [report(instance_id(grant.study.id, *p), **said) for p in grant.lease.instances]
    exchanges.hand_in(engine, grant.lease, reports)


def test_what_crashes_goes_from_host_to_host_and_the_others_go_on(
    engine: Engine, plan: Callable[..., Plan], report: Callable[..., Report]
) -> None:
    study = studies.create(engine, plan(rows=9), key=None, digest="", now=0.0)[0].id
    # All of them are at work until the end.
    for host in NAMES:
        lease(engine, host)
    tried = []
    for _ in range(3):
        for host in NAMES:
            grant = lease(engine, host)
            if grant.lease.instances != ((1, 1),):
                continue
            tried.append(host)
            post(engine, grant, report, outcome="crashed", outputs={})
            break
    assert tried == NAMES[:3]
    _, found = instances.account(engine, study, (1, 1))
    assert found["result"]["outcome"] == "crashed"
    assert found["hosts"] == {"crashed": tuple(NAMES[:3])}
    assert check.faults(engine) == []


def crashed_between_leases_of_another(
    engine: Engine, plan: Callable[..., Plan], report: Callable[..., Report]
) -> Grant:
    """Have an instance crash while another host, which had a lease before, holds none."""
    studies.create(engine, plan(rows=9), key=None, digest="", now=0.0)
    post(engine, lease(engine, "good"), report)
    grant = lease(engine, "bad")
    post(engine, grant, report, outcome="crashed", outputs={})
    return grant


def test_a_broken_host_spoils_nothing_alone_while_another_is_between_two_leases(
    engine: Engine, plan: Callable[..., Plan], report: Callable[..., Report]
) -> None:
    crashed = crashed_between_leases_of_another(engine, plan, report)
    for _ in range(5):
        other = lease(engine, "bad")
        assert other.lease.instances != crashed.lease.instances
        post(engine, other, report)
    assert lease(engine, "good").lease.instances == crashed.lease.instances


def test_nobody_waits_for_a_host_that_gives_back_whatever_it_gets(
    engine: Engine, plan: Callable[..., Plan], report: Callable[..., Report]
) -> None:
    studies.create(engine, plan(rows=9), key=None, digest="", now=0.0)
    grant = lease(engine, "bad")
    idle = lease(engine, "idle").lease
    leases.release(engine, idle.id, fence=idle.fence, now=0.0)
    post(engine, grant, report, outcome="crashed", outputs={})
    assert lease(engine, "bad").lease.instances == grant.lease.instances


def test_nobody_waits_for_a_host_that_is_gone(
    engine: Engine, plan: Callable[..., Plan], report: Callable[..., Report]
) -> None:
    crashed = crashed_between_leases_of_another(engine, plan, report)
    again = lease(engine, "bad", now=GONE_SECONDS)
    assert again.lease.instances == crashed.lease.instances


def test_nobody_waits_for_a_host_that_is_at_work_on_another_study(
    engine: Engine, plan: Callable[..., Plan], report: Callable[..., Report]
) -> None:
    crashed = crashed_between_leases_of_another(engine, plan, report)
    first, _ = studies.create(engine, plan(rows=1), key="2", digest="", now=1.0)
    studies.prioritise(engine, first.id, 5)
    assert lease(engine, "good", n=8).study.id == first.id
    assert lease(engine, "bad").lease.instances == crashed.lease.instances


def test_names_of_hosts_are_compared_as_they_are(
    engine: Engine, plan: Callable[..., Plan], report: Callable[..., Report]
) -> None:
    studies.create(engine, plan(rows=9), key=None, digest="", now=0.0)
    for host in NAMES:
        lease(engine, host)
    for number, host in enumerate(NAMES):
        grant = lease(engine, host)
        post(engine, grant, report, outcome="crashed", outputs={})
        assert lease(engine, host).lease.instances != grant.lease.instances, number


@pytest.fixture
def quarantined(client: TestClient) -> Json:
    """A study with one instance that crashed three times, and one that slipped."""
    study = dict(client.post("/v1/studies", json={**STUDY, "seed": 77}).json())
    for host in ("pc1", "pc2", "pc3"):
        worker = {"id": host, "host": host, "versions": {"mujoco": "4.0.1", "code": "c0de"}}
        lease = client.post("/v1/leases", json=asking(worker=worker, max_instances=1)).json()
        said = {"outcome": "crashed", "outputs": {}, "reason": "KeyError: 'elbow'"}
        said["state"] = {"traceback": "Traceback (most recent call last): ..."}
        crashed = result(lease["instances"][0], **said)
        client.post("/v1/results", json=posting(lease, [crashed], worker=host))
    lease = client.post("/v1/leases", json=asking(worker=worker, max_instances=1)).json()
    slipped = result(lease["instances"][0], outcome="slipped", outputs={})
    client.post("/v1/results", json=posting(lease, [slipped], worker="pc3"))
    return study


def test_what_is_in_quarantine_is_listed_with_all_that_it_takes_to_replay_it(
    client: TestClient, quarantined: Json
) -> None:
    url = f"/v1/studies/{quarantined['id']}/instances"
    (line,) = client.get(url, params={"state": "quarantined"}).json()["instances"]
    assert (line["row"], line["position"], line["outcome"]) == (0, 0, "crashed")
    assert line["attempts"] == {"crashed": 3}
    assert line["hosts"] == {"crashed": ["pc1", "pc2", "pc3"]}
    page = client.get(url, params={"state": "quarantined", "replay": True}).json()
    (bundle,) = page["instances"]
    assert bundle == client.get(f"{url}/0/0").json()
    assert bundle["seed"] == 77
    assert set(bundle["parameters"]) == {"x1", "x2", "x3"}
    assert bundle["hosts"] == line["hosts"]
    assert bundle["result"]["reason"] == "KeyError: 'elbow'"
    assert bundle["result"]["state"]["traceback"].startswith("Traceback")
    assert bundle["result"]["versions"] == {"mujoco": "4.0.1", "code": "c0de"}


def test_a_failed_simulation_is_not_in_quarantine(client: TestClient, quarantined: Json) -> None:
    url = f"/v1/studies/{quarantined['id']}/instances"
    failed = client.get(url, params={"state": "failed"}).json()["instances"]
    assert [line["outcome"] for line in failed] == ["crashed", "slipped"]
