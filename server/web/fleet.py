"""The fleet: who works, how busily, and what waits for whom."""

import asyncio
import logging
from collections import Counter
from collections.abc import Sequence
from typing import Any

from sqlalchemy.exc import SQLAlchemyError

from server.logic.fleet.comparisons import Reputation
from server.logic.fleet.history import EVERY_SECONDS, FleetHistory, Glance
from server.logic.fleet.hosts import GONE_SECONDS
from server.logic.fleet.unserved import why_it_waits
from server.operations import watching
from server.operations.fleet import comparisons
from server.operations.study import studies
from server.records import Study, Worker
from server.threads import in_thread
from server.web.page import Look, Page

log = logging.getLogger(__name__)

#: Workers that are gone for longer are not shown, unless somebody asks for all; and the most shown.
FORGOTTEN_SECONDS = 86400.0
MOST_SHOWN = 300


async def watch(state: Any) -> None:
    """Look at the fleet every few seconds, for as long as the coordinator runs."""
    history: FleetHistory = state.fleet_history
    while True:
        try:
            found = await in_thread(watching.fleet, state.engine, since_fence=history.first_fence)
            done = {worker.id: worker.instances_done for worker in found.workers}
            now = state.clock()
            glance = Glance(at=now, done=done, held=found.held, fence=found.last_fence)
            history.add(glance)
        except SQLAlchemyError:
            log.exception("the fleet could not be looked at; trying again")
        await asyncio.sleep(EVERY_SECONDS)


def look(asked: Look) -> dict[str, Any]:
    """Return who is there, who was, and what waits."""
    history: FleetHistory = asked.state.fleet_history
    found = watching.fleet(asked.engine, since_fence=history.first_fence)
    trust = comparisons.reputations(asked.engine)
    alive = [w for w in found.workers if w.last_seen > asked.now - GONE_SECONDS]
    recent = [w for w in found.workers if w.last_seen > asked.now - FORGOTTEN_SECONDS]
    bits = Counter(w.versions.get("canary") for w in alive)
    usual = bits.most_common(1)[0][0] if bits else None
    rows: list[dict[str, Any]] = [
        {
            "worker": worker,
            "alive": worker in alive,
            "pulse": history.pulse(worker.id),
            "held": found.held.get(worker.id, 0),
            "lost": found.lost.get(worker.id, 0),
            "trust": trust.get(worker.host, Reputation()),
            "canary": worker.versions.get("canary"),
            "usual": worker.versions.get("canary") == usual,
        }
        for worker in (found.workers if asked.choices.get("all") else recent)[:MOST_SHOWN]
    ]
    waiting = [
        {"study": study, "why": why}
        for study in studies.every(asked.engine)
        if study.state.is_served and study.pending
        if (why := _why_it_waits(asked, study, alive)) is not None
    ]
    return {
        "rows": rows,
        "alive": len(alive),
        "gone": len(found.workers) - len(rows),
        "since": history.since,
        "waiting": waiting,
        "rate": sum(row["pulse"].results_per_second for row in rows if row["alive"]),
        "busy": sum(row["held"] > 0 for row in rows if row["alive"]),
    }


def _why_it_waits(asked: Look, study: Study, alive: Sequence[Worker]) -> str | None:
    patience = asked.state.patience
    why = why_it_waits(study, alive, asked.now - patience.since)
    return why or studies.why_rows_wait(asked.engine, study, asked.now, patience)


PAGE = Page(path="/fleet", template="fleet.html", look=look, choices=("all",))
