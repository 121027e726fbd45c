"""A study belongs to the code that began it, and a row to one class of machines."""

from collections.abc import Callable
from typing import Any

import pytest
from sqlalchemy.engine import Engine

from server.errors import ConflictError
from server.logic.fleet.hosts import host_class, identity
from server.logic.fleet.verdicts import Report
from server.logic.study.points import instance_id
from server.operations import check
from server.operations.fleet import leases
from server.operations.fleet.exchange import Grant
from server.operations.study import reruns, studies
from server.records import Plan
from tests.testbed.coordinators import exchanges

Drawing = Callable[..., Plan]
Reporting = Callable[..., Report]
TTL = 60.0
LINUX = {"code": "c0de", "mujoco": "4.0.1", "numpy": "2.4", "platform": "Linux-x86_64"}
MAC = {**LINUX, "platform": "Darwin-arm64"}
OLD = {**LINUX, "mujoco": "3.9.0"}


def create(engine: Engine, plan: Plan, **more: Any) -> str:
    return studies.create(engine, plan, key=None, digest="", now=0.0, **more)[0].id


def lease(
    engine: Engine, versions: dict[str, str], n: int = 3, now: float = 0.0, **changes: Any
) -> Grant | None:
    asked = {"models": ["ishigami"], "host": "h", "worker": versions["platform"], **changes}
    return exchanges.grant(engine, versions=versions, max_instances=n, now=now, ttl=TTL, **asked)


def places(grant: Grant | None) -> list[tuple[int, int]]:
    return [] if grant is None else list(grant.lease.instances)


def post(engine: Engine, grant: Grant, reports: list[Report], now: float = 0.0) -> list[str]:
    return exchanges.hand_in(engine, grant.lease, reports, now=now)


def reports(grant: Grant, report: Reporting, **changes: Any) -> list[Report]:
    return [report(instance_id(grant.study.id, *place), **changes) for place in places(grant)]


@pytest.mark.parametrize("name", ["code", "mujoco", "numpy", "platform", "cpu", "canary"])
def test_machines_that_differ_in_what_decides_the_bits_are_of_different_classes(name: str) -> None:
    assert host_class(LINUX) == host_class({**LINUX, "python": "3.13"})
    assert host_class(LINUX) != host_class({**LINUX, name: "other"})


def test_a_study_is_bound_to_code_and_mujoco_only() -> None:
    assert identity(LINUX) == identity(MAC) == {"code": "c0de", "mujoco": "4.0.1"}


def test_a_row_stays_with_the_kind_of_machine_that_began_it(engine: Engine, plan: Drawing) -> None:
    create(engine, plan(rows=3))
    assert places(lease(engine, LINUX, 2)) == [(0, 0), (0, 1)]
    assert places(lease(engine, MAC, 2)) == [(1, 0), (1, 1)]
    assert places(lease(engine, LINUX, 8)) == [
        (0, 2),
        (0, 3),
        *((2, position) for position in range(4)),
    ]
    assert places(lease(engine, LINUX, 8)) == []
    assert places(lease(engine, MAC, 8)) == [(1, 2), (1, 3)]


def test_a_worker_with_another_mujoco_is_told_so_and_not_fed(engine: Engine, plan: Drawing) -> None:
    study = create(engine, plan())
    lease(engine, LINUX)
    with pytest.raises(ConflictError) as refusal:
        lease(engine, OLD)
    assert str(refusal.value) == (
        f"study {study} was begun with code c0de, mujoco 4.0.1, but this worker has code c0de, "
        "mujoco 3.9.0: install the same rehyb and MuJoCo here, or begin the study anew with "
        f"`rehyb study rerun {study} --which all`"
    )


def test_a_misfit_is_fed_from_another_study_and_hears_nothing_when_nothing_is_left(
    engine: Engine, plan: Drawing
) -> None:
    create(engine, plan(rows=1))
    lease(engine, LINUX, 4)
    assert lease(engine, OLD) is None
    second = create(engine, plan(rows=1))
    grant = lease(engine, OLD)
    assert grant is not None
    assert grant.study.id == second


def test_a_study_belongs_to_nobody_once_who_began_it_is_gone_without_a_result(
    engine: Engine, plan: Drawing, report: Reporting
) -> None:
    study = create(engine, plan(rows=2))
    gone = lease(engine, {"platform": "?"}, 3)
    assert gone is not None
    with pytest.raises(ConflictError, match="was begun with code unknown, mujoco unknown"):
        lease(engine, LINUX, now=TTL - 1.0)
    leases.reap(engine, now=TTL, ttl=TTL)
    grant = lease(engine, LINUX, 8, now=TTL)
    assert grant is not None and len(places(grant)) == 8
    assert studies.get(engine, study).identity == identity(LINUX)
    # Who had it comes back: its numbers are not mixed with those of other code.
    late = reports(gone, report)
    assert post(engine, gone, late, now=TTL) == ["conflict"] * 3
    assert set(post(engine, grant, reports(grant, report), now=TTL)) == {"accepted"}
    assert studies.get(engine, study).state == "complete"


def test_what_was_lost_with_other_code_begins_anew_when_workers_bring_another(
    engine: Engine, plan: Drawing, report: Reporting
) -> None:
    study = create(engine, plan(rows=1))
    for attempt in range(5):
        gone = lease(engine, OLD, 2, now=attempt * TTL)
        leases.reap(engine, now=(attempt + 1) * TTL, ttl=TTL)
    assert studies.get(engine, study).failures == {"lost": 2}
    edition = studies.get(engine, study).edition
    grant = lease(engine, LINUX, 4, now=5 * TTL)
    assert grant is not None and len(places(grant)) == 4
    begun = studies.get(engine, study)
    assert (begun.failures, begun.result_count, begun.leased) == ({}, 0, 4)
    assert begun.edition > edition, "whoever has read the log begins anew, too"
    assert check.faults(engine) == []
    assert gone is not None
    assert post(engine, gone, reports(gone, report), now=5 * TTL) == ["conflict"] * 2
    assert set(post(engine, grant, reports(grant, report), now=5 * TTL)) == {"accepted"}
    assert studies.get(engine, study).ok_count == 4


def test_how_often_instances_were_lost_with_other_code_does_not_count(
    engine: Engine, plan: Drawing
) -> None:
    study = create(engine, plan(rows=1))
    for attempt in range(8):
        assert lease(engine, OLD if attempt < 4 else LINUX, 4, now=attempt * TTL)
        leases.reap(engine, now=(attempt + 1) * TTL, ttl=TTL)
    assert studies.get(engine, study).failures == {}
    assert lease(engine, LINUX, 4, now=8 * TTL)
    leases.reap(engine, now=9 * TTL, ttl=TTL)
    assert studies.get(engine, study).failures == {"lost": 4}


def test_a_study_that_ended_with_nothing_but_losses_runs_again_with_any_code_when_told_to(
    engine: Engine, plan: Drawing
) -> None:
    study = create(engine, plan(rows=1))
    for attempt in range(5):
        lease(engine, OLD, 4, now=attempt * TTL)
        leases.reap(engine, now=(attempt + 1) * TTL, ttl=TTL)
    assert lease(engine, LINUX, 4, now=5 * TTL) is None
    reruns.rerun(engine, study, which="failed", outcomes=["lost"], now=5 * TTL)
    assert len(places(lease(engine, LINUX, 4, now=5 * TTL))) == 4


def test_a_late_result_binds_a_study_to_the_code_of_who_was_gone(
    engine: Engine, plan: Drawing, report: Reporting
) -> None:
    create(engine, plan(rows=1))
    gone = lease(engine, OLD, 2)
    assert gone is not None
    leases.reap(engine, now=TTL, ttl=TTL)
    assert post(engine, gone, reports(gone, report)[:1], now=TTL) == ["accepted"]
    with pytest.raises(ConflictError, match=r"was begun with code c0de, mujoco 3\.9\.0"):
        lease(engine, LINUX, now=TTL)


def test_a_tagged_study_goes_to_workers_with_all_its_tags(engine: Engine, plan: Drawing) -> None:
    create(engine, plan(), tags=["lab", "fast"])
    with pytest.raises(ConflictError, match="is for workers tagged fast"):
        lease(engine, LINUX, tags=["lab"])
    assert lease(engine, LINUX, tags=["fast", "lab", "mine"]) is not None


def test_a_worker_of_another_version_is_told_that_before_a_studys_tags(
    engine: Engine, plan: Drawing
) -> None:
    tagged = studies.create(engine, plan(), key=None, digest="", now=-1.0, tags=["gpu"])[0].id
    begun = create(engine, plan())
    lease(engine, LINUX)
    with pytest.raises(ConflictError, match=f"study {begun} was begun with code c0de, mujoco 4"):
        lease(engine, OLD)
    studies.cancel(engine, begun, now=1.0)
    with pytest.raises(ConflictError, match=f"study {tagged} is for workers tagged gpu"):
        lease(engine, OLD, now=1.0)


def test_what_crashed_goes_to_another_host_first_if_one_is_at_work(
    engine: Engine, plan: Drawing, report: Reporting
) -> None:
    create(engine, plan(rows=2))
    mine = lease(engine, LINUX, 1, host="a", worker="wa")
    lease(engine, LINUX, 1, host="b", worker="wb")
    assert mine is not None
    assert post(engine, mine, reports(mine, report, outcome="crashed")) == ["accepted"]
    assert places(lease(engine, LINUX, 1, host="a", worker="wa")) == [(0, 2)]
    assert places(lease(engine, LINUX, 1, host="b", worker="wb")) == [(0, 0)]


def test_what_crashed_on_the_only_host_is_tried_there_again(
    engine: Engine, plan: Drawing, report: Reporting
) -> None:
    create(engine, plan(rows=2))
    mine = lease(engine, LINUX, 1)
    assert mine is not None
    post(engine, mine, reports(mine, report, outcome="crashed"))
    assert places(lease(engine, LINUX, 1)) == [(0, 0)]


def test_rows_of_a_kind_of_machine_that_is_gone_begin_anew_elsewhere(
    engine: Engine, plan: Drawing, report: Reporting
) -> None:
    study = create(engine, plan(rows=1))
    gone = lease(engine, MAC, 3)
    assert gone is not None
    post(engine, gone, reports(gone, report)[:2])
    leases.reap(engine, now=TTL, ttl=TTL)
    assert places(lease(engine, LINUX, 8, now=TTL)) == []
    assert reruns.free_stranded_rows(engine, now=100.0, patience=3600.0) == 0
    assert reruns.free_stranded_rows(engine, now=3700.0, patience=3600.0) == 1
    freed = studies.get(engine, study)
    assert (freed.result_count, freed.pending) == (0, 4)
    grant = lease(engine, LINUX, 8, now=3700.0)
    assert len(places(grant)) == 4
    # The first machine wakes up: its bits must not be mixed with the row's new ones.
    late = post(engine, gone, [reports(gone, report)[2]], now=3701.0)
    assert late == ["conflict"]
    assert grant is not None
    assert set(post(engine, grant, reports(grant, report), now=3702.0)) == {"accepted"}
    assert studies.get(engine, study).state == "complete"


def test_a_row_of_which_something_is_still_held_is_not_freed(engine: Engine, plan: Drawing) -> None:
    create(engine, plan(rows=1))
    lease(engine, MAC, 3)
    assert reruns.free_stranded_rows(engine, now=9000.0, patience=3600.0) == 0
