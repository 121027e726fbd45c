"""Leasing: a worker that asks is given instances of one study."""

from collections.abc import Sequence
from dataclasses import replace
from math import inf
from secrets import token_hex

from server.logic.fleet.comparisons import GATHER_SECONDS
from server.logic.fleet.hosts import identity, objection_to_worker
from server.logic.fleet.leases import expiry
from server.logic.fleet.own_models import lacking
from server.logic.study.instances import may_try
from server.logic.study.studies import handed_out, new_rows
from server.operations.fleet.exchange import Deferred, Exchange, Grant, Ineligible, LeaseRequest
from server.operations.fleet.served import ServedStudy
from server.records import Instance, Lease, Place, Study
from server.states import ComparisonState, InstanceState, LeaseState, StudyState
from server.store.study.instances import IN_LIST

# Looked up once: in Python 3.11 a member of an enum takes as long as a call.
_LEASED = InstanceState.LEASED


async def grant(
    served: ServedStudy, exchange: Exchange, request: LeaseRequest
) -> Grant | Ineligible | Deferred | None:
    """Lease instances of one study that the worker may have: highest priority, then oldest.

    Second opinions that other hosts' results have waited for some seconds go first: they are few,
    and the sooner a host is found out, the better. Others wait until there is nothing else: one at
    a time they would cost more requests than the rest of the work. Of results, those in begun rows
    go first, so that rows are finished before new ones are begun.

    Returns:
        The lease of 1 to `max_instances` instances, without its fence; None if there is nothing to
        do; Ineligible if there is work but none for this worker; Deferred if it is in another
        study, since whoever locked two out of their order could wait for somebody who waits for it.
    """
    host, asked_by = request.worker.host, exchange.now - GATHER_SECONDS
    work, opinions = served.seen.work, served.seen.opinions
    if served.stale:
        await served.write()
        work, opinions = await served.turn.wanted([host], asked_by=asked_by)
    mine = [study_id for study_id, model in work if model in request.models]
    waited = opinions.get(host)
    comparing = None
    if waited:
        comparing = await _comparing(served, request, asked_by=asked_by)
    if comparing is None and waited is not None and not mine:
        comparing = await _comparing(served, request, asked_by=inf)
    if comparing is not None:
        if served.study is None or comparing != served.study.id:
            return Deferred(rest=replace(exchange, posted=None, first=comparing))
        # If another worker is faster with a second opinion, this one asks again.
        return await _lease_comparisons(served, served.study, exchange, request)
    objection, of_tags = None, True
    passed = exchange.passed
    for study_id in mine:
        candidate = None if study_id in passed else await served.other(study_id)
        if candidate is None:
            continue
        if (unfit := objection_to_worker(candidate, request.worker)) is not None:
            # That a study is for other tags is as it was meant; anything else may be mended here.
            tagged = not set(candidate.tags) <= set(request.worker.tags)
            if objection is None or (of_tags and not tagged):
                objection, of_tags = unfit, tagged
        elif candidate is not served.study:
            rest = replace(exchange, posted=None, first=study_id, passed=passed)
            return Deferred(rest=rest)
        elif (found := await _lease_instances(served, candidate, exchange, request)) is not None:
            return found
        else:
            passed |= {study_id}
    if objection is None:
        told = (lacking(*one, request.worker) for one in work if one[1] not in request.models)
        objection = next(filter(None, told), None)
    return None if objection is None else Ineligible(why=objection)


async def _comparing(served: ServedStudy, request: LeaseRequest, *, asked_by: float) -> str | None:
    """Return the first study in which this worker's second opinion was asked for by then, if any.

    First the few that are waiting are looked for, so that it costs nothing while there are none.
    """
    await served.write()
    found = await served.turn.opinions_wanted(request.worker.host, asked_by=asked_by)
    # That of the turn first, or two studies could send somebody to and fro.
    for study_id in sorted(found, key=lambda one: served.study is None or one != served.study.id):
        study = await served.other(study_id)
        if (
            study is not None
            and (study.state.is_served or study.state == StudyState.COMPLETE)
            and study.plan.model in request.models
            and objection_to_worker(study, request.worker) is None
        ):
            return study_id
    return None


async def _lease_instances(
    served: ServedStudy, study: Study, exchange: Exchange, request: LeaseRequest
) -> Grant | None:
    """Hand out instances of the locked study; None if it has none for this host class."""
    if not study.state.is_served:
        return None
    mine = identity(request.worker.versions)
    if study.identity is not None and study.identity != mine:
        # Whoever had it is gone without a result: what comes late is not mixed with this worker's.
        study = await served.begin_anew(study)
    host_class = request.host_class(study.plan.model)
    again = await _returned(served, study, exchange, request, host_class) if study.returned else []
    most = request.most(study.plan.model)
    wanted = most - len(again) if study.state == StudyState.RUNNING else 0
    begun, fresh = new_rows(study, wanted)
    if not again and not fresh:
        return None
    lease_id = new_id(exchange.now)
    changes = served.changes
    for one in again:
        place = one.row, one.position
        # Of a row that began in this turn nothing is stored yet.
        if place in changes.begun:
            changes.begun[place] = lease_id, host_class
        else:
            changes.moved.setdefault(_LEASED, []).append((place, lease_id))
        leased = replace(one, state=_LEASED, lease=lease_id, host_class=host_class)
        served.note({place: leased})
    changes.bound += [
        (row, host_class) for row in {one.row for one in again if one.host_class is None}
    ]
    for number, place in enumerate(begun):
        changes.begun[place] = (lease_id if number < fresh else None), host_class
    # Who asks next in this turn may have the rest of the last row.
    served.pending.setdefault(host_class, []).extend(
        _waiting(place, host_class) for place in begun[fresh:]
    )
    served.study = handed_out(
        study,
        begun=len(begun),
        leased=len(again) + fresh,
        identity=mine,
    )
    places = [*((one.row, one.position) for one in again), *begun[:fresh]]
    return _granted(served, lease_id, exchange, request, places)


async def _returned(
    served: ServedStudy, study: Study, exchange: Exchange, request: LeaseRequest, host_class: str
) -> list[Instance]:
    """Return instances of begun rows that wait for a machine and may go to this one."""
    host, most = request.worker.host, request.most(study.plan.model)
    if not served.stale:
        waiting = served.pending.get(host_class, [])
        found = waiting[:most]
        if all(one.avoid is None for one in found):
            served.pending[host_class] = waiting[most:]
            return found
        served.stale = True
    await served.write()
    at_work = await served.at_work(study, host_class)
    if not at_work - {host}:
        return await served.turn.returned(study, host_class, host, tried=None, limit=most)
    found = await served.turn.returned(study, host_class, host, tried=False, limit=most)
    if len(found) < most:
        tried = await served.turn.returned(study, host_class, host, tried=True, limit=IN_LIST)
        found += [one for one in tried if may_try(one, host, at_work)]
    return found[:most]


async def _lease_comparisons(
    served: ServedStudy, study: Study, exchange: Exchange, request: LeaseRequest
) -> Grant | None:
    """Hand out the locked study's results to be computed again; None if somebody was faster."""
    lease_id = new_id(exchange.now)
    await served.write()
    host, most = request.worker.host, request.most(study.plan.model)
    asked = await served.turn.opinions_for(study, host, limit=most)
    if not asked:
        return None
    served.changes.compared += [
        replace(one, state=ComparisonState.LEASED, lease_id=lease_id) for one in asked
    ]
    places = [(one.row, one.position) for one in asked]
    return _granted(served, lease_id, exchange, request, places, compares=True)


def new_id(now: float) -> str:
    """Return a lease's id that nobody guesses and that sorts after those of earlier leases.

    So an index has the leases of today on a few pages, which are at hand, and not on any of them.
    """
    return f"{int(now * 1e6):016x}{token_hex(8)}"


def _granted(
    served: ServedStudy,
    lease_id: str,
    exchange: Exchange,
    request: LeaseRequest,
    places: Sequence[Place],
    *,
    compares: bool = False,
) -> Grant:
    """Return an open lease of instances at `places`; it gets its fence when it is written."""
    study = served.study
    assert study is not None
    lease = Lease(
        id=lease_id,
        fence=0,
        worker=request.worker.id,
        study=study.id,
        state=LeaseState.OPEN,
        expires_at=expiry(exchange.now, exchange.ttl),
        instances=tuple(places),
        host_class=request.host_class(study.plan.model),
        host=request.worker.host,
        compares=compares,
    )
    served.changes.granted.append(lease)
    return Grant(lease=lease, study=study)


def _waiting(place: Place, host_class: str) -> Instance:
    """Return an instance of a row that has just begun."""
    return Instance(
        row=place[0],
        position=place[1],
        state=InstanceState.PENDING,
        lease=None,
        attempts={},
        host_class=host_class,
    )
