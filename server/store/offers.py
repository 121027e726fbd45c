"""What a worker that asks is given: instances of which study, and which of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto
from secrets import token_hex

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from server.logic.hosts import host_class, identity, objection_to_worker
from server.logic.leases import Lease, expiry
from server.logic.records import record
from server.logic.slots import Slot
from server.logic.study import Study
from server.store import comparisons, ledger, studies, workers
from server.store.prepared import Prepared, as_text
from server.store.schema import leases

# Built once: see `server.store.ledger`.
_FILE = Prepared(
    sa.insert(leases).returning(leases.c.fence),
    "id",
    "worker_id",
    "study_id",
    "state",
    "granted_at",
    "expires_at",
    "instances",
    "host_class",
    "compares",
)


@record
class Wish:
    """Who asks for instances, and for which."""

    worker: str
    host: str
    versions: Mapping[str, str]
    models: Sequence[str]
    max_instances: int
    tags: Sequence[str] = ()


@dataclass(frozen=True, kw_only=True)
class Misfit:
    """There is work, but none that the worker fits."""

    why: str


class Elsewhere(Enum):
    """Another transaction is to look for work."""

    ELSEWHERE = auto()


ELSEWHERE = Elsewhere.ELSEWHERE


@record
class Grant:
    """A new lease and the study its instances belong to."""

    lease: Lease
    study: Study


def offer(
    connection: Connection,
    wish: Wish,
    *,
    now: float,
    ttl: float,
    locked: Study | None = None,
    done: int = 0,
) -> Grant | Misfit | Elsewhere | None:
    """Lease instances of one running study that the worker fits: highest priority, then oldest.

    Second opinions that other hosts' results wait for go first: they are few, and the sooner a
    host is found out, the better. Of results, those in begun rows go first, so that rows are
    finished before new ones are begun.

    Args:
        connection: a transaction.
        wish: who asks, and for what.
        now: seconds, UTC epoch.
        ttl: seconds until the lease expires.
        locked: the study that the transaction has locked, as it is now; None if there is none.
        done: final results that the worker has brought in the transaction.

    Returns:
        The lease of 1 to `max_instances` instances; None if there is nothing to do; Misfit if there
        is work but none that this worker fits; ELSEWHERE if another transaction is to look, since
        who locked two studies out of their order could wait for somebody who waits for it.
    """
    objection: str | None = None
    granted: Grant | None = None
    elsewhere = False
    waiting = [
        study
        for study in comparisons.studies_waiting(connection, wish.models, host=wish.host)
        if objection_to_worker(study, versions=wish.versions, tags=wish.tags) is None
    ]
    # If another worker is faster with a second opinion, this one asks again.
    candidates = waiting[:1] or studies.with_work(connection, wish.models, known=locked)
    for candidate in candidates:
        unfit = objection_to_worker(candidate, versions=wish.versions, tags=wish.tags)
        if unfit is not None:
            objection = objection or unfit
            continue
        if locked is None:
            study = studies.locked(connection, candidate)
        elif locked.id == candidate.id:
            study, locked = locked, None
        else:
            elsewhere = True
            break
        serve = _comparisons_of if waiting else _grant_of
        granted = serve(connection, study, wish, now, ttl)
        if granted is not None:
            break
    workers.introduce(
        connection,
        wish.worker,
        host=wish.host,
        versions=wish.versions,
        tags=wish.tags,
        done=done,
        now=now,
    )
    if elsewhere:
        return ELSEWHERE
    if granted is not None:
        return replace(granted, lease=_file(connection, granted.lease, now))
    return None if objection is None else Misfit(why=objection)


def _grant_of(
    connection: Connection, study: Study, wish: Wish, now: float, ttl: float
) -> Grant | None:
    """Hand out instances of a locked study; None if it has none for this kind of machine."""
    mine = host_class(wish.versions)
    if study.state not in ("running", "draining"):
        return None
    if objection_to_worker(study, versions=wish.versions, tags=study.tags) is not None:
        return None
    lease_id = _new_id(now)
    again: list[Slot] = []
    if study.returned:
        at_work = workers.hosts_at_work(connection, study.id, host_class=mine, now=now)
        again = ledger.waiting(
            connection,
            study,
            host_class=mine,
            host=wish.host,
            at_work=at_work,
            limit=wish.max_instances,
        )
    unbound = {slot.row for slot in again if slot.host_class is None}
    again = [replace(slot, state="leased", lease=lease_id, host_class=mine) for slot in again]
    wanted = wish.max_instances - len(again) if study.state == "running" else 0
    begun, fresh = _new_rows(study, wanted)
    if not again and not fresh:
        return None
    study = ledger.hand_out(
        connection,
        study,
        lease=lease_id,
        begun=begun,
        fresh=fresh,
        again=again,
        unbound=unbound,
        host_class=mine,
        identity=identity(wish.versions),
    )
    places = [*((slot.row, slot.position) for slot in again), *begun[:fresh]]
    return _granted(study, lease_id, wish, places, expiry(now, ttl))


def _comparisons_of(
    connection: Connection, study: Study, wish: Wish, now: float, ttl: float
) -> Grant | None:
    """Hand out a locked study's results to be computed again; None if somebody was faster."""
    lease_id = _new_id(now)
    places = comparisons.hand_out(
        connection, study, host=wish.host, lease=lease_id, limit=wish.max_instances
    )
    if not places:
        return None
    return _granted(study, lease_id, wish, places, expiry(now, ttl), compares=True)


def _new_id(now: float) -> str:
    """Return a lease's id that nobody guesses and that sorts after those of earlier leases.

    So an index has the leases of today on a few pages, which are at hand, and not on any of them.
    """
    return f"{int(now * 1e6):016x}{token_hex(8)}"


def _granted(
    study: Study,
    lease_id: str,
    wish: Wish,
    places: Sequence[ledger.Place],
    until: float,
    *,
    compares: bool = False,
) -> Grant:
    """Return an open lease of instances at `places`; it gets its fence when it is stored."""
    lease = Lease(
        id=lease_id,
        fence=0,
        worker=wish.worker,
        study=study.id,
        state="open",
        expires_at=until,
        instances=tuple(places),
        host_class=host_class(wish.versions),
        host=wish.host,
        compares=compares,
    )
    return Grant(lease=lease, study=study)


def _new_rows(study: Study, count: int) -> tuple[list[ledger.Place], int]:
    """Return the places in as many new rows as `count` instances take, and how many are wanted."""
    width = study.plan.width
    first = study.handed_out
    count = min(count, study.plan.instances - first)
    whole = -(-count // width) * width
    return [divmod(number, width) for number in range(first, first + whole)], count


def _file(connection: Connection, lease: Lease, now: float) -> Lease:
    """Store a new lease and return it with its fence."""
    (fence,) = _FILE.execute(
        connection,
        lease.id,
        lease.worker,
        lease.study,
        lease.state,
        now,
        lease.expires_at,
        as_text(lease.instances),
        lease.host_class,
        lease.compares,
    ).fetchone()
    return replace(lease, fence=int(fence))
