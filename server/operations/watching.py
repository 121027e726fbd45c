"""What pages look at beyond what requests of clients do."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy.engine import Engine

from server.logic.study.progress import RATE_WINDOW
from server.records import Place, Study, Worker
from server.store import close_loops
from server.store.database.engine import alone_reading, reading
from server.store.fleet import leases, results, workers

every_close_loop = alone_reading(close_loops.every)
first_of_rows = alone_reading(results.first_of_rows)
results_at = alone_reading(results.at)

#: Results whose times say how long an evaluation takes, and the least of them that say how fast
#: they come.
TIMED = RATE_WINDOW
FEWEST_TIMED = 20


def latest_failed(engine: Engine, study: Study, *, limit: int) -> list[dict[str, Any]]:
    """Return the latest failed results of a study, as many of each cause, with worker and host."""
    causes = [cause for cause, count in study.failures.items() if count]
    found: list[dict[str, Any]] = []
    with reading(engine) as connection:
        for cause in causes:
            share = max(1, limit // len(causes))
            found += results.latest_failed(connection, study.id, cause, limit=share)
    return sorted(found, key=lambda one: -one["seq"])


def good_among(engine: Engine, study: Study, *, since: int, limit: int) -> list[Place]:
    """Return where results without fault are, evenly out of those from number `since` on.

    Those that are asked for again and again are the same, but for the ones that are new.
    """
    step = 1
    while (study.result_count - since) // step >= limit:
        step *= 2
    first = -(-max(since, 1) // step) * step
    with reading(engine) as connection:
        numbers = range(first, study.result_count + 1, step)
        return results.good_ones(connection, study.id, numbers)


def mean_seconds(engine: Engine, studies: Sequence[Study]) -> float | None:
    """Return the seconds that one worker takes for an evaluation; None before any has ended.

    In the latest of these studies that has any result, as fast as its last results came; if all of
    them came at once, as long as an evaluation took, as if workers did one at a time.
    """
    begun = [study for study in studies if study.ok_count]
    if not begun:
        return None
    latest = max(begun, key=lambda study: study.created_at)
    with reading(engine) as connection:
        after = latest.result_count - TIMED
        count, seconds, workers = results.tempo(connection, latest.id, after=after)
        if count >= FEWEST_TIMED and seconds > 0.0:
            return seconds * workers / count
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


def fleet(engine: Engine, *, since_fence: int | None = None) -> Fleet:
    """Return the fleet as it is now; `since_fence`: from where on leases count that were lost."""
    with reading(engine) as connection:
        return Fleet(
            workers=workers.every(connection),
            held=leases.held(connection),
            lost={} if since_fence is None else leases.lost_since(connection, since_fence),
            last_fence=leases.last_fence(connection),
        )
