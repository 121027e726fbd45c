"""What turns ask of the database only where something went wrong."""

from server.records import Study
from server.store.fleet import workers
from server.store.fleet.turns import Turn


async def hosts_at_work(
    turn: Turn, study: Study, kind: str | None, *, now: float, heard_after: float
) -> set[str]:
    """Return the hosts of a kind of machine that work on a study.

    They hold some of it now, or finished one of the latest leases, were heard from since
    `heard_after`, and hold nothing of another study.
    """
    asked = workers.HOSTS_AT_WORK.words(turn.dialect, study.id, now, kind, heard_after)
    (found,) = await turn.trip([asked])
    return {host for (host,) in found}
