"""Leases: every one ever granted, so that late results can still be told from forged ones."""

from collections.abc import Sequence
from typing import Any

import sqlalchemy as sa
from pydantic_core import from_json
from sqlalchemy.engine import Connection

from server.records import Lease
from server.states import LeaseState
from server.store.database.prepared import Prepared, text
from server.store.database.schema import leases, workers

_STATES = {state.value: state for state in LeaseState}

# Built once: see `server.store.study.studies`.
_EVERY = sa.select(
    *(leases.c[name] for name in ("id", "fence", "worker_id", "study_id", "state", "expires_at")),
    text(leases.c.instances),
    leases.c.host_class,
    workers.c.host,
    leases.c.compares,
).join(workers, workers.c.id == leases.c.worker_id)
_ONE = _EVERY.where(leases.c.id == sa.bindparam("of_lease"))
_FIND = Prepared(_ONE)
_FIND_LOCKED = Prepared(_ONE.with_for_update(of=leases))
_IS_OPEN = leases.c.state == LeaseState.OPEN
_EXTEND = Prepared(
    sa.update(leases)
    .where(
        leases.c.id == sa.bindparam("of_lease"), _IS_OPEN, leases.c.expires_at > sa.bindparam("now")
    )
    .values(expires_at=sa.bindparam("until"))
)
_WITH_EXPIRED = (
    sa.select(leases.c.study_id)
    .where(_IS_OPEN, leases.c.expires_at <= sa.bindparam("now"))
    .distinct()
)


def find(connection: Connection, lease_id: str, *, lock: bool = False) -> Lease | None:
    """Return a lease; None if there is none of that id."""
    query = _FIND_LOCKED if lock else _FIND
    row = query.execute(connection, lease_id).fetchone()
    return None if row is None else lease_of(row)


def extend(connection: Connection, lease: Lease, *, now: float, until: float) -> None:
    """Let a lease last until a moment, unless it has ended by `now`."""
    _EXTEND.execute(connection, until, lease.id, now)


def extend_open(connection: Connection, study_id: str, *, until: float) -> None:
    """Let every open lease of a study, which is locked, last until a moment."""
    here = sa.and_(_IS_OPEN, leases.c.study_id == study_id)
    connection.execute(sa.update(leases).where(here).values(expires_at=until))


def studies_with_expired(connection: Connection, *, now: float) -> Sequence[str]:
    """Return the studies with leases that have run out."""
    return connection.scalars(_WITH_EXPIRED, {"now": now}).all()


def expired(connection: Connection, study_id: str, *, now: float) -> list[tuple[Lease, float]]:
    """Return, locked, the leases of a study that have run out, in the order they were granted.

    Each with when its worker last said anything.
    """
    query = _EVERY.add_columns(workers.c.last_seen).where(
        _IS_OPEN, leases.c.expires_at <= now, leases.c.study_id == study_id
    )
    query = query.order_by(leases.c.fence).with_for_update(of=leases)
    return [(lease_of(row[:-1]), row.last_seen) for row in connection.execute(query).all()]


def workers_of(connection: Connection, study_id: str, *, now: float) -> int:
    """Return how many workers hold a lease of a study now."""
    query = sa.select(sa.func.count(leases.c.worker_id.distinct())).where(
        leases.c.study_id == study_id, _IS_OPEN, leases.c.expires_at > now
    )
    return connection.scalar(query) or 0


def lease_of(row: Sequence[Any]) -> Lease:
    """Return the lease that a row of `_EVERY` holds."""
    lease_id, fence, worker, study, state, expires_at, instances, host_class, host, compares = row
    return Lease(
        id=lease_id,
        fence=fence,
        worker=worker,
        study=study,
        state=_STATES[state],
        expires_at=expires_at,
        instances=tuple(map(tuple, from_json(instances))),
        host_class=host_class,
        host=host,
        compares=bool(compares),
    )


def held(connection: Connection) -> dict[str, int]:
    """Return how many instances each worker holds now, by worker."""
    found: dict[str, int] = {}
    query = sa.select(leases.c.worker_id, leases.c.instances).where(
        # As the index has it: see `server.store.study.instances`.
        leases.c.state == sa.literal_column("'open'")
    )
    for worker, instances in connection.execute(query):
        found[worker] = found.get(worker, 0) + len(instances)
    return found


def last_fence(connection: Connection) -> int:
    """Return the fence of the latest lease; 0 before the first."""
    return connection.scalar(sa.select(sa.func.max(leases.c.fence))) or 0


def lost_since(connection: Connection, fence: int) -> dict[str, int]:
    """Return how many leases beyond a fence each worker has let expire, by worker."""
    query = (
        sa.select(leases.c.worker_id, sa.func.count())
        .where(leases.c.fence > fence, leases.c.state == LeaseState.EXPIRED)
        .group_by(leases.c.worker_id)
    )
    return dict(connection.execute(query).all())
