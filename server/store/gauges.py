"""Numbers about the whole coordinator at one moment."""

from collections import Counter
from dataclasses import dataclass

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from server.states import InstanceState, LeaseState, StudyState
from server.store.database.schema import (
    close_loops,
    comparisons,
    estimator_states,
    leases,
    studies,
    workers,
)


@dataclass(frozen=True, kw_only=True)
class Gauges:
    """What is where."""

    #: Studies by state.
    studies: dict[str, int]
    #: Instances by state, of studies neither complete nor cancelled.
    instances: dict[str, int]
    #: Final failures by outcome, of all studies.
    failures: dict[str, int]
    workers: int
    open_leases: int
    #: Seconds since the oldest open lease was granted; 0 if there is none.
    oldest_lease: float
    #: Second opinions by state.
    comparisons: dict[str, int]
    #: Results that no estimator has taken in.
    lag: int
    #: Jobs that close the loop on a session, by state.
    close_loops: dict[str, int]


def read(connection: Connection, *, now: float, heard_after: float) -> Gauges:
    """Count; as cheap as there are few studies.

    Workers silent since `heard_after` are gone.
    """
    found = connection.execute(
        sa.select(
            studies.c.state,
            studies.c.instances,
            studies.c.result_count,
            studies.c.ok_count,
            studies.c.leased,
            studies.c.failures,
            sa.func.coalesce(estimator_states.c.cursor, 0).label("cursor"),
        ).select_from(studies.outerjoin(estimator_states))
    ).all()
    count, oldest = connection.execute(
        sa.select(sa.func.count(), sa.func.min(leases.c.granted_at)).where(
            leases.c.state == LeaseState.OPEN
        )
    ).one()
    alive = sa.select(sa.func.count()).where(workers.c.last_seen > heard_after)
    active = [row for row in found if not StudyState(row.state).has_ended]
    failures: Counter[str] = Counter()
    for row in found:
        failures.update(row.failures)
    return Gauges(
        studies=dict(Counter(row.state for row in found)),
        instances={
            InstanceState.PENDING: sum(r.instances - r.result_count - r.leased for r in active),
            InstanceState.LEASED: sum(row.leased for row in active),
            "ok": sum(row.ok_count for row in active),
            "failed": sum(row.result_count - row.ok_count for row in active),
        },
        failures=dict(failures),
        workers=connection.scalar(alive) or 0,
        open_leases=count,
        oldest_lease=max(0.0, now - oldest) if oldest is not None else 0.0,
        comparisons=_by_state(connection, comparisons),
        lag=sum(max(0, row.result_count - row.cursor) for row in found),
        close_loops=_by_state(connection, close_loops),
    )


def _by_state(connection: Connection, table: sa.Table) -> dict[str, int]:
    query = sa.select(table.c.state, sa.func.count()).group_by(table.c.state)
    return dict(connection.execute(query).all())
