"""What pages look at beyond what requests of clients do."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy.engine import Engine

from server.records import Study, Worker
from server.store import close_loops
from server.store.database.engine import alone_reading, reading
from server.store.fleet import leases, results, workers

every_close_loop = alone_reading(close_loops.every)
first_of_rows = alone_reading(results.first_of_rows)

#: Results at the end of a study's log among which failures are looked for, however many it has.
LATEST = 200_000
#: Results whose times say how long an evaluation takes.
TIMED = 500


def latest_failed(engine: Engine, study: Study, *, limit: int) -> list[dict[str, Any]]:
    """Return the latest failed results of a study, with worker and host."""
    if study.result_count == study.ok_count:
        return []
    with reading(engine) as connection:
        after = max(0, study.result_count - LATEST)
        return results.latest_failed(connection, study.id, after=after, limit=limit)


def mean_seconds(engine: Engine, studies: Sequence[Study]) -> float | None:
    """Return how long an evaluation took in the latest of these studies that has any result."""
    begun = [study for study in studies if study.ok_count]
    if not begun:
        return None
    latest = max(begun, key=lambda study: study.created_at)
    with reading(engine) as connection:
        after = latest.result_count - TIMED
        return results.mean_seconds(connection, latest.id, after=after)


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """Who is there and what each holds, at one moment."""

    workers: Sequence[Worker]
    #: Instances held, by worker.
    held: Mapping[str, int]
    #: Leases let expire, by worker, since the fence that was asked for.
    lost: Mapping[str, int]
    last_fence: int


def fleet(engine: Engine, *, since_fence: int) -> Fleet:
    """Return the fleet as it is now."""
    with reading(engine) as connection:
        return Fleet(
            workers=workers.every(connection),
            held=leases.held(connection),
            lost=leases.lost_since(connection, since_fence),
            last_fence=leases.last_fence(connection),
        )
