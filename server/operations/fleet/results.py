"""Results: taking them in, and reading them out in order."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

from sqlalchemy.engine import Engine

from server.logic.fleet.comparisons import is_chosen, is_comparable
from server.logic.fleet.leases import expiry, objection_to_results
from server.logic.fleet.verdicts import Judgement, Report, judge_all
from server.logic.study.points import instance_id
from server.operations.fleet import comparisons
from server.operations.fleet.exchange import Deferred, Exchange, Post
from server.operations.fleet.served import ServedStudy
from server.records import Instance, Lease, Place, Result, Study, record
from server.states import InstanceState, LeaseState, Outcome, Verdict
from server.store.database.engine import reading
from server.store.fleet import results
from server.store.fleet.rare import superseded

#: Results read out per transaction, so that a slow reader keeps nobody waiting.
PAGE = 1000


@record
class Judged:
    """What was made of results."""

    judgements: list[Judgement]
    #: How many of the results are final; None if the lease is not the worker's.
    done: int | None = None


# Looked up once: in Python 3.11 a member of an enum takes as long as a call.
_DONE = InstanceState.DONE


class _HostsWantedError(Exception):
    """To judge a result one must know which hosts are at work."""


async def take(served: ServedStudy, exchange: Exchange, posted: Post) -> Judged | Deferred:
    """Judge and file reports, the good ones whatever is said of the others.

    Returns:
        A judgement of each report, in order; Deferred if the lease is of another study.
    """
    reports, study = posted.reports, served.study
    lease = served.seen.leases.get(posted.lease)
    if lease is None:
        why = "there is no such lease: its study was deleted, or this is another database"
        return _to_all(reports, Verdict.UNKNOWN, why)
    objection = objection_to_results(lease, fence=posted.fence, worker=posted.worker)
    if objection is not None:
        return _to_all(reports, Verdict.INVALID, objection)
    if study is None or lease.study != study.id:
        if lease.study == exchange.first:
            # Deleted since its lease was read.
            return _to_all(reports, Verdict.UNKNOWN, "the study was deleted")
        return Deferred(rest=replace(exchange, first=lease.study))
    if not lease.compares:
        return await _file(served, study, exchange, posted, lease)
    await served.write()
    judgements, compared, holds = comparisons.judge(
        study,
        reports,
        asked=await served.turn.opinions_of(lease),
        stored=await served.turn.results_at(study, lease.instances),
        lease=lease,
        tolerance=posted.tolerance,
        now=exchange.now,
    )
    served.changes.compared += compared
    # What failed is to be asked for again.
    served.stale = True
    _keep_or_end(served, lease, holds, exchange)
    return Judged(judgements=judgements, done=0)


async def _file(
    served: ServedStudy, study: Study, exchange: Exchange, posted: Post, lease: Lease
) -> Judged:
    """Judge reports on instances of the study and note what follows."""
    places = {instance_id(study.id, *place): place for place in lease.instances}
    named = [places[report.instance] for report in posted.reports if report.instance in places]
    before = served.in_rows(named)
    judgements = await _judged(served, study, exchange, posted, lease, places, before)
    changed = [j.instance for j in judgements if j.instance is not None]
    after = {(one.row, one.position): one for one in changed}
    final = [j.result for j in judgements if j.result is not None]
    holds = await served.apply(study, lease, before=before, after=after, filed=final)
    found = [j.instead for j in judgements if j.instead is not None]
    if found:
        await served.find(lease, found)
    changes = served.changes
    changes.conflicts += [(posted.worker, j.conflict) for j in judgements if j.conflict is not None]
    changes.asked += [
        (lease.host, lease.worker, place)
        for place in await _compared(served, study, final, posted.share)
    ]
    _keep_or_end(served, lease, holds, exchange)
    return Judged(judgements=judgements, done=len(final) + len(found))


async def _judged(
    served: ServedStudy,
    study: Study,
    exchange: Exchange,
    posted: Post,
    lease: Lease,
    places: Mapping[str, Place],
    before: Mapping[Place, Instance],
) -> list[Judgement]:
    """Judge reports; what is rarely needed for that is asked for."""
    named = {places[report.instance] for report in posted.reports if report.instance in places}
    elsewhere = [at for at in named & before.keys() if before[at].lease != lease.id]
    done = {at for at in elsewhere if before[at].state == _DONE}
    stored: Mapping[Place, Result] = {}
    if done:
        await served.write()
        stored = await served.turn.results_at(study, done)
    late = {at for at in elsewhere if at not in stored or stored[at].outcome == Outcome.LOST}
    again = await superseded(served.turn, study, lease, late) if late else ()
    hosts: Collection[str] | None = None

    def at_work() -> Collection[str]:
        if hosts is None:
            raise _HostsWantedError
        return hosts

    def judged() -> list[Judgement]:
        return judge_all(
            posted.reports,
            places=places,
            instances=before,
            stored=stored,
            lease=lease,
            outputs=study.plan.outputs,
            curves=study.plan.curves,
            at_work=at_work,
            superseded=again,
        )

    try:
        return judged()
    except _HostsWantedError:
        await served.write()
        hosts = await served.at_work(study, lease.host_class)
        return judged()


async def _compared(
    served: ServedStudy, study: Study, found: Sequence[Result], share: float
) -> list[Place]:
    """Return for which new final results second opinions are asked for.

    None is asked for on a model that is not deterministic: two of its numbers may differ.
    """
    chosen = [
        (result.row, result.position)
        for result in found
        if is_comparable(result) and is_chosen(study.plan.seed, result.row, result.position, share)
    ]
    model = study.plan.model
    if chosen and "@" in model and not await served.turn.is_deterministic(model):
        return []
    return chosen


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


def _keep_or_end(served: ServedStudy, lease: Lease, holds: bool, exchange: Exchange) -> None:
    """Let a lease last on that still holds something; end it if it does not."""
    if holds:
        until = expiry(exchange.now, exchange.ttl)
        served.changes.extended.setdefault(until, []).append(lease.id)
    else:
        served.changes.ended.setdefault(LeaseState.FINISHED, []).append(lease.id)


def _to_all(reports: Sequence[Report], verdict: Verdict, detail: str) -> Judged:
    return Judged(
        judgements=[Judgement(about=r.instance, verdict=verdict, detail=detail) for r in reports]
    )
