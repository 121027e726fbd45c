"""Who works for this coordinator."""

from dataclasses import asdict
from typing import Any

from fastapi import APIRouter

from server.logic.fleet.comparisons import Reputation
from server.operations.fleet import comparisons
from server.routes.common import Store
from server.store.database.engine import reading
from server.store.fleet import workers
from server.store.study import studies

router = APIRouter(prefix="/v1", tags=["workers"])


@router.get("/workers")
def every(store: Store) -> dict[str, Any]:
    """List every worker that has ever asked for work, and how far its host is trusted.

    The latest heard from comes first. `agreed` and `disagreed` count the results of the host that
    another one has computed again, and those of others that it has.
    """
    reputations = comparisons.reputations(store)
    answer = []
    with reading(store) as connection:
        for worker in workers.every(connection):
            found = reputations.get(worker.host, Reputation())
            answer.append({**asdict(worker), **asdict(found), "trust": found.trust})
    return {"workers": answer}


@router.get("/work")
def work(store: Store) -> dict[str, int]:
    """Tell how many instances could be handed out now, and how many workers have.

    Those of paused studies do not wait. For whatever starts workers.
    """
    with reading(store) as connection:
        waiting, under_way = studies.work(connection)
    return {"waiting": waiting, "under_way": under_way}
