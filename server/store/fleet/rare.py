"""What turns ask of the database only where something went wrong."""

from collections.abc import Collection

from server.records import Lease, Place, Study
from server.store.fleet import workers
from server.store.fleet.turn_statements import Sets
from server.store.fleet.turns import Turn

#: Budgets that were used up are no results that anybody may have reported.
_TAKEN_BACK = Sets("""
SELECT row, position FROM superseded
WHERE study_id = %s AND superseded_at > (SELECT granted_at FROM leases WHERE id = %s)
  AND outcome NOT IN ('crashed', 'timed_out', 'invalid', 'lost') AND CAST(row AS text) {any}
""")


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


async def taken_back(
    turn: Turn, study: Study, lease: Lease, places: Collection[Place]
) -> set[Place]:
    """Return those of `places` whose final result was taken back since a lease was granted."""
    rows = [str(row) for row in sorted({row for row, _ in places})]
    (found,) = await turn.trip(_TAKEN_BACK.words(turn.dialect.name, study.id, lease.id, rows))
    return {(row, position) for row, position in found} & {*places}
