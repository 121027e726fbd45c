"""The instances of a study and its counters, which change together or not at all."""

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from operator import itemgetter
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from server.logic.slots import Result, Slot, may_try
from server.logic.study import Study, drained
from server.store import studies
from server.store.engine import JSON
from server.store.prepared import Prepared, Rows, as_text
from server.store.schema import instances, results
from server.store.slots import BEGUN, COLUMNS, SLOTS, from_row, of_new_rows, to_row

#: (row, position) of an instance in its study.
Place = tuple[int, int]

#: Values in one IN list: well under what any SQLite takes.
_IN_LIST = 500

# Statements that every lease and every post executes are built once: building one takes SQLAlchemy
# longer than executing it takes the database.
_ARE_HELD = sa.select(instances.c.row).where(
    instances.c.study_id == sa.bindparam("of_study"),
    instances.c.row.in_(sa.bindparam("rows", expanding=True)),
    instances.c.lease_id == sa.bindparam("of_lease"),
)
_TRIED_HERE = sa.and_(
    instances.c.avoid.is_not(None),
    sa.or_(
        instances.c.avoid == sa.bindparam("asking_host"),
        # No host's name holds the character that would escape others.
        sa.cast(instances.c.attempts, sa.Text).contains(sa.bindparam("as_json"), escape="\x1f"),
    ),
)


def _waiting(*conditions: sa.ColumnElement[bool]) -> tuple[Prepared, Prepared]:
    """Return what finds waiting instances of one kind of machine, and of none.

    Both at once would be beyond the index: all instances ever begun would be looked through.
    """
    found = SLOTS.where(
        instances.c.study_id == sa.bindparam("of_study"),
        # As the index has it: a plan that is made once cannot rely on a parameter.
        instances.c.state == sa.literal_column("'pending'"),
        *conditions,
    )
    found = found.order_by(instances.c.row, instances.c.position).limit(sa.bindparam("most"))
    names = ("of_study", "asking_class", "most", "asking_host", "as_json")
    mine = instances.c.host_class == sa.bindparam("asking_class")
    none = instances.c.host_class.is_(None)
    return (
        Prepared(found.where(mine), *names, index="instances_returned"),
        Prepared(found.where(none), *names, index="instances_returned"),
    )


_WAITING = _waiting()
_NEW_HERE, _AGAIN_HERE = _waiting(sa.not_(_TRIED_HERE)), _waiting(_TRIED_HERE)
_UPDATE = sa.update(instances).where(
    instances.c.study_id == sa.bindparam("of_study"),
    instances.c.row == sa.bindparam("at_row"),
    instances.c.position == sa.bindparam("at_position"),
)
_BEGIN = Rows(instances, same=BEGUN, each=("row", "position"))
#: Most of what workers post changes no more than this.
_MOVE = Prepared(
    _UPDATE.values(state=sa.bindparam("to_state"), lease_id=sa.bindparam("to_lease")),
    "of_study",
    "at_row",
    "at_position",
    "to_state",
    "to_lease",
)
#: The same for all that a lease holds in rows without a gap: for ten in a quarter of the time.
_EMPTY = Prepared(
    sa.update(instances)
    .where(
        instances.c.study_id == sa.bindparam("of_study"),
        instances.c.row.between(sa.bindparam("first"), sa.bindparam("last")),
        instances.c.lease_id == sa.bindparam("of_lease"),
    )
    .values(state=sa.bindparam("to_state"), lease_id=sa.bindparam("to_lease")),
    "of_study",
    "first",
    "last",
    "of_lease",
    "to_state",
    "to_lease",
)
_REWRITE = Prepared(
    _UPDATE.values({name: sa.bindparam(f"to_{name}") for name in COLUMNS[3:]}),
    "of_study",
    "at_row",
    "at_position",
    *(f"to_{name}" for name in COLUMNS[3:]),
)
_BIND = (
    sa.update(instances)
    .where(
        instances.c.study_id == sa.bindparam("of_study"),
        instances.c.row.in_(sa.bindparam("rows", expanding=True)),
        instances.c.host_class.is_(None),
    )
    .values(host_class=sa.bindparam("to_class"))
)
_APPEND = Rows(
    results,
    same=("study_id", "worker_id", "received_at"),
    each=("seq", "row", "position", "outcome", "outputs", "reason", "state", "wall_seconds"),
)


def rows(connection: Connection, study: Study, places: Iterable[Place]) -> dict[Place, Slot]:
    """Return where all instances of the rows in which `places` lie stand, if they were begun."""
    found: dict[Place, Slot] = {}
    for chunk in chunks({row for row, _ in places}):
        for row in _of_rows(len(chunk)).execute(connection, study.id, *chunk):
            found[row[0], row[1]] = from_row(row)
    return found


@cache
def _of_rows(count: int) -> Prepared:
    """Return what finds the slots of so many rows."""
    names = [f"row_{number}" for number in range(count)]
    here = instances.c.row.in_([sa.bindparam(name) for name in names])
    of_study = instances.c.study_id == sa.bindparam("of_study")
    return Prepared(SLOTS.where(of_study, here), "of_study", *names)


def held(slots: Mapping[Place, Slot], *, lease: str) -> dict[Place, Slot]:
    """Return those of `slots` that a lease holds."""
    return {place: slot for place, slot in slots.items() if slot.lease == lease}


def are_held(connection: Connection, study: Study, places: Iterable[Place], *, lease: str) -> bool:
    """Say whether a lease holds any of the instances in the rows in which `places` lie."""
    for chunk in chunks({row for row, _ in places}):
        asked = {"of_study": study.id, "rows": chunk, "of_lease": lease}
        if connection.scalar(_ARE_HELD, asked) is not None:
            return True
    return False


def waiting(
    connection: Connection,
    study: Study,
    *,
    host_class: str,
    host: str,
    at_work: Collection[str],
    limit: int,
) -> list[Slot]:
    """Return up to `limit` instances of begun rows that wait for a machine, first rows first.

    Args:
        connection: a transaction that has locked the study.
        study: which study.
        host_class: the kind of machine that asks; rows of another kind are left out.
        host: the machine that asks; what went wrong there is left to others, as `may_try` has it.
        at_work: the hosts of its kind that work on the study now.
        limit: how many.
    """

    def find(statements: tuple[Prepared, Prepared], most: int) -> list[Slot]:
        values = (study.id, host_class, most, host, JSON.encode(host))
        rows = [row for query in statements for row in query.execute(connection, *values)]
        return [from_row(row) for row in sorted(rows, key=itemgetter(0, 1))[:most]]

    if not set(at_work) - {host}:
        return find(_WAITING, limit)
    found = find(_NEW_HERE, limit)
    if len(found) < limit:
        again = find(_AGAIN_HERE, _IN_LIST)
        found += [slot for slot in again if may_try(slot, host, at_work)]
    return found[:limit]


def hand_out(
    connection: Connection,
    study: Study,
    *,
    lease: str,
    begun: Sequence[Place],
    fresh: int,
    again: Sequence[Slot],
    unbound: Collection[int],
    host_class: str,
    identity: Mapping[str, str],
) -> Study:
    """Write what a lease holds; returns the study as it is now.

    Args:
        connection: a transaction that has locked the study.
        study: as it was.
        lease: the lease.
        begun: every place in new rows.
        fresh: so many of them, the first ones, are leased.
        again: slots of rows begun before, now leased.
        unbound: those of their rows that any kind of machine could have taken.
        host_class: the kind of machine that all rows concerned now belong to.
        identity: the code that begins the study, if none has before.
    """
    for places, holder in ((begun[:fresh], lease), (begun[fresh:], None)):
        _BEGIN.add(connection, of_new_rows(study.id, holder, host_class), places)
    _MOVE.execute_many(connection, [_moved(study, slot) for slot in again])
    for rows in chunks(unbound):
        connection.execute(_BIND, {"of_study": study.id, "rows": rows, "to_class": host_class})
    updated = replace(
        study,
        handed_out=study.handed_out + len(begun),
        leased=study.leased + len(again) + fresh,
        identity=identity if study.identity is None else study.identity,
    )
    studies.save(connection, updated, counted=study.identity is not None)
    return updated


def settle(
    connection: Connection,
    study: Study,
    *,
    before: Mapping[Place, Slot],
    after: Mapping[Place, Slot],
    filed: Sequence[Result],
    worker: str,
    now: float,
) -> Study:
    """Write what became of leased or returned instances.

    Args:
        connection: a transaction that has locked the study.
        study: as it was.
        before: all slots of the rows concerned as they were.
        after: the slots that changed, as they are now: pending or done.
        filed: the final results, in the order they are to be numbered.
        worker: who is to be named for them.
        now: seconds, UTC epoch.

    Returns:
        The study as it is now, complete if this was the last of it.
    """
    if not after:
        return study
    _write_changes(connection, study, before, after)
    _append(connection, study, filed, worker, now)
    done = study.result_count + len(filed)
    failed = [result.outcome for result in filed if result.outcome != "ok"]
    finished = bool(filed) and done == study.plan.instances and study.state != "cancelled"
    updated = drained(
        replace(
            study,
            leased=study.leased - sum(before[place].state == "leased" for place in after),
            result_count=done,
            ok_count=study.ok_count + len(filed) - len(failed),
            failures=dict(Counter(study.failures) + Counter(failed)) if failed else study.failures,
            # A row is complete with the last of its results, so no row is counted twice.
            rows_complete=study.rows_complete
            + _complete({**before, **after}, {result.row for result in filed}),
            state="complete" if finished else study.state,
            finished_at=now if finished else study.finished_at,
        )
    )
    counted = not failed and updated.state == study.state
    studies.save(connection, updated, counted=counted)
    return updated


def _append(
    connection: Connection, study: Study, filed: Sequence[Result], worker: str, now: float
) -> None:
    """Append final results, which were looked through, to the study's log."""
    _APPEND.add(
        connection,
        (study.id, worker, now),
        [
            (
                seq,
                result.row,
                result.position,
                result.outcome,
                None if result.outputs is None else as_text(result.outputs),
                result.reason,
                None if result.state is None else as_text(result.state),
                result.wall_seconds,
            )
            for seq, result in enumerate(filed, start=study.result_count + 1)
        ],
    )


def _complete(slots: Mapping[Place, Slot], rows: Collection[int]) -> int:
    """Return how many of `rows` have a final result in every position."""
    open_rows = {row for (row, _), slot in slots.items() if slot.state != "done"}
    return len(set(rows) - open_rows)


def _write_changes(
    connection: Connection, study: Study, before: Mapping[Place, Slot], after: Mapping[Place, Slot]
) -> None:
    moved: list[Slot] = []
    other: list[Slot] = []
    for place, slot in after.items():
        (moved if slot.attempts == before[place].attempts else other).append(slot)
    lease = _emptied(before, moved)
    if lease is None:
        _MOVE.execute_many(connection, [_moved(study, slot) for slot in moved])
    else:
        rows = [row for row, _ in before]
        to_state, to_lease = moved[0].state, moved[0].lease
        _EMPTY.execute(connection, study.id, min(rows), max(rows), lease, to_state, to_lease)
    update(connection, study, other)


def _emptied(before: Mapping[Place, Slot], moved: Sequence[Slot]) -> str | None:
    """Return the lease that held nothing but what moved, all to one state; None if there is none.

    Of the rows between those in `before` none may be missing there.
    """
    leases = {before[slot.row, slot.position].lease for slot in moved}
    if len(leases) != 1 or len({(slot.state, slot.lease) for slot in moved}) != 1:
        return None
    (lease,) = leases
    rows = {row for row, _ in before}
    whole = sum(slot.lease == lease for slot in before.values()) == len(moved)
    return lease if whole and max(rows) - min(rows) < len(rows) else None


def _moved(study: Study, slot: Slot) -> tuple[Any, ...]:
    return study.id, slot.row, slot.position, slot.state, slot.lease


def update(connection: Connection, study: Study, changed: Iterable[Slot]) -> None:
    """Write slots that exist already."""
    rows = [to_row(study.id, slot) for slot in changed]
    _REWRITE.execute_many(connection, rows)


def chunks(values: Collection[int]) -> Iterable[list[int]]:
    """Cut values into lists that fit into one query."""
    ordered = sorted(values)
    for start in range(0, len(ordered), _IN_LIST):
        yield ordered[start : start + _IN_LIST]
