"""How much work there is, for whatever starts workers."""

from sqlalchemy.engine import Connection, Engine

from server.logic.fleet.groups import LATEST, Share, Waiting, beginning, share, to_hand_out
from server.records import Study
from server.store import models
from server.store.database.engine import reading
from server.store.fleet import workers
from server.store.study import instances, studies


def work(engine: Engine, group: str | None, *, now: float) -> tuple[Share, int]:
    """Return what waits, and how many instances workers have.

    Args:
        group: how the ids begin of the workers that would take it; None: any might.
        now: seconds, UTC epoch.
    """
    with reading(engine) as connection:
        waiting, under_way = studies.work(connection)
        if group is None or not waiting:
            return Share(waiting=waiting), under_way
        mine = beginning(group)
        found = [_waiting(connection, study, mine) for study in studies.served(connection)]
        latest = workers.latest_of(connection, mine, most=LATEST)
        return share(found, latest, now=now), under_way


def _waiting(connection: Connection, study: Study, mine: str) -> Waiting:
    model = study.plan.model
    version = models.find(connection, model) if "@" in model else None
    count = to_hand_out(study)
    # While a row is left to begin, which any machine may, the few begun ones say little.
    bound = 0 < study.returned == count
    return Waiting(
        study=study,
        count=count,
        by_class=instances.waiting_by_class(connection, study.id) if bound else {},
        to_be_had=version is not None
        and (version.size > 0 or version.announced_by.startswith(mine)),
    )
