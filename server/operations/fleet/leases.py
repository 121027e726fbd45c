"""Leases that were granted: keeping them, and taking back what nobody works on any more."""

from contextlib import suppress
from enum import Enum, auto
from math import inf

from sqlalchemy.engine import Engine

from server.errors import ConflictError, NotFoundError
from server.logic.fleet.comparisons import put_back
from server.logic.fleet.leases import (
    expiry,
    objection_to_release,
    objection_to_renewal,
    went_unheard,
)
from server.logic.study.instances import after_attempt, handed_back, held, unheard
from server.operations.fleet.served import ServedStudy
from server.records import Instance, Lease, Place, Result, Study
from server.states import ComparisonState, LeaseState, Outcome
from server.store import close_loops
from server.store.database.engine import alone_at, reading, writing
from server.store.fleet import leases, workers
from server.store.fleet.turns import Seen, Turn, at_once, turn_within
from server.store.study import studies


class Ended(Enum):
    """How a lease ended before all that it held was done."""

    #: By its worker, which counts against nothing.
    RELEASED = auto()
    #: By silence, which counts against what it held.
    LOST = auto()
    #: Its worker never heard of it.
    UNHEARD = auto()


def renew(engine: Engine, lease_id: str, *, fence: int, now: float, ttl: float) -> float:
    """Extend a lease and return when it expires now.

    Raises:
        ConflictError: the lease has ended, or never was the bearer's.
    """
    until = expiry(now, ttl)
    with writing(engine) as connection:
        lease = leases.find(connection, lease_id)
        if lease is not None:
            # First, as in turns: see `Changes.statements`.
            workers.heard_from(connection, lease.worker, now=now)
            lease = leases.find(connection, lease_id, lock=True)
        objection = objection_to_renewal(lease, fence=fence, now=now)
        if lease is None or objection is not None:
            raise ConflictError(f"lease {lease_id!r} cannot be renewed: {objection}")
        # It may have waited since `now`, while all were extended.
        until = max(until, lease.expires_at)
        leases.extend(connection, lease, now=now, until=until)
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
        lease = leases.find(connection, lease_id)
        if lease is not None and lease.state == LeaseState.OPEN:
            at_once(_end_lease(turn_within(connection), study, lease, Ended.RELEASED, now=now))


def reap(engine: Engine, *, now: float, ttl: float) -> int:
    """Take back what expired leases still hold; returns how many instances that were.

    They count as lost if the worker is silent, and not if it never heard of its lease. 0 if another
    coordinator is at it.
    """
    with alone_at(engine, "sweep") as mine:
        return _reap(engine, now, ttl) if mine else 0


def _reap(engine: Engine, now: float, ttl: float) -> int:
    with reading(engine) as connection:
        concerned = leases.studies_with_expired(connection, now=now)
    lost = 0
    for study_id in concerned:
        with writing(engine) as connection:
            study = studies.find(connection, study_id, lock=True)
            for lease, last_seen in leases.expired(connection, study_id, now=now):
                turn, ended = turn_within(connection), Ended.LOST
                if went_unheard(lease, last_seen=last_seen, ttl=ttl):
                    ended = Ended.UNHEARD
                study, count = at_once(_end_lease(turn, study, lease, ended, now=now))
                lost += count
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
    with reading(engine) as connection:
        concerned = leases.studies_with_expired(connection, now=inf)
    for study_id in concerned:
        # Another coordinator may be in the midst of a turn, or have deleted it.
        with suppress(NotFoundError), writing(engine) as connection:
            studies.find(connection, study_id, lock=True)
            leases.extend_open(connection, study_id, until=expiry(now, ttl))
    with writing(engine) as connection:
        close_loops.extend_open(connection, until=expiry(now, ttl))


async def _end_lease(
    turn: Turn, study: Study, lease: Lease, ended: Ended, *, now: float
) -> tuple[Study, int]:
    """End an open lease of a locked study: what it holds waits again.

    Returns:
        The study as it is now, and how many instances came back.
    """
    rows = await turn.rows(study, {row for row, _ in lease.instances})
    served = ServedStudy(turn, study, Seen(rows=rows))
    served.begin(now)
    changes = served.changes
    lost = ended == Ended.LOST
    released = ended == Ended.RELEASED
    changes.ended[LeaseState.RELEASED if released else LeaseState.EXPIRED] = [lease.id]
    asked = await turn.opinions_of(lease) if lease.compares else ()
    changes.compared += [
        put_back(one, counted=lost) for one in asked if one.state == ComparisonState.LEASED
    ]
    after: dict[Place, Instance] = {}
    filed: list[Result] = []
    mine = held(rows, lease=lease.id)
    if lost:
        at_work = await served.at_work(study, lease.host_class)
        reason = f"lost with lease {lease.id} of worker {lease.worker}, which fell silent"
        for place, one in mine.items():
            after[place], final = after_attempt(
                one, cause=Outcome.LOST, reason=reason, host=lease.host, at_work=at_work
            )
            if final is not None:
                filed.append(final)
    elif released:
        after = {place: handed_back(one) for place, one in mine.items()}
        changes.heard[lease.worker] = 0
    else:
        after = {place: unheard(one, lease.host) for place, one in mine.items()}
    await served.apply(study, lease, before=rows, after=after, filed=filed)
    await served.write()
    return served.study or study, len(mine)
