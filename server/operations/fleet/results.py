"""Results: taking them in, and reading them out in order."""

from collections.abc import Iterator, Sequence
from functools import cache

from sqlalchemy.engine import Connection, Engine

from server.errors import NotFoundError
from server.logic.fleet.leases import expiry, objection_to_results
from server.logic.fleet.verdicts import Judgement, Report, judge_all
from server.logic.study.instances import held
from server.logic.study.points import instance_id
from server.operations.fleet import comparisons, leasing
from server.operations.fleet.leasing import Deferred, Grant, Ineligible, LeaseRequest
from server.operations.study.instances import settle
from server.records import Lease, Result, Study, record
from server.states import InstanceState, LeaseState, Verdict
from server.store.database.engine import reading
from server.store.fleet import leases, results, workers
from server.store.study import instances, studies

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
    #: Of the results, how many another host computes again.
    share: float = 0.0
    #: Relative difference of an output at which two hosts still agree.
    tolerance: float = 0.0


def take(connection: Connection, posted: Post, *, now: float, ttl: float) -> list[Judgement]:
    """Judge and file reports, the good ones whatever is said of the others.

    The transaction has locked no study.

    Returns:
        A judgement of each report, in order.
    """
    taken = _take(connection, posted, now, ttl)
    if taken.study is not None:
        workers.heard_from(connection, posted.worker, done=taken.done, now=now)
    return taken.judgements


def exchange(
    connection: Connection, posted: Post, request: LeaseRequest, *, now: float, ttl: float
) -> tuple[list[Judgement], Grant | Ineligible | Deferred | None]:
    """Take in results and lease the next instances: `take` and `leasing.grant` at once."""
    taken = _take(connection, posted, now, ttl)
    same = request.worker.id == posted.worker
    if taken.study is not None and not same:
        workers.heard_from(connection, posted.worker, done=taken.done, now=now)
    done = taken.done if same else 0
    found = leasing.grant(connection, request, now=now, ttl=ttl, locked=taken.study, done=done)
    return taken.judgements, found


@record
class _Taken:
    """What was made of results."""

    judgements: list[Judgement]
    #: The study that is locked, as it is now; None if the lease is not the worker's.
    study: Study | None = None
    #: How many of the results are final.
    done: int = 0


def _take(connection: Connection, posted: Post, now: float, ttl: float) -> _Taken:
    """Do what `take` does but for noting that the worker was in touch."""
    reports = posted.reports
    lease = leases.find(connection, posted.lease)
    if lease is None:
        return _to_all(reports, Verdict.UNKNOWN, "there is no such lease")
    objection = objection_to_results(lease, fence=posted.fence, worker=posted.worker)
    if objection is not None:
        return _to_all(reports, Verdict.INVALID, objection)
    try:
        study = studies.find(connection, lease.study, lock=True)
    except NotFoundError:
        # Deleted since its lease was read, which took no lock.
        return _to_all(reports, Verdict.UNKNOWN, "the study was deleted")
    if not lease.compares:
        return _file(connection, posted, study, lease, now, ttl)
    judgements, holds = comparisons.judge(
        connection, study, reports, lease=lease, tolerance=posted.tolerance, now=now
    )
    _keep_or_end(connection, lease, holds, now, ttl)
    return _Taken(judgements=judgements, study=study)


def _file(
    connection: Connection, posted: Post, study: Study, lease: Lease, now: float, ttl: float
) -> _Taken:
    """Judge reports on instances of a study and write what follows."""
    places = {instance_id(study.id, *place): place for place in lease.instances}
    named = [places[report.instance] for report in posted.reports if report.instance in places]
    before = instances.in_rows(connection, study.id, named)

    @cache
    def at_work() -> set[str]:
        """Return the hosts of the lease's class that work on the study, asked for once."""
        return workers.hosts_at_work(connection, study.id, host_class=lease.host_class, now=now)

    done = {
        place for place in named if place in before and before[place].state == InstanceState.DONE
    }
    judgements = judge_all(
        posted.reports,
        places=places,
        instances=before,
        stored=results.at(connection, study.id, done),
        lease=lease,
        outputs=study.plan.outputs,
        curves=study.plan.curves,
        at_work=at_work,
    )
    final = [j.result for j in judgements if j.result is not None]
    changed = [j.instance for j in judgements if j.instance is not None]
    after = {(one.row, one.position): one for one in changed}
    study = settle(
        connection, study, before=before, after=after, filed=final, worker=posted.worker, now=now
    )
    conflicts = [j.conflict for j in judgements if j.conflict is not None]
    results.add_conflicts(connection, study.id, conflicts, worker=posted.worker, now=now)
    comparisons.ask(connection, study, final, lease, share=posted.share, now=now)
    known = {**before, **after}
    others = [place for place in lease.instances if place not in known]
    holds = bool(held(known, lease=lease.id)) or instances.are_held(
        connection, study.id, others, lease=lease.id
    )
    _keep_or_end(connection, lease, holds, now, ttl)
    return _Taken(judgements=judgements, study=study, done=len(final))


def in_order(engine: Engine, study: Study) -> Iterator[tuple[Result, str]]:
    """Yield a study's results and who reported each, by row and position, a page at a time."""
    at = (-1, -1)
    while True:
        with reading(engine) as connection:
            page = results.page(connection, study.id, after=at, limit=PAGE)
        yield from page
        if len(page) < PAGE:
            return
        last, _ = page[-1]
        at = (last.row, last.position)


def _keep_or_end(connection: Connection, lease: Lease, holds: bool, now: float, ttl: float) -> None:
    """Let a lease last on that still holds something; end it if it does not."""
    if holds:
        leases.extend(connection, lease, now=now, until=expiry(now, ttl))
    else:
        leases.end(connection, lease, LeaseState.FINISHED)


def _to_all(reports: Sequence[Report], verdict: Verdict, detail: str) -> _Taken:
    return _Taken(
        judgements=[Judgement(about=r.instance, verdict=verdict, detail=detail) for r in reports]
    )
