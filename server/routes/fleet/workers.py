"""Who works for this coordinator."""

from dataclasses import asdict
from typing import Annotated, Any

from fastapi import APIRouter, Query

from server.http.texts import PRINTABLE
from server.logic.fleet.comparisons import Reputation
from server.operations.fleet import comparisons
from server.operations.fleet import work as of_work
from server.routes.common import Now, Route, Store
from server.store.database.engine import reading
from server.store.fleet import workers

router = APIRouter(prefix="/v1", tags=["workers"], route_class=Route)

Group = Annotated[
    str | None,
    Query(
        min_length=1,
        max_length=40,
        pattern=PRINTABLE,
        examples=["lab-2"],
        description="What workers have as REHYB_WORKER_GROUP: their ids begin with it and an @.",
    ),
]


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
def work(store: Store, now: Now, group: Group = None) -> dict[str, Any]:
    """Tell how many instances could be handed out now, and how many workers have.

    Those of paused studies do not wait. For whatever starts workers: with `group`, those do not
    wait either that the group's latest workers may not have; `unfit` counts them, and `why` says
    why. If none of the group asked for a quarter of an hour, one of them waits for a look.
    """
    found, under_way = of_work.work(store, group, now=now)
    told = {"waiting": found.waiting, "under_way": under_way}
    return told if group is None else {**told, "unfit": found.unfit, "why": found.why}
