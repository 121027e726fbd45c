"""Whoever changes the same rows on PostgreSQL locks them in one order, so nobody waits in a circle.

In each test somebody stands still in the midst of a transaction until somebody else waits for it.
"""

import io
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any

import pytest
import sqlalchemy as sa
from sqlalchemy.engine import Engine

from server.operations import close_loops
from server.operations.fleet import leases
from server.operations.fleet import served as served_study
from server.operations.fleet.exchange import Exchange, Grant, LeaseRequest, Post
from server.operations.fleet.turns import take_turn
from server.operations.study import studies
from server.records import Introduction, Plan, Session, Study
from server.store import sessions
from server.store.database.engine import reading, writing
from server.store.fleet.turns import Turn, at_once, turn_within
from tests.testbed.coordinators.records import report

TTL = 60.0
CRASHED: dict[str, Any] = {"outcome": "crashed", "outputs": None}


@pytest.fixture
def kind() -> str:
    return "postgresql"


@pytest.fixture
def beside() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor() as threads:
        yield threads


def wait_for_a_lock(engine: Engine, instead: Callable[[], bool] = lambda: False) -> None:
    """Return when a transaction waits for another one, or something else has happened instead."""
    waiting = sa.text(
        "SELECT count(*) FROM pg_stat_activity "
        "WHERE datname = current_database() AND wait_event_type = 'Lock'"
    )
    deadline = time.monotonic() + 20.0
    while not instead():
        with reading(engine) as connection:
            if connection.scalar(waiting):
                return
        assert time.monotonic() < deadline, "nobody waits"
        time.sleep(0.01)


def created(engine: Engine, plan: Plan, now: float) -> Study:
    return studies.create(engine, plan, key=None, digest="", now=now)[0]


def asking(worker: str, study: Study) -> Exchange:
    """Return a request of a worker that is first served in the turn of a study."""
    told = Introduction(id=worker, host=worker, versions={})
    request = LeaseRequest(worker=told, models=["ishigami"], max_instances=2)
    return Exchange(now=1.0, ttl=TTL, request=request, first=study.id)


def crashed(held: Grant) -> Exchange:
    """Return a post of half of what a lease holds, which is judged in the midst of a turn."""
    row, position = held.lease.instances[0]
    return posting(held, report(f"{held.study.id}:{row}:{position}", **CRASHED))


def posting(held: Grant, *reports: Any) -> Exchange:
    lease = held.lease
    post = Post(reports=reports, lease=lease.id, fence=lease.fence, worker=lease.worker)
    return Exchange(now=1.0, ttl=TTL, posted=post)


def turn(engine: Engine, study: Study, *exchanges: Exchange) -> list[Any]:
    """Serve all in one turn of a transaction."""
    with writing(engine) as connection:
        taken = at_once(take_turn(turn_within(connection), study.id, lambda: exchanges))
    return [found for _, found in taken.answers]


@pytest.mark.parametrize("rival", ["a renewal", "a coordinator that starts"])
def test_a_turn_and_who_extends_its_leases_never_wait_for_each_other(
    engine: Engine,
    plan: Callable[..., Plan],
    beside: ThreadPoolExecutor,
    monkeypatch: pytest.MonkeyPatch,
    rival: str,
) -> None:
    study = created(engine, plan(), 0.0)
    mine, other = turn(engine, study, asking("w", study), asking("v", study))
    extensions: dict[str, Callable[..., Any]] = {
        "a renewal": partial(leases.renew, engine, mine.lease.id, fence=mine.lease.fence),
        "a coordinator that starts": partial(leases.extend_open_leases, engine),
    }
    extending: list[Future[Any]] = []
    hosts_at_work = served_study.hosts_at_work

    async def stop(*given: Any, **named: Any) -> set[str]:
        # What the turn has decided by now is written.
        if not extending:
            extend = extensions[rival]
            extending.append(beside.submit(extend, now=1.0, ttl=TTL))
            wait_for_a_lock(engine)
        return await hosts_at_work(*given, **named)

    monkeypatch.setattr(served_study, "hosts_at_work", stop)
    names = [f"{study.id}:{row}:{position}" for row, position in other.lease.instances]
    served = turn(
        engine,
        study,
        asking("w", study),
        posting(other, *map(report, names)),
        crashed(mine),
    )
    assert isinstance(served[0], Grant)
    (extended,) = extending
    extended.result(timeout=20.0)


def test_turns_of_two_studies_never_wait_for_each_other(
    engine: Engine,
    plan: Callable[..., Plan],
    beside: ThreadPoolExecutor,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    first, second = created(engine, plan(), 0.0), created(engine, plan(), 1.0)
    a, x = turn(engine, first, asking("a", first), asking("x", first))
    studies.prioritise(engine, second.id, 1)
    b, y = turn(engine, second, asking("b", second), asking("y", second))
    others: list[Future[Any]] = []
    stopped: list[str] = []
    hosts_at_work = served_study.hosts_at_work

    async def stop(turn_: Turn, study: Study, *given: Any, **named: Any) -> set[str]:
        if study.id not in stopped:
            stopped.append(study.id)
            if study.id == first.id:
                there = (asking("a", second), crashed(b), asking("b", second), crashed(y))
                others.append(beside.submit(turn, engine, second, *there))
                wait_for_a_lock(engine, lambda: second.id in stopped)
            else:
                wait_for_a_lock(engine, lambda: "the first is over" in stopped)
        return await hosts_at_work(turn_, study, *given, **named)

    monkeypatch.setattr(served_study, "hosts_at_work", stop)
    turn(engine, first, asking("b", first), crashed(a), asking("a", first), crashed(x))
    stopped.append("the first is over")
    (other,) = others
    assert all(isinstance(found, Grant | None) for found in other.result(timeout=20.0))
    assert {first.id, second.id} < {*stopped}


def test_a_worker_that_asks_for_jobs_and_hands_one_in_never_waits_for_itself(
    engine: Engine, beside: ThreadPoolExecutor
) -> None:
    with writing(engine) as connection:
        session = Session(id="s", name="s", sha256="0", size=1, content={}, created_at=0.0)
        sessions.add(connection, session, io.BytesIO(b"z"))
    worker = Introduction(id="w", host="h", versions={})
    close_loops.create(engine, "s", code="c", now=0.0)
    granted = close_loops.grant(engine, worker, now=0.0, ttl=TTL)
    assert granted is not None
    job, _ = granted
    assert close_loops.reap(engine, now=2 * TTL) == 1
    asked: list[Future[Any]] = []

    class Report(io.BytesIO):
        def read(self, size: int | None = -1, /) -> bytes:
            # The job is locked by now.
            if not asked:
                asked.append(beside.submit(close_loops.grant, engine, worker, now=2 * TTL, ttl=TTL))
                wait_for_a_lock(engine)
            return super().read(size)

    proof = close_loops.Proof(lease=job.attempts[-1].lease, fence=1, worker="w")
    files = {"report.json": Report(b"{}")}
    assert close_loops.hand_in(
        engine, job.id, files, proof=proof, code="c", verdict="explained", now=2 * TTL
    )
    (found,) = asked
    assert found.result(timeout=20.0) is None
