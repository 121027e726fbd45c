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

#: What is kept of a result that is taken back.
_KEPT = "study_id, row, position, outcome, outputs, reason, worker_id, received_at"
_AT = "WHERE study_id = %s AND row = %s AND position = %s"
_KEEP_ALL = f"""
INSERT INTO superseded (superseded_at, why, {_KEPT}) SELECT %s, %s, {_KEPT} FROM results
"""
_KEEP = SetStatement(f"{_KEEP_ALL} {_AT}")
_REPLACE = SetStatement(f"""
UPDATE results SET worker_id = %s, outcome = %s, outputs = %s, reason = %s, state = %s,
    wall_seconds = %s {_AT}
""")
_START_OVER = [
    SetStatement(f"DELETE FROM {table} WHERE study_id = %s")
    for table in ("estimator_states", "snapshots")
]


_KEEP_EVERY = SetStatement(f"{_KEEP_ALL} WHERE study_id = %s")
_TAKE_BACK = SetStatement("DELETE FROM results WHERE study_id = %s")
_REOPEN = SetStatement("""
UPDATE instances SET host_class = NULL, state = 'pending', lease_id = NULL, attempts = '{}',
    avoid = NULL
WHERE study_id = %s
""")


async def begin_anew(turn: Turn, study: Study, *, now: float) -> None:
    """Leave the begun rows of a study, of which nobody holds anything, to any host class.

    They are as if nobody had tried them, and what results there are is kept as superseded.
    """
    statements = []
    if study.result_count:
        statements += _KEEP_EVERY.statements(turn.dialect, now, "begun anew", study.id)
        for one in (_TAKE_BACK, *_START_OVER):
            statements += one.statements(turn.dialect, study.id)
    await turn.trip([*statements, *_REOPEN.statements(turn.dialect, study.id)])


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
