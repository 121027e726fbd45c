"""Numbers about the whole coordinator at one moment."""

from collections import Counter
from dataclasses import dataclass

import sqlalchemy as sa
from sqlalchemy.engine import Engine

from server.store.engine import reading
from server.store.schema import close_loops, comparisons, estimator_states, leases, studies, workers

#: A worker without work asks every second: one silent for so long is gone.
GONE_SECONDS = 60.0


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
    #: Second opinions by what became of them.
    comparisons: dict[str, int]
    #: Results that no estimator has taken in.
    lag: int
    #: Jobs that close the loop on a session, by state.
    close_loops: dict[str, int]


def read(engine: Engine, *, now: float) -> Gauges:
    """Count, from one consistent state; as cheap as there are few studies."""
    with reading(engine) as connection:
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
                leases.c.state == "open"
            )
        ).one()
        alive = connection.scalar(
            sa.select(sa.func.count()).where(workers.c.last_seen > now - GONE_SECONDS)
        )
        opinions = connection.execute(
            sa.select(comparisons.c.state, sa.func.count().label("n")).group_by(comparisons.c.state)
        ).all()
        loops = connection.execute(
            sa.select(close_loops.c.state, sa.func.count().label("n")).group_by(close_loops.c.state)
        ).all()
    active = [row for row in found if row.state in ("running", "draining", "paused")]
    failures: Counter[str] = Counter()
    for row in found:
        failures.update(row.failures)
    return Gauges(
        studies=dict(Counter(row.state for row in found)),
        instances={
            "pending": sum(row.instances - row.result_count - row.leased for row in active),
            "leased": sum(row.leased for row in active),
            "ok": sum(row.ok_count for row in active),
            "failed": sum(row.result_count - row.ok_count for row in active),
        },
        failures=dict(failures),
        workers=alive or 0,
        open_leases=count,
        oldest_lease=max(0.0, now - oldest) if oldest is not None else 0.0,
        comparisons={row.state: row.n for row in opinions},
        lag=sum(max(0, row.result_count - row.cursor) for row in found),
        close_loops={row.state: row.n for row in loops},
    )
