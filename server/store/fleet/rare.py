"""What turns ask of the database only where something went wrong."""

from collections.abc import Collection, Iterable

from models.curves import packed
from server.records import Lease, Place, Result, Study
from server.store.database.prepared import as_text
from server.store.fleet import workers
from server.store.fleet.turn_statements import SetStatement
from server.store.fleet.turns import Turn

#: Budgets that were used up are no results that anybody may have reported.
_SUPERSEDED = SetStatement("""
SELECT row, position FROM superseded
WHERE study_id = %s AND superseded_at > (SELECT granted_at FROM leases WHERE id = %s)
  AND outcome NOT IN ('crashed', 'timed_out', 'invalid', 'lost') AND CAST(row AS text) {any}
""")

_AT = "WHERE study_id = %s AND row = %s AND position = %s"
_KEEP = SetStatement(f"""
INSERT INTO superseded (superseded_at, why, study_id, row, position, outcome, outputs, reason,
    worker_id, received_at)
SELECT %s, %s, study_id, row, position, outcome, outputs, reason, worker_id, received_at
FROM results {_AT}
""")
_REPLACE = SetStatement(f"""
UPDATE results SET worker_id = %s, outcome = %s, outputs = %s, reason = %s, state = %s,
    wall_seconds = %s {_AT}
""")
_START_OVER = [
    SetStatement(f"DELETE FROM {table} WHERE study_id = %s")
    for table in ("estimator_states", "snapshots")
]


_UNBIND = SetStatement("UPDATE instances SET host_class = NULL WHERE study_id = %s")


async def unbind(turn: Turn, study: Study) -> None:
    """Leave the begun rows of a study, of which nobody holds anything, to any host class."""
    await turn.trip(_UNBIND.statements(turn.dialect, study.id))


async def hosts_at_work(
    turn: Turn, study: Study, host_class: str | None, *, now: float, heard_after: float
) -> set[str]:
    """Return the hosts of a host class that work on a study.

    They hold some of it now, or finished one of the latest leases, were heard from since
    `heard_after`, and hold nothing of another study.
    """
    asked = workers.HOSTS_AT_WORK.statement(turn.dialect, study.id, now, host_class, heard_after)
    (found,) = await turn.trip([asked])
    return {host for (host,) in found}


async def superseded(
    turn: Turn, study: Study, lease: Lease, places: Collection[Place]
) -> set[Place]:
    """Return those of `places` whose final result was superseded since a lease was granted."""
    rows = [str(row) for row in sorted({row for row, _ in places})]
    (found,) = await turn.trip(_SUPERSEDED.statements(turn.dialect, study.id, lease.id, rows))
    return {(row, position) for row, position in found} & {*places}


async def put_in_place(
    turn: Turn, study: Study, worker: str, found: Iterable[Result], *, now: float
) -> None:
    """Replace final results, which are kept as superseded; the analysis starts over.

    Each keeps number and time of what it replaces, so that nothing else of the log changes.
    """
    statements = [one for table in _START_OVER for one in table.statements(turn.dialect, study.id)]
    for one in found:
        place = study.id, one.row, one.position
        statements += _KEEP.statements(turn.dialect, now, "lost", *place)
        outputs = None if one.outputs is None else as_text(packed(one.outputs))
        state = None if one.state is None else as_text(one.state)
        said = worker, one.outcome, outputs, one.reason, state, one.wall_seconds
        statements += _REPLACE.statements(turn.dialect, *said, *place)
    await turn.trip(statements)
