"""Taking final results back, so that their instances run again.

What is taken back is kept in the table `superseded`. The results left are numbered anew without
gaps, and the analysis starts over: indices are a function of the set of results, so they come out
as if the replaced ones had never been.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine

from server.errors import ConflictError
from server.logic.slots import reopened
from server.logic.study import Study
from server.store import comparisons, ledger, studies
from server.store.engine import reading, writing
from server.store.schema import (
    estimator_states,
    instances,
    results,
    snapshots,
    superseded,
    workers,
)
from server.store.schema import studies as studies_table
from server.store.slots import SLOTS, from_row


def rerun(
    engine: Engine, study_id: str, *, which: str, outcomes: Sequence[str] | None, now: float
) -> tuple[Study, int]:
    """Run final results again; returns the study and how many results were taken back.

    Args:
        engine: where.
        study_id: which study.
        which: "failed": in their rows and on the same kind of machine; "all": every row, on any
            machine and with any version, as if the study had just been submitted.
        outcomes: only failures of these names; None: all of them.
        now: seconds, UTC epoch.

    Raises:
        NotFoundError: there is no study of that id.
        ConflictError: it is cancelled; or all of it is to run again while workers hold some.
    """
    with writing(engine) as connection:
        study = studies.find(connection, study_id, lock=True)
        if study.state == "cancelled":
            raise ConflictError(f"study {study_id} is cancelled: submit it again")
        if which == "all":
            if study.leased:
                raise ConflictError(
                    f"workers hold {study.leased} instances of study {study_id}: pause it and "
                    "wait for them"
                )
            study = replace(study, identity=None)
            return _reopen(
                connection, study, instances.c.row >= 0, unbound=True, now=now, why="all"
            )
        wanted = results.c.outcome != "ok"
        if outcomes is not None:
            wanted = sa.and_(wanted, results.c.outcome.in_(outcomes))
        places = sa.exists().where(
            results.c.study_id == instances.c.study_id,
            results.c.row == instances.c.row,
            results.c.position == instances.c.position,
            wanted,
        )
        return _reopen(connection, study, places, unbound=False, now=now, why="failed")


def free_stranded_rows(engine: Engine, *, now: float, patience: float) -> int:
    """Begin anew, on any kind of machine, the rows that wait for a kind that is gone.

    A row waits in vain when no worker of its class was heard of for `patience` seconds. Rows of
    which a worker still holds something are left alone.

    Returns:
        How many rows were freed.
    """
    waiting = sa.and_(instances.c.state == "pending", instances.c.host_class.is_not(None))
    alive = sa.select(workers.c.host_class).where(
        workers.c.last_seen > now - patience, workers.c.host_class.is_not(None)
    )
    stranded = sa.and_(waiting, instances.c.host_class.not_in(alive))
    with reading(engine) as connection:
        concerned = connection.scalars(
            sa.select(instances.c.study_id)
            .join(studies_table, studies_table.c.id == instances.c.study_id)
            .where(stranded, studies_table.c.state.in_(("running", "draining")))
            .distinct()
        ).all()
    freed = 0
    for study_id in concerned:
        with writing(engine) as connection:
            study = studies.find(connection, study_id, lock=True)
            found = sa.select(instances.c.row).where(instances.c.study_id == study_id, stranded)
            held = sa.select(instances.c.row).where(
                instances.c.study_id == study_id, instances.c.state == "leased"
            )
            rows = set(connection.scalars(found)) - set(connection.scalars(held))
            for chunk in ledger.chunks(rows):
                here = instances.c.row.in_(chunk)
                study, _ = _reopen(connection, study, here, unbound=True, now=now, why="stranded")
            freed += len(rows)
    return freed


def _reopen(
    connection: Connection,
    study: Study,
    where: sa.ColumnElement[bool],
    *,
    unbound: bool,
    now: float,
    why: str,
) -> tuple[Study, int]:
    """Reopen instances of a locked study, whether or not they have a result."""
    here = sa.and_(instances.c.study_id == study.id, where)
    slots = [from_row(row) for row in connection.execute(SLOTS.where(here))]
    ledger.update(connection, study, [reopened(slot, unbound=unbound) for slot in slots])
    taken = _take_back(
        connection, study, {slot.row for slot in slots if slot.state == "done"}, now, why
    )
    study = _recounted(connection, study)
    studies.save(connection, study)
    return study, taken


def _take_back(
    connection: Connection, study: Study, rows: Collection[int], now: float, why: str
) -> int:
    """Move results whose instance is open again out of the log; returns how many."""
    taken = 0
    for chunk in ledger.chunks(rows):
        query = (
            sa.select(results)
            .join(
                instances,
                sa.and_(
                    instances.c.study_id == results.c.study_id,
                    instances.c.row == results.c.row,
                    instances.c.position == results.c.position,
                ),
            )
            .where(
                results.c.study_id == study.id,
                results.c.row.in_(chunk),
                instances.c.state != "done",
            )
        )
        found = connection.execute(query).all()
        if found:
            kept = [_kept(row, now, why) for row in found]
            connection.execute(sa.insert(superseded), kept)
            connection.execute(
                sa.delete(results).where(
                    results.c.study_id == study.id, results.c.seq == sa.bindparam("at_seq")
                ),
                [{"at_seq": row.seq} for row in found],
            )
            comparisons.forget(connection, study, [(row.row, row.position) for row in found])
        taken += len(found)
    if taken:
        _number_anew(connection, study)
        for table in (estimator_states, snapshots):
            connection.execute(sa.delete(table).where(table.c.study_id == study.id))
    return taken


def _number_anew(connection: Connection, study: Study) -> None:
    """Number the study's results 1, 2, ... in the order they came."""
    ranked = (
        sa.select(results.c.seq, sa.func.row_number().over(order_by=results.c.seq).label("number"))
        .where(results.c.study_id == study.id)
        .subquery()
    )
    # By way of negative numbers, so that no two are equal at any moment.
    connection.execute(
        sa.update(results)
        .where(results.c.study_id == study.id, results.c.seq == ranked.c.seq)
        .values(seq=-ranked.c.number)
    )
    connection.execute(
        sa.update(results).where(results.c.study_id == study.id).values(seq=-results.c.seq)
    )


def _recounted(connection: Connection, study: Study) -> Study:
    """Return the study with its counters taken from its tables; it runs again if work is left."""
    outcomes = {
        row.outcome: row.n
        for row in connection.execute(
            sa.select(results.c.outcome, sa.func.count().label("n"))
            .where(results.c.study_id == study.id)
            .group_by(results.c.outcome)
        )
    }
    complete = (
        sa.select(instances.c.row)
        .where(instances.c.study_id == study.id, instances.c.state == "done")
        .group_by(instances.c.row)
        .having(sa.func.count() == study.plan.width)
        .subquery()
    )
    done = sum(outcomes.values())
    again = study.state == "complete" and done < study.plan.instances
    return replace(
        study,
        result_count=done,
        ok_count=outcomes.pop("ok", 0),
        failures=outcomes,
        rows_complete=connection.scalar(sa.select(sa.func.count()).select_from(complete)) or 0,
        leased=connection.scalar(
            sa.select(sa.func.count()).where(
                instances.c.study_id == study.id, instances.c.state == "leased"
            )
        )
        or 0,
        state="running" if again else study.state,
        finished_at=None if again else study.finished_at,
        edition=study.edition + 1,
    )


def _kept(row: Any, now: float, why: str) -> dict[str, Any]:
    names = ("study_id", "row", "position", "outcome", "outputs", "reason", "worker_id")
    return {
        **{name: getattr(row, name) for name in names},
        "received_at": row.received_at,
        "superseded_at": now,
        "why": why,
    }
