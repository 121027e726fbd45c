"""Posting to the database and reading back."""

from collections.abc import Callable

import pytest
import sqlalchemy as sa
from sqlalchemy.engine import Engine

from analysis.files.results_csv import columns
from server.logic.fleet.verdicts import Report, Verdict
from server.logic.study.points import instance_id, parameters
from server.logic.study.table import lines
from server.operations.fleet import leases, results
from server.operations.fleet.exchange import Grant
from server.operations.study import studies
from server.records import Plan
from server.store.database.engine import reading
from server.store.database.schema import conflicts
from tests.testbed.coordinators import exchanges

Reporting = Callable[..., Report]
Leasing = Callable[..., Grant]


@pytest.fixture
def grant(engine: Engine, plan: Callable[..., Plan], lease: Leasing) -> Grant:
    """A lease of the first of two rows."""
    studies.create(engine, plan(), key=None, digest="", now=0.0)
    return lease("w", 4)


def _post(engine: Engine, grant: Grant, *reports: Report, **changes: object) -> list[Verdict]:
    said = {
        "lease_id": grant.lease.id,
        "fence": grant.lease.fence,
        "worker": grant.lease.worker,
        "now": 1.0,
        "ttl": 60.0,
        **changes,
    }
    return exchanges.post(engine, reports, **said)  # type: ignore[arg-type]


def _names(grant: Grant) -> list[str]:
    return [instance_id(grant.study.id, *place) for place in grant.lease.instances]


def _verdicts(verdicts: list[Verdict]) -> list[str]:
    return [verdict.verdict for verdict in verdicts]


def test_the_good_are_taken_whatever_becomes_of_the_others(
    engine: Engine, grant: Grant, report: Reporting
) -> None:
    a, b, c, d = _names(grant)
    verdicts = _post(
        engine,
        grant,
        report(a),
        report(a),
        report(a, outputs={"y": 9.0}),
        report(b, outputs={}),
        report("nothing:0:0"),
        report(c),
        report(d, outcome="crashed"),
    )
    assert _verdicts(verdicts) == [
        "accepted",
        "duplicate",
        "conflict",
        "invalid",
        "unknown",
        "accepted",
        "accepted",
    ]
    study = studies.get(engine, grant.study.id)
    assert (study.result_count, study.ok_count, study.leased, study.returned) == (2, 2, 0, 2)


def test_conflicts_are_recorded_and_change_nothing(
    engine: Engine, grant: Grant, report: Reporting
) -> None:
    first = _names(grant)[0]
    _post(engine, grant, report(first))
    _post(engine, grant, report(first, outputs={"y": 2.0}), now=3.0)
    with reading(engine) as connection:
        (found,) = connection.execute(sa.select(conflicts)).all()
    assert (found.row, found.position, found.worker_id, found.received_at) == (0, 0, "w", 3.0)
    assert found.outputs == {"y": 2.0}
    ((result, _),) = results.in_order(engine, grant.study)
    assert result.outputs == {"y": 1.5}


@pytest.mark.parametrize(
    ("changes", "verdict", "says"),
    [
        ({"fence": 999}, "invalid", "the fence of this lease is not 999"),
        ({"worker": "thief"}, "invalid", "does not belong to worker thief"),
        ({"lease_id": "forged"}, "unknown", "there is no such lease"),
    ],
)
def test_a_forged_lease_brings_nothing_in(
    engine: Engine,
    grant: Grant,
    report: Reporting,
    changes: dict[str, object],
    verdict: str,
    says: str,
) -> None:
    told = _post(engine, grant, *(report(name) for name in _names(grant)), **changes)
    assert _verdicts(told) == [verdict] * 4
    assert all(says in one.detail for one in told)
    assert studies.get(engine, grant.study.id).result_count == 0


def test_another_s_instances_cannot_be_answered_under_one_s_own_lease(
    engine: Engine, grant: Grant, lease: Leasing, report: Reporting
) -> None:
    other = lease("v", 4)
    assert _verdicts(_post(engine, other, report(_names(grant)[0]))) == ["unknown"]


def test_an_instance_nobody_was_given_is_unknown(
    engine: Engine, grant: Grant, report: Reporting
) -> None:
    never = instance_id(grant.study.id, 1, 3)
    assert _verdicts(_post(engine, grant, report(never))) == ["unknown"]


def test_the_faster_of_two_holders_fills_the_slot(
    engine: Engine, grant: Grant, lease: Leasing, report: Reporting
) -> None:
    leases.reap(engine, now=60.0, ttl=60.0)
    second = lease("v", 4, now=60.0)
    assert second.lease.instances == grant.lease.instances
    first = _names(grant)[0]
    assert _verdicts(_post(engine, grant, report(first), now=61.0)) == ["accepted"]
    assert studies.get(engine, grant.study.id).leased == 3
    assert _verdicts(_post(engine, second, report(first), now=62.0)) == ["duplicate"]
    ((_, worker),) = results.in_order(engine, grant.study)
    assert worker == "w"


def test_nonsense_three_times_is_the_result(
    engine: Engine, grant: Grant, lease: Leasing, report: Reporting
) -> None:
    held = grant
    for _ in range(3):
        assert _names(held)[0] == _names(grant)[0]
        _post(engine, held, report(_names(held)[0], outputs={}))
        leases.release(engine, held.lease.id, fence=held.lease.fence, now=1.0)
        held = lease("w", 4, now=1.0)
    assert studies.get(engine, grant.study.id).failures == {"invalid": 1}


def test_results_are_read_in_order_of_row_and_position_across_pages(
    engine: Engine,
    grant: Grant,
    lease: Leasing,
    report: Reporting,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    second = lease("v", 4)
    _post(engine, second, *(report(name) for name in reversed(_names(second))))
    _post(engine, grant, *(report(name) for name in reversed(_names(grant))))
    for page in (1, 3, 4, 8, 100):
        monkeypatch.setattr(results, "PAGE", page)
        places = [(r.row, r.position) for r, _ in results.in_order(engine, grant.study)]
        assert places == [(row, position) for row in (0, 1) for position in range(4)]


def test_the_table_joins_parameters_and_results(
    engine: Engine, grant: Grant, report: Reporting
) -> None:
    a, b, *_ = _names(grant)
    _post(engine, grant, report(b, outcome="diverged"), report(a))
    plan = grant.study.plan
    names = ",".join(columns(plan.distributions, plan.outputs))
    assert names == "row,position,x1,x2,x3,outcome,y,wall_seconds,worker"
    table = list(lines(plan, results.in_order(engine, grant.study)))
    points = [list(point.values()) for point in parameters(plan, 0)]
    assert table == [
        [0, 0, *points[0], "ok", 1.5, 0.25, "w"],
        [0, 1, *points[1], "diverged", None, 0.25, "w"],
    ]
