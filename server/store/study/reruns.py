"""What running again asks of the tables: which instances, and results out of the log."""

from collections.abc import Collection, Sequence

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from server.records import Instance, Place, Study
from server.states import InstanceState, Outcome, StudyState
from server.store.database.schema import (
    OF_INSTANCE,
    instances,
    results,
    studies,
    superseded,
)
from server.store.study.instances import EVERY, chunks, from_row

#: What is kept of a result that is taken back.
_KEPT = ("study_id", "row", "position", "outcome", "outputs", "reason", "worker_id", "received_at")


def every(connection: Connection, study_id: str) -> list[Instance]:
    """Return all instances of a study's begun rows."""
    return _found(connection, instances.c.study_id == study_id)


def failed(connection: Connection, study_id: str, outcomes: Sequence[str] | None) -> list[Instance]:
    """Return the instances whose final result is a failure; `outcomes`: only these, None: any."""
    wanted = results.c.outcome != Outcome.OK
    if outcomes is not None:
        wanted = sa.and_(wanted, results.c.outcome.in_(outcomes))
    is_failed = sa.exists().where(OF_INSTANCE, wanted)
    return _found(connection, sa.and_(instances.c.study_id == study_id, is_failed))


def studies_with_stranded(connection: Connection, *, alive: Collection[str]) -> Sequence[str]:
    """Return the studies with rows as `stranded` has them."""
    query = (
        sa.select(instances.c.study_id)
        .join(studies, studies.c.id == instances.c.study_id)
        .where(_stranded(alive), studies.c.state.in_([s for s in StudyState if s.is_served]))
        .distinct()
    )
    return connection.scalars(query).all()


def stranded(connection: Connection, study_id: str, *, alive: Collection[str]) -> list[Instance]:
    """Return all instances of rows that wait for a kind of machine that is none of those `alive`.

    Rows of which a worker still holds something are left out.
    """
    of_study = instances.c.study_id == study_id
    rows = sa.select(instances.c.row).where(of_study).correlate(None)
    waiting = instances.c.row.in_(rows.where(_stranded(alive)))
    held = instances.c.row.in_(rows.where(instances.c.state == InstanceState.LEASED))
    return _found(connection, sa.and_(of_study, waiting, sa.not_(held)))


def _stranded(alive: Collection[str]) -> sa.ColumnElement[bool]:
    return sa.and_(
        instances.c.state == InstanceState.PENDING,
        instances.c.host_class.is_not(None),
        instances.c.host_class.not_in(sorted(alive)),
    )


def take_back(
    connection: Connection, study_id: str, rows: Collection[int], *, now: float, why: str
) -> list[Place]:
    """Move results in `rows` whose instance is open again to `superseded`; return their places."""
    places: list[Place] = []
    for chunk in chunks(rows):
        query = (
            sa.select(results)
            .join(instances, OF_INSTANCE)
            .where(
                results.c.study_id == study_id,
                results.c.row.in_(chunk),
                instances.c.state != InstanceState.DONE,
            )
        )
        found = connection.execute(query).all()
        if not found:
            continue
        kept = [{name: row._mapping[name] for name in _KEPT} for row in found]
        connection.execute(
            sa.insert(superseded), [{**row, "superseded_at": now, "why": why} for row in kept]
        )
        connection.execute(
            sa.delete(results).where(
                results.c.study_id == study_id, results.c.seq == sa.bindparam("at_seq")
            ),
            [{"at_seq": row.seq} for row in found],
        )
        places += [(row.row, row.position) for row in found]
    return places


def number_anew(connection: Connection, study_id: str) -> None:
    """Number the study's results 1, 2, ... in the order they came."""
    ranked = (
        sa.select(results.c.seq, sa.func.row_number().over(order_by=results.c.seq).label("number"))
        .where(results.c.study_id == study_id)
        .subquery()
    )
    # By way of negative numbers, so that no two are equal at any moment.
    renumber = sa.update(results).where(results.c.study_id == study_id)
    connection.execute(renumber.where(results.c.seq == ranked.c.seq).values(seq=-ranked.c.number))
    connection.execute(renumber.values(seq=-results.c.seq))


def count(connection: Connection, study: Study) -> tuple[dict[str, int], int, int]:
    """Count final results by outcome, rows with one in every position, and leased instances."""
    outcomes = sa.select(results.c.outcome, sa.func.count()).where(results.c.study_id == study.id)
    found = sa.select(instances.c.row).where(instances.c.study_id == study.id)
    leased = found.where(instances.c.state == InstanceState.LEASED)
    complete = found.where(instances.c.state == InstanceState.DONE).group_by(instances.c.row)
    complete = complete.having(sa.func.count() == study.plan.width)
    rows, held = (
        connection.scalar(sa.select(sa.func.count()).select_from(counted.subquery())) or 0
        for counted in (complete, leased)
    )
    return dict(connection.execute(outcomes.group_by(results.c.outcome)).all()), rows, held


def _found(connection: Connection, where: sa.ColumnElement[bool]) -> list[Instance]:
    return [from_row(row) for row in connection.execute(EVERY.where(where))]
