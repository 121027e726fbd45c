"""Leases: handing instances out, and taking back what nobody works on any more."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any
from uuid import uuid4

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine

from server.errors import ConflictError
from server.logic.hosts import host_class, identity, objection_to_worker
from server.logic.leases import (
    Lease,
    expiry,
    objection_to_release,
    objection_to_renewal,
)
from server.logic.slots import Slot, after_attempt, handed_back
from server.logic.study import Study
from server.store import comparisons, ledger, studies, workers
from server.store.engine import reading, writing
from server.store.schema import leases

# Built once: see `server.store.ledger`.
_FIND = sa.select(leases).where(leases.c.id == sa.bindparam("of_lease"))
_FIND_LOCKED = _FIND.with_for_update()
_FILE = sa.insert(leases).returning(leases.c.fence)
_EXTEND = (
    sa.update(leases)
    .where(
        leases.c.id == sa.bindparam("of_lease"),
        leases.c.state == "open",
        leases.c.expires_at > sa.bindparam("now"),
    )
    .values(expires_at=sa.bindparam("until"))
)
_END = (
    sa.update(leases)
    .where(leases.c.id == sa.bindparam("of_lease"), leases.c.state == "open")
    .values(state=sa.bindparam("to_state"))
)
_CONCERNED_BY_EXPIRY = (
    sa.select(leases.c.study_id)
    .where(leases.c.state == "open", leases.c.expires_at <= sa.bindparam("now"))
    .distinct()
)


@dataclass(frozen=True, kw_only=True)
class Grant:
    """A new lease and the study its instances belong to."""

    lease: Lease
    study: Study


def grant(
    engine: Engine,
    *,
    worker: str,
    host: str,
    versions: Mapping[str, str],
    models: Sequence[str],
    max_instances: int,
    now: float,
    ttl: float,
    tags: Sequence[str] = (),
) -> Grant | None:
    """Lease instances of one running study that the worker fits: highest priority, then oldest.

    Second opinions that other hosts' results wait for go first: they are few, and the sooner a
    host is found out, the better. Of results, those in begun rows go first, so that rows are
    finished before new ones are begun.

    Returns:
        The lease of 1 to `max_instances` instances; None if there is nothing to do.

    Raises:
        ConflictError: there is work, but none that this worker fits; the message says why.
    """
    objection: str | None = None
    with writing(engine) as connection:
        granted: Grant | None = None
        waiting = [
            study
            for study in comparisons.studies_waiting(connection, models, host=host)
            if objection_to_worker(study, versions=versions, tags=tags) is None
        ]
        if waiting:
            # If another worker is faster this one asks again: who locked two studies out of their
            # order could wait for somebody who waits for it.
            granted = _comparisons_of(
                connection, waiting[0], worker, host, versions, max_instances, now, ttl
            )
        for candidate in [] if waiting else studies.with_work(connection, models):
            unfit = objection_to_worker(candidate, versions=versions, tags=tags)
            if unfit is not None:
                objection = objection or unfit
                continue
            granted = _grant_of(
                connection, candidate, worker, host, versions, max_instances, now, ttl
            )
            if granted is not None:
                break
        workers.introduce(connection, worker, host=host, versions=versions, tags=tags, now=now)
        if granted is not None:
            return replace(granted, lease=_file(connection, granted.lease, now))
    if objection is not None:
        raise ConflictError(objection)
    return None


def _grant_of(
    connection: Connection,
    candidate: Study,
    worker: str,
    host: str,
    versions: Mapping[str, str],
    max_instances: int,
    now: float,
    ttl: float,
) -> Grant | None:
    """Hand out instances of one study; None if it has none for this kind of machine."""
    study = studies.locked(connection, candidate)
    mine = host_class(versions)
    if study.state not in ("running", "draining"):
        return None
    if objection_to_worker(study, versions=versions, tags=study.tags) is not None:
        return None
    lease_id = uuid4().hex
    again: list[Slot] = []
    if study.returned:
        shunned = workers.others_at_work(connection, study.id, host=host, host_class=mine, now=now)
        again = ledger.waiting(
            connection,
            study,
            host_class=mine,
            avoided_by=host if shunned else None,
            limit=max_instances,
        )
    unbound = {slot.row for slot in again if slot.host_class is None}
    again = [replace(slot, state="leased", lease=lease_id, host_class=mine) for slot in again]
    wanted = max_instances - len(again) if study.state == "running" else 0
    begun = _new_rows(study, lease_id, mine, wanted)
    fresh = [slot for slot in begun if slot.state == "leased"]
    if not again and not fresh:
        return None
    if study.identity is None:
        study = replace(study, identity=identity(versions))
    study = ledger.hand_out(
        connection, study, begun=begun, again=again, unbound=unbound, host_class=mine
    )
    places = [(slot.row, slot.position) for slot in [*again, *fresh]]
    return _granted(study, lease_id, worker, places, mine, expiry(now, ttl))


def _comparisons_of(
    connection: Connection,
    candidate: Study,
    worker: str,
    host: str,
    versions: Mapping[str, str],
    max_instances: int,
    now: float,
    ttl: float,
) -> Grant | None:
    """Hand out results of other hosts to be computed again; None if somebody was faster."""
    study = studies.locked(connection, candidate)
    lease_id = uuid4().hex
    places = comparisons.hand_out(connection, study, host=host, lease=lease_id, limit=max_instances)
    if not places:
        return None
    mine, until = host_class(versions), expiry(now, ttl)
    return _granted(study, lease_id, worker, places, mine, until, compares=True)


def _granted(
    study: Study,
    lease_id: str,
    worker: str,
    places: Sequence[ledger.Place],
    host_class: str,
    until: float,
    *,
    compares: bool = False,
) -> Grant:
    """Return an open lease of instances at `places`; it gets its fence when it is stored."""
    lease = Lease(
        id=lease_id,
        fence=0,
        worker=worker,
        study=study.id,
        state="open",
        expires_at=until,
        instances=tuple(places),
        host_class=host_class,
        compares=compares,
    )
    return Grant(lease=lease, study=study)


def _new_rows(study: Study, lease_id: str, host_class: str, count: int) -> list[Slot]:
    """Return every slot of as many new rows as `count` instances take, the first ones leased."""
    width = study.plan.width
    first = study.handed_out
    count = min(count, study.plan.instances - first)
    whole = -(-count // width) * width
    slots = []
    for number in range(first, first + whole):
        row, position = divmod(number, width)
        leased = number < first + count
        slots.append(
            Slot(
                row=row,
                position=position,
                state="leased" if leased else "pending",
                lease=lease_id if leased else None,
                attempts={},
                host_class=host_class,
            )
        )
    return slots


def _file(connection: Connection, lease: Lease, now: float) -> Lease:
    """Store a new lease and return it with its fence."""
    values = {
        "id": lease.id,
        "worker_id": lease.worker,
        "study_id": lease.study,
        "state": lease.state,
        "granted_at": now,
        "expires_at": lease.expires_at,
        "instances": lease.instances,
        "host_class": lease.host_class,
        "compares": lease.compares,
    }
    fence = connection.scalar(_FILE, values)
    return replace(lease, fence=int(fence or 0))


def renew(engine: Engine, lease_id: str, *, fence: int, now: float, ttl: float) -> float:
    """Extend a lease and return when it expires now.

    Raises:
        ConflictError: the lease has ended, or never was the bearer's.
    """
    with writing(engine) as connection:
        lease = find(connection, lease_id, lock=True)
        objection = objection_to_renewal(lease, fence=fence, now=now)
        if lease is None or objection is not None:
            raise ConflictError(f"lease {lease_id!r} cannot be renewed: {objection}")
        extend(connection, lease, now=now, ttl=ttl)
        workers.heard_from(connection, lease.worker, now=now)
    return expiry(now, ttl)


def release(engine: Engine, lease_id: str, *, fence: int, now: float) -> None:
    """Take back unharmed what a lease still holds; does nothing if it has ended.

    Raises:
        ConflictError: the lease never was the bearer's.
    """
    with reading(engine) as connection:
        lease = find(connection, lease_id)
    objection = objection_to_release(lease, fence=fence)
    if lease is None or objection is not None:
        raise ConflictError(f"lease {lease_id!r} cannot be released: {objection}")
    with writing(engine) as connection:
        study = studies.find(connection, lease.study, lock=True)
        if not end(connection, lease, "released"):
            return
        if lease.compares:
            comparisons.let_go(connection, lease, counted=False)
        before = held(connection, study, lease)
        after = {place: handed_back(slot) for place, slot in before.items()}
        ledger.settle(connection, study, before=before, after=after, filed=(), now=now)
        workers.heard_from(connection, lease.worker, now=now)


def reap(engine: Engine, *, now: float) -> int:
    """Take back what expired leases still hold, as lost; returns how many instances that were."""
    run_out = sa.and_(leases.c.state == "open", leases.c.expires_at <= now)
    with reading(engine) as connection:
        concerned = connection.scalars(_CONCERNED_BY_EXPIRY, {"now": now}).all()
    lost = 0
    for study_id in concerned:
        with writing(engine) as connection:
            study = studies.find(connection, study_id, lock=True)
            query = sa.select(leases).where(run_out, leases.c.study_id == study_id)
            query = query.order_by(leases.c.fence).with_for_update()
            for row in connection.execute(query).all():
                lease = _lease(row)
                end(connection, lease, "expired")
                if lease.compares:
                    comparisons.let_go(connection, lease, counted=True)
                before = held(connection, study, lease)
                study = _lose(connection, study, lease, before, now)
                lost += len(before)
    return lost


def excuse_silence(engine: Engine, *, now: float, ttl: float) -> None:
    """Let every open lease end a ttl from now.

    A coordinator that was away cannot tell whose worker is gone. If its clock was set back
    meanwhile, a lease would otherwise last for as much longer.
    """
    with writing(engine) as connection:
        connection.execute(
            sa.update(leases).where(leases.c.state == "open").values(expires_at=expiry(now, ttl))
        )


def find(connection: Connection, lease_id: str, *, lock: bool = False) -> Lease | None:
    """Return a lease within a transaction; None if there is none of that id."""
    query = _FIND_LOCKED if lock else _FIND
    row = connection.execute(query, {"of_lease": lease_id}).one_or_none()
    return None if row is None else _lease(row)


def extend(connection: Connection, lease: Lease, *, now: float, ttl: float) -> None:
    """Let a lease last `ttl` seconds from `now`, unless it has ended."""
    until = expiry(now, ttl)
    connection.execute(_EXTEND, {"of_lease": lease.id, "now": now, "until": until})


def end(connection: Connection, lease: Lease, state: str) -> bool:
    """Close a lease; False if it was closed before."""
    closed = connection.execute(_END, {"of_lease": lease.id, "to_state": state})
    return closed.rowcount == 1


def held(connection: Connection, study: Study, lease: Lease) -> dict[ledger.Place, Slot]:
    """Return the instances a lease holds still."""
    return ledger.held(connection, study, lease.instances, lease=lease.id)


def _lose(
    connection: Connection,
    study: Study,
    lease: Lease,
    before: Mapping[ledger.Place, Slot],
    now: float,
) -> Study:
    """Count instances as lost once more; returns the study as it is now."""
    after: dict[ledger.Place, Slot] = {}
    filed: list[ledger.Filed] = []
    host = workers.host_of(connection, lease.worker)
    for place, slot in before.items():
        reason = f"lost with lease {lease.id} of worker {lease.worker}, which fell silent"
        after[place], final = after_attempt(slot, cause="lost", reason=reason, host=host)
        if final is not None:
            filed.append(ledger.Filed(result=final, worker=lease.worker))
    return ledger.settle(connection, study, before=before, after=after, filed=filed, now=now)


def _lease(row: Any) -> Lease:
    return Lease(
        id=row.id,
        fence=row.fence,
        worker=row.worker_id,
        study=row.study_id,
        state=row.state,
        expires_at=row.expires_at,
        instances=tuple((place[0], place[1]) for place in row.instances),
        host_class=row.host_class,
        compares=row.compares,
    )
