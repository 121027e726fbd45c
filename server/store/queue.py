"""Leases: granting and keeping them, and taking back what nobody works on any more."""

from collections.abc import Mapping, Sequence
from typing import Any

import sqlalchemy as sa
from pydantic_core import from_json
from sqlalchemy.engine import Connection, Engine

from server.errors import ConflictError
from server.logic.leases import (
    Lease,
    expiry,
    objection_to_release,
    objection_to_renewal,
)
from server.logic.slots import Result, Slot, after_attempt, handed_back
from server.logic.study import Study
from server.store import comparisons, ledger, offers, studies, workers
from server.store.engine import reading, writing
from server.store.prepared import Prepared, text
from server.store.schema import leases
from server.store.schema import workers as workers_table

# Built once: see `server.store.ledger`.
_LEASES = sa.select(
    leases.c.id,
    leases.c.fence,
    leases.c.worker_id,
    leases.c.study_id,
    leases.c.state,
    leases.c.expires_at,
    text(leases.c.instances),
    leases.c.host_class,
    workers_table.c.host,
    leases.c.compares,
).join(workers_table, workers_table.c.id == leases.c.worker_id)
_ONE = _LEASES.where(leases.c.id == sa.bindparam("of_lease"))
_FIND, _FIND_LOCKED = (
    Prepared(_ONE, "of_lease"),
    Prepared(_ONE.with_for_update(of=leases), "of_lease"),
)
_EXTEND = Prepared(
    sa.update(leases)
    .where(
        leases.c.id == sa.bindparam("of_lease"),
        leases.c.state == "open",
        leases.c.expires_at > sa.bindparam("now"),
    )
    .values(expires_at=sa.bindparam("until")),
    "of_lease",
    "now",
    "until",
)
_END = Prepared(
    sa.update(leases)
    .where(leases.c.id == sa.bindparam("of_lease"), leases.c.state == "open")
    .values(state=sa.bindparam("to_state")),
    "of_lease",
    "to_state",
)
_CONCERNED_BY_EXPIRY = (
    sa.select(leases.c.study_id)
    .where(leases.c.state == "open", leases.c.expires_at <= sa.bindparam("now"))
    .distinct()
)


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
) -> offers.Grant | None:
    """Lease instances as `offers.offer` does, in a transaction of their own.

    Returns:
        The lease of 1 to `max_instances` instances; None if there is nothing to do.

    Raises:
        ConflictError: there is work, but none that this worker fits; the message says why.
    """
    wish = offers.Wish(
        worker=worker,
        host=host,
        versions=versions,
        models=models,
        max_instances=max_instances,
        tags=tags,
    )
    with writing(engine) as connection:
        found = offers.offer(connection, wish, now=now, ttl=ttl)
    if isinstance(found, offers.Misfit):
        raise ConflictError(found.why)
    assert found is not offers.ELSEWHERE
    return found


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
        before = ledger.rows(connection, study, lease.instances)
        given_up = ledger.held(before, lease=lease.id)
        after = {place: handed_back(slot) for place, slot in given_up.items()}
        ledger.settle(
            connection, study, before=before, after=after, filed=(), worker=lease.worker, now=now
        )
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
            query = _LEASES.where(run_out, leases.c.study_id == study_id)
            query = query.order_by(leases.c.fence).with_for_update(of=leases)
            for row in connection.execute(query).all():
                lease = _lease(row)
                end(connection, lease, "expired")
                if lease.compares:
                    comparisons.let_go(connection, lease, counted=True)
                before = ledger.rows(connection, study, lease.instances)
                study = _lose(connection, study, lease, before, now)
                lost += len(ledger.held(before, lease=lease.id))
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
    row = query.execute(connection, lease_id).fetchone()
    return None if row is None else _lease(row)


def extend(connection: Connection, lease: Lease, *, now: float, ttl: float) -> None:
    """Let a lease last `ttl` seconds from `now`, unless it has ended."""
    _EXTEND.execute(connection, lease.id, now, expiry(now, ttl))


def end(connection: Connection, lease: Lease, state: str) -> bool:
    """Close a lease; False if it was closed before."""
    closed = _END.execute(connection, lease.id, state)
    return int(closed.rowcount) == 1


def _lose(
    connection: Connection,
    study: Study,
    lease: Lease,
    before: Mapping[ledger.Place, Slot],
    now: float,
) -> Study:
    """Count instances as lost once more; returns the study as it is now."""
    after: dict[ledger.Place, Slot] = {}
    filed: list[Result] = []
    at_work = workers.hosts_at_work(connection, study.id, host_class=lease.host_class, now=now)
    for place, slot in ledger.held(before, lease=lease.id).items():
        reason = f"lost with lease {lease.id} of worker {lease.worker}, which fell silent"
        after[place], final = after_attempt(
            slot, cause="lost", reason=reason, host=lease.host, at_work=at_work
        )
        if final is not None:
            filed.append(final)
    return ledger.settle(
        connection, study, before=before, after=after, filed=filed, worker=lease.worker, now=now
    )


def _lease(row: Sequence[Any]) -> Lease:
    """Return the lease that a row of `_LEASES` holds."""
    lease_id, fence, worker, study, state, expires_at, instances, host_class, host, compares = row
    return Lease(
        id=lease_id,
        fence=fence,
        worker=worker,
        study=study,
        state=state,
        expires_at=expires_at,
        instances=tuple(map(tuple, from_json(instances))),
        host_class=host_class,
        host=host,
        compares=bool(compares),
    )
