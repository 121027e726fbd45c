"""Leases that were granted: keeping them, and taking back what nobody works on any more."""

from collections.abc import Mapping

from sqlalchemy.engine import Connection, Engine

from server.errors import ConflictError
from server.logic.fleet.leases import expiry, objection_to_release, objection_to_renewal
from server.logic.study.instances import after_attempt, handed_back, held
from server.operations.fleet import comparisons
from server.operations.study.instances import settle
from server.records import Instance, Lease, Place, Result, Study
from server.states import LeaseState, Outcome
from server.store import close_loops
from server.store.database.engine import alone_at, reading, writing
from server.store.fleet import leases, workers
from server.store.study import instances, studies


def renew(engine: Engine, lease_id: str, *, fence: int, now: float, ttl: float) -> float:
    """Extend a lease and return when it expires now.

    Raises:
        ConflictError: the lease has ended, or never was the bearer's.
    """
    until = expiry(now, ttl)
    with writing(engine) as connection:
        lease = leases.find(connection, lease_id, lock=True)
        objection = objection_to_renewal(lease, fence=fence, now=now)
        if lease is None or objection is not None:
            raise ConflictError(f"lease {lease_id!r} cannot be renewed: {objection}")
        leases.extend(connection, lease, now=now, until=until)
        workers.heard_from(connection, lease.worker, now=now)
    return until


def release(engine: Engine, lease_id: str, *, fence: int, now: float) -> None:
    """Take back unharmed what a lease still holds; does nothing if it has ended.

    Raises:
        ConflictError: the lease never was the bearer's.
    """
    with reading(engine) as connection:
        lease = leases.find(connection, lease_id)
    objection = objection_to_release(lease, fence=fence)
    if lease is None or objection is not None:
        raise ConflictError(f"lease {lease_id!r} cannot be released: {objection}")
    with writing(engine) as connection:
        study = studies.find(connection, lease.study, lock=True)
        if not leases.end(connection, lease, LeaseState.RELEASED):
            return
        if lease.compares:
            comparisons.let_go(connection, lease, counted=False)
        before = instances.in_rows(connection, study.id, lease.instances)
        after = {place: handed_back(one) for place, one in held(before, lease=lease.id).items()}
        settle(
            connection, study, before=before, after=after, filed=(), worker=lease.worker, now=now
        )
        workers.heard_from(connection, lease.worker, now=now)


def reap(engine: Engine, *, now: float) -> int:
    """Take back what expired leases still hold, as lost; returns how many instances that were.

    0 if another coordinator is at it.
    """
    with alone_at(engine, "sweep") as mine:
        return _reap(engine, now) if mine else 0


def _reap(engine: Engine, now: float) -> int:
    with reading(engine) as connection:
        concerned = leases.studies_with_expired(connection, now=now)
    lost = 0
    for study_id in concerned:
        with writing(engine) as connection:
            study = studies.find(connection, study_id, lock=True)
            for lease in leases.expired(connection, study_id, now=now):
                leases.end(connection, lease, LeaseState.EXPIRED)
                if lease.compares:
                    comparisons.let_go(connection, lease, counted=True)
                before = instances.in_rows(connection, study.id, lease.instances)
                study = _lose(connection, study, lease, before, now)
                lost += len(held(before, lease=lease.id))
    return lost


def latest(engine: Engine) -> float:
    """Return the latest moment that the coordinator is known to have lived through."""
    with reading(engine) as connection:
        return workers.latest(connection)


def extend_open_leases(engine: Engine, *, now: float, ttl: float) -> None:
    """Let every open lease, of instances and of close-loop jobs, end a ttl from now.

    A coordinator that was away cannot tell whose worker is gone. If its clock was set back
    meanwhile, a lease would otherwise last for as much longer.
    """
    with writing(engine) as connection:
        leases.extend_open(connection, until=expiry(now, ttl))
        close_loops.extend_open(connection, until=expiry(now, ttl))


def _lose(
    connection: Connection,
    study: Study,
    lease: Lease,
    before: Mapping[Place, Instance],
    now: float,
) -> Study:
    """Count instances as lost once more; returns the study as it is now."""
    after: dict[Place, Instance] = {}
    filed: list[Result] = []
    at_work = workers.hosts_at_work(connection, study.id, host_class=lease.host_class, now=now)
    for place, one in held(before, lease=lease.id).items():
        reason = f"lost with lease {lease.id} of worker {lease.worker}, which fell silent"
        after[place], final = after_attempt(
            one, cause=Outcome.LOST, reason=reason, host=lease.host, at_work=at_work
        )
        if final is not None:
            filed.append(final)
    return settle(
        connection, study, before=before, after=after, filed=filed, worker=lease.worker, now=now
    )
