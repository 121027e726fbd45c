"""Results: taking them in, and reading them out in order."""

from collections.abc import Callable, Collection, Iterator, Sequence
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine

from server.errors import NotFoundError
from server.logic.leases import Lease, objection_to_results
from server.logic.records import record
from server.logic.slots import Result, Slot
from server.logic.study import Study, instance_id
from server.logic.verdicts import Judgement, Report, Verdict, judge
from server.store import comparisons, ledger, offers, queue, studies, workers
from server.store.engine import reading, writing
from server.store.offers import Elsewhere, Grant, Misfit, Wish
from server.store.schema import conflicts, results

#: Results read out per transaction, so that a slow reader keeps nobody waiting.
PAGE = 1000


@record
class Post:
    """Results as a worker posts them, and what they are judged by."""

    reports: Sequence[Report]
    #: The lease it says they belong to, and the lease's fence to prove it.
    lease: str
    fence: int
    worker: str
    #: Of the results, how many another host is to compute again.
    share: float = 0.0
    #: Relative difference of an output at which two hosts still agree.
    tolerance: float = 0.0


def post(
    engine: Engine,
    reports: Sequence[Report],
    *,
    lease_id: str,
    fence: int,
    worker: str,
    now: float,
    ttl: float,
    share: float = 0.0,
    tolerance: float = 0.0,
) -> list[Verdict]:
    """Judge and file reports as `take` does, in a transaction of their own."""
    posted = Post(
        reports=reports,
        lease=lease_id,
        fence=fence,
        worker=worker,
        share=share,
        tolerance=tolerance,
    )
    with writing(engine) as connection:
        return take(connection, posted, now=now, ttl=ttl)


def take(connection: Connection, posted: Post, *, now: float, ttl: float) -> list[Verdict]:
    """Judge and file reports, the good ones whatever becomes of the others.

    Args:
        connection: a transaction that has locked no study.
        posted: what the worker says.
        now: seconds, UTC epoch.
        ttl: seconds the lease lasts from now on, if it still holds anything.

    Returns:
        A verdict for each report, in order.
    """
    taken = _take(connection, posted, now, ttl)
    if taken.study is not None:
        workers.heard_from(connection, posted.worker, done=taken.done, now=now)
    return taken.verdicts


def exchange(
    connection: Connection, posted: Post, wish: Wish, *, now: float, ttl: float
) -> tuple[list[Verdict], Grant | Misfit | Elsewhere | None]:
    """Take in results and lease the next instances: `take` and `offers.offer` at once."""
    taken = _take(connection, posted, now, ttl)
    same = wish.worker == posted.worker
    if taken.study is not None and not same:
        workers.heard_from(connection, posted.worker, done=taken.done, now=now)
    done = taken.done if same else 0
    found = offers.offer(connection, wish, now=now, ttl=ttl, locked=taken.study, done=done)
    return taken.verdicts, found


@record
class _Taken:
    """What became of results."""

    verdicts: list[Verdict]
    #: The study that is locked, as it is now; None if the lease is not the worker's.
    study: Study | None = None
    #: How many of the results are final.
    done: int = 0


def _take(connection: Connection, posted: Post, now: float, ttl: float) -> _Taken:
    """Do what `take` does but for noting that the worker was in touch."""
    reports = posted.reports
    lease = queue.find(connection, posted.lease)
    if lease is None:
        return _to_all(reports, "unknown", "there is no such lease")
    objection = objection_to_results(lease, fence=posted.fence, worker=posted.worker)
    if objection is not None:
        return _to_all(reports, "invalid", objection)
    try:
        study = studies.find(connection, lease.study, lock=True)
    except NotFoundError:
        # Deleted since its lease was read, which took no lock.
        return _to_all(reports, "unknown", "the study was deleted")
    if not lease.compares:
        return _file(connection, posted, study, lease, now, ttl)
    verdicts = comparisons.judge(
        connection,
        study,
        reports,
        lease=lease,
        stored=_at(connection, study, lease.instances),
        host=lease.host,
        tolerance=posted.tolerance,
        now=now,
    )
    _keep_or_end(connection, lease, comparisons.are_held(connection, lease), now, ttl)
    return _Taken(verdicts=verdicts, study=study)


def _file(
    connection: Connection,
    posted: Post,
    study: Study,
    lease: Lease,
    now: float,
    ttl: float,
) -> _Taken:
    """Judge reports on instances of a study and write what follows."""
    places = {instance_id(study.id, *place): place for place in lease.instances}
    named = [places[report.instance] for report in posted.reports if report.instance in places]
    before = ledger.rows(connection, study, named)
    hosts: set[str] | None = None

    def at_work() -> set[str]:
        """Return the hosts of the lease's class that work on the study, asked for once."""
        nonlocal hosts
        if hosts is None:
            of_class = lease.host_class
            hosts = workers.hosts_at_work(connection, study.id, host_class=of_class, now=now)
        return hosts

    judgements = _judge(
        posted.reports,
        places=places,
        slots=dict(before),
        stored=_at(connection, study, {place for place in named if _is_done(before.get(place))}),
        lease=lease.id,
        outputs=study.plan.outputs,
        host=lease.host,
        host_class=lease.host_class,
        at_work=at_work,
    )
    final = [j.result for j in judgements if j.result is not None]
    after = {(j.slot.row, j.slot.position): j.slot for j in judgements if j.slot is not None}
    study = ledger.settle(
        connection, study, before=before, after=after, filed=final, worker=posted.worker, now=now
    )
    contradictions = [j.conflict for j in judgements if j.conflict is not None]
    _record_conflicts(connection, study, contradictions, worker=posted.worker, now=now)
    comparisons.ask(
        connection,
        study,
        final,
        share=posted.share,
        host=lease.host,
        worker=posted.worker,
        now=now,
    )
    known = {**before, **after}
    holds = bool(ledger.held(known, lease=lease.id)) or ledger.are_held(
        connection,
        study,
        [place for place in lease.instances if place not in known],
        lease=lease.id,
    )
    _keep_or_end(connection, lease, holds, now, ttl)
    verdicts = [judgement.verdict for judgement in judgements]
    return _Taken(verdicts=verdicts, study=study, done=len(final))


def in_order(engine: Engine, study: Study) -> Iterator[tuple[Result, str]]:
    """Yield a study's results and who reported each, by row and position, a page at a time."""
    at = (-1, -1)
    while True:
        query = (
            sa.select(results)
            .where(
                results.c.study_id == study.id,
                sa.tuple_(results.c.row, results.c.position) > sa.tuple_(*at),
            )
            .order_by(results.c.row, results.c.position)
            .limit(PAGE)
        )
        with reading(engine) as connection:
            page = connection.execute(query).all()
        for row in page:
            yield _result(row), row.worker_id
        if len(page) < PAGE:
            return
        at = (page[-1].row, page[-1].position)


def _judge(
    reports: Sequence[Report],
    *,
    places: dict[str, ledger.Place],
    slots: dict[ledger.Place, Slot],
    stored: dict[ledger.Place, Result],
    lease: str,
    outputs: Sequence[str],
    host: str | None,
    host_class: str | None,
    at_work: Callable[[], Collection[str]],
) -> list[Judgement]:
    """Judge reports one after the other, each in the light of those before it."""
    judgements = []
    for report in reports:
        place = places.get(report.instance, (-1, -1))
        judgement = judge(
            report,
            slot=slots.get(place),
            stored=stored.get(place),
            lease=lease,
            outputs=outputs,
            host=host,
            host_class=host_class,
            at_work=at_work,
        )
        if judgement.slot is not None:
            slots[place] = judgement.slot
        if judgement.result is not None:
            stored[place] = judgement.result
        judgements.append(judgement)
    return judgements


def _keep_or_end(connection: Connection, lease: Lease, holds: bool, now: float, ttl: float) -> None:
    """Let a lease last on that still holds something; end it if it does not."""
    if holds:
        queue.extend(connection, lease, now=now, ttl=ttl)
    else:
        queue.end(connection, lease, "finished")


def _to_all(reports: Sequence[Report], verdict: str, detail: str) -> _Taken:
    return _Taken(
        verdicts=[Verdict(instance=r.instance, verdict=verdict, detail=detail) for r in reports]
    )


def _is_done(slot: Slot | None) -> bool:
    return slot is not None and slot.state == "done"


def _at(
    connection: Connection, study: Study, places: Collection[ledger.Place]
) -> dict[ledger.Place, Result]:
    """Return the final results at `places`, leaving out those that have none."""
    if not places:
        return {}
    query = sa.select(results).where(
        results.c.study_id == study.id, results.c.row.in_({row for row, _ in places})
    )
    found = {(row.row, row.position): _result(row) for row in connection.execute(query)}
    return {place: found[place] for place in places if place in found}


def _record_conflicts(
    connection: Connection, study: Study, found: Sequence[Result], *, worker: str, now: float
) -> None:
    if not found:
        return
    connection.execute(
        sa.insert(conflicts),
        [
            {
                "study_id": study.id,
                "row": result.row,
                "position": result.position,
                "outcome": result.outcome,
                "outputs": result.outputs,
                "reason": result.reason,
                "worker_id": worker,
                "received_at": now,
            }
            for result in found
        ],
    )


def _result(row: Any) -> Result:
    return Result(
        row=row.row,
        position=row.position,
        outcome=row.outcome,
        outputs=row.outputs,
        reason=row.reason,
        state=row.state,
        wall_seconds=row.wall_seconds,
    )
