"""Leasing: a worker that asks is given instances of one study."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from math import inf
from secrets import token_hex

from sqlalchemy.engine import Connection

from server.logic.fleet.comparisons import GATHER_SECONDS
from server.logic.fleet.hosts import host_class, identity, objection_to_worker
from server.logic.fleet.leases import expiry
from server.logic.study.instances import may_try
from server.logic.study.studies import handed_out, new_rows
from server.records import Instance, Introduction, Lease, Place, Study, record
from server.states import InstanceState, LeaseState, StudyState
from server.store.fleet import comparisons, leases, workers
from server.store.study import instances, studies


@dataclass(frozen=True, kw_only=True)
class LeaseRequest:
    """Who asks for instances, and for which."""

    worker: Introduction
    models: Sequence[str]
    max_instances: int

    def host_class(self, model: str = "") -> str:
        """The kind of machine that asks, as far as it matters to a model, "name@digest"."""
        return host_class(self.worker.versions, self.worker.models.get(model, ""))


@dataclass(frozen=True, kw_only=True)
class Ineligible:
    """There is work, but none that the worker may have."""

    why: str


class Deferred:
    """The request must be answered in a transaction of its own."""


@record
class Grant:
    """A new lease and the study its instances belong to."""

    lease: Lease
    study: Study


def grant(
    connection: Connection,
    request: LeaseRequest,
    *,
    now: float,
    ttl: float,
    locked: Study | None = None,
    done: int = 0,
) -> Grant | Ineligible | Deferred | None:
    """Lease instances of one study that the worker may have: highest priority, then oldest.

    Second opinions that other hosts' results have waited for some seconds go first: they are few,
    and the sooner a host is found out, the better. Others wait until there is nothing else: one at
    a time they would cost more requests than the rest of the work. Of results, those in begun rows
    go first, so that rows are finished before new ones are begun.

    Args:
        locked: the study that the transaction has locked, as it is now; None if there is none.
        done: final results that the worker has brought in the transaction.

    Returns:
        The lease of 1 to `max_instances` instances; None if there is nothing to do; Ineligible if
        there is work but none for this worker; Deferred if another transaction must look, since
        whoever locked two studies out of their order could wait for somebody who waits for it.
    """
    objection: str | None = None
    granted: Grant | None = None
    deferred = False
    waiting = _comparing(connection, request, asked_by=now - GATHER_SECONDS)
    work = studies.with_work(connection, request.models, known=locked)
    if not waiting and (first := next(work, None)) is not None:
        work = chain((first,), work)
    else:
        # If another worker is faster with a second opinion, this one asks again.
        work = iter(waiting := waiting or _comparing(connection, request, asked_by=inf))
    for candidate in work:
        unfit = objection_to_worker(candidate, request.worker)
        if unfit is not None:
            objection = objection or unfit
            continue
        if locked is None:
            study = studies.locked(connection, candidate)
        elif locked.id == candidate.id:
            study, locked = locked, None
        else:
            deferred = True
            break
        lease_instances = _lease_comparisons if waiting else _lease_instances
        granted = lease_instances(connection, study, request, now, ttl)
        if granted is not None:
            break
    workers.introduce(
        connection, request.worker, host_class=request.host_class(), done=done, now=now
    )
    if deferred:
        return Deferred()
    if granted is not None:
        return replace(granted, lease=leases.add(connection, granted.lease, now))
    return None if objection is None else Ineligible(why=objection)


def _comparing(connection: Connection, request: LeaseRequest, *, asked_by: float) -> list[Study]:
    """Return the first study in which this worker's second opinion was asked for by then, if any.

    First the few that are waiting are looked for, so that it costs nothing while there are none.
    """
    host = request.worker.host
    for study_id in comparisons.studies_waiting(connection, host=host, asked_by=asked_by):
        study = studies.find(connection, study_id)
        if (
            (study.state.is_served or study.state == StudyState.COMPLETE)
            and study.plan.model in request.models
            and objection_to_worker(study, request.worker) is None
        ):
            return [study]
    return []


def _lease_instances(
    connection: Connection, study: Study, request: LeaseRequest, now: float, ttl: float
) -> Grant | None:
    """Hand out instances of a locked study; None if it has none for this kind of machine."""
    if not study.state.is_served:
        return None
    if objection_to_worker(study, request.worker) is not None:
        return None
    lease_id = new_id(now)
    mine = request.host_class(study.plan.model)
    again = _returned(connection, study, request, now) if study.returned else []
    unbound = {one.row for one in again if one.host_class is None}
    again = [
        replace(one, state=InstanceState.LEASED, lease=lease_id, host_class=mine) for one in again
    ]
    wanted = request.max_instances - len(again) if study.state == StudyState.RUNNING else 0
    begun, fresh = new_rows(study, wanted)
    if not again and not fresh:
        return None
    for places, holder in ((begun[:fresh], lease_id), (begun[fresh:], None)):
        instances.begin(connection, study.id, places, lease=holder, host_class=mine)
    instances.move(connection, study.id, again)
    instances.bind(connection, study.id, unbound, mine)
    updated = handed_out(
        study,
        begun=len(begun),
        leased=len(again) + fresh,
        identity=identity(request.worker.versions),
    )
    studies.save(connection, updated, counted=study.identity is not None)
    places = [*((one.row, one.position) for one in again), *begun[:fresh]]
    return as_granted(updated, lease_id, request, places, expiry(now, ttl))


def _returned(
    connection: Connection, study: Study, request: LeaseRequest, now: float
) -> list[Instance]:
    """Return instances of begun rows that wait for a machine and may go to this one."""
    mine, host, most = (
        request.host_class(study.plan.model),
        request.worker.host,
        request.max_instances,
    )
    at_work = workers.hosts_at_work(connection, study.id, host_class=mine, now=now)
    pending = partial(instances.pending, connection, study.id, host_class=mine, host=host)
    if not at_work - {host}:
        return pending(limit=most)
    found = pending(tried=False, limit=most)
    if len(found) < most:
        tried = pending(tried=True, limit=instances.IN_LIST)
        found += [one for one in tried if may_try(one, host, at_work)]
    return found[:most]


def _lease_comparisons(
    connection: Connection, study: Study, request: LeaseRequest, now: float, ttl: float
) -> Grant | None:
    """Hand out a locked study's results to be computed again; None if somebody was faster."""
    lease_id = new_id(now)
    places = comparisons.hand_out(
        connection, study.id, host=request.worker.host, lease=lease_id, limit=request.max_instances
    )
    if not places:
        return None
    return as_granted(study, lease_id, request, places, expiry(now, ttl), compares=True)


def new_id(now: float) -> str:
    """Return a lease's id that nobody guesses and that sorts after those of earlier leases.

    So an index has the leases of today on a few pages, which are at hand, and not on any of them.
    """
    return f"{int(now * 1e6):016x}{token_hex(8)}"


def as_granted(
    study: Study,
    lease_id: str,
    request: LeaseRequest,
    places: Sequence[Place],
    until: float,
    *,
    compares: bool = False,
) -> Grant:
    """Return an open lease of instances at `places`; it gets its fence when it is stored."""
    lease = Lease(
        id=lease_id,
        fence=0,
        worker=request.worker.id,
        study=study.id,
        state=LeaseState.OPEN,
        expires_at=until,
        instances=tuple(places),
        host_class=request.host_class(study.plan.model),
        host=request.worker.host,
        compares=compares,
    )
    return Grant(lease=lease, study=study)
