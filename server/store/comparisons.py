"""Second opinions: asking for them, handing them out, comparing, and what becomes of a host's name.

Whoever changes a study's comparisons has locked the study.
"""

import logging
from collections.abc import Collection, Iterable, Sequence
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Engine

from server.logic.comparisons import (
    ATTEMPTS,
    Standing,
    agree,
    difference,
    is_chosen,
    is_comparable,
)
from server.logic.leases import Lease
from server.logic.slots import Result
from server.logic.study import Study, instance_id
from server.logic.verdicts import Report, Verdict, as_result, fault_in
from server.store import studies
from server.store.engine import reading, writing
from server.store.ledger import Place
from server.store.prepared import Prepared, Rows
from server.store.schema import comparisons
from server.store.schema import studies as studies_table

log = logging.getLogger(__name__)

#: In two halves, each of which an index can find.
_OF_OTHERS = sa.or_(
    comparisons.c.first_host < sa.bindparam("host"), comparisons.c.first_host > sa.bindparam("host")
)
#: Built once: every worker that asks for work asks this.
_STUDIES_WAITING = Prepared(
    sa.select(comparisons.c.study_id)
    .where(comparisons.c.state == "waiting", _OF_OTHERS)
    .distinct(),
    "host",
)
_ASK = Rows(
    comparisons,
    same=("study_id", "state", "attempts", "asked_at", "first_host", "first_worker_id"),
    each=("row", "position"),
)


def ask(
    connection: Connection,
    study: Study,
    results: Iterable[Result],
    *,
    share: float,
    host: str,
    worker: str,
    now: float,
) -> None:
    """Ask for second opinions on those of a host's new final results that are chosen for it."""
    chosen = [
        (result.row, result.position)
        for result in results
        if is_comparable(result) and is_chosen(study.plan.seed, result.row, result.position, share)
    ]
    _ASK.add(connection, (study.id, "waiting", 0, now, host, worker), chosen)


def studies_waiting(connection: Connection, models: Sequence[str], *, host: str) -> list[Study]:
    """Return the studies of `models` in which a second opinion of `host` is wanted."""
    # First the few that are waiting, so that asking costs nothing while there are none.
    wanted = _STUDIES_WAITING.execute(connection, host).fetchall()
    found = [studies.find(connection, study_id) for (study_id,) in wanted]
    return [
        study
        for study in found
        if study.state in ("running", "draining", "complete") and study.plan.model in models
    ]


def hand_out(
    connection: Connection, study: Study, *, host: str, lease: str, limit: int
) -> list[Place]:
    """Give up to `limit` results of other hosts to a lease of `host`, to be computed again."""
    found = connection.execute(
        sa.select(comparisons.c.id, comparisons.c.row, comparisons.c.position)
        .where(comparisons.c.study_id == study.id, comparisons.c.state == "waiting", _OF_OTHERS)
        .order_by(comparisons.c.id)
        .limit(limit),
        {"host": host},
    ).all()
    if found:
        connection.execute(
            sa.update(comparisons)
            .where(comparisons.c.id.in_([row.id for row in found]))
            .values(state="leased", lease_id=lease)
        )
    return [(row.row, row.position) for row in found]


def judge(
    connection: Connection,
    study: Study,
    reports: Sequence[Report],
    *,
    lease: Lease,
    stored: dict[Place, Result],
    host: str,
    tolerance: float,
    now: float,
) -> list[Verdict]:
    """Compare reports with the results that they were asked to be second opinions on.

    Args:
        connection: a transaction that has locked the study.
        study: which study.
        reports: what the worker says.
        lease: what it was given.
        stored: final results of the instances in the lease.
        host: where the worker runs.
        tolerance: largest relative difference of an output at which both agree.
        now: seconds, UTC epoch.

    Returns:
        A verdict for each report, in order.
    """
    query = sa.select(comparisons).where(comparisons.c.lease_id == lease.id)
    asked = {instance_id(study.id, row.row, row.position): row for row in connection.execute(query)}
    verdicts = []
    for report in reports:
        row = asked.get(report.instance)
        if row is None:
            verdict, detail = "unknown", "the lease does not hold this instance"
        elif row.state != "leased":
            verdict, detail = "duplicate", ""
        elif (fault := fault_in(report, study.plan.outputs)) is not None:
            verdict, detail = "invalid", fault
            _put_back(connection, [row])
        else:
            verdict, detail = "accepted", "a second opinion"
            result = as_result(report, row.row, row.position, study.plan.outputs)
            first = stored.get((row.row, row.position))
            if first is None or not is_comparable(result):
                _put_back(connection, [row])
            else:
                _conclude(connection, row, first, result, lease.worker, host, tolerance, now)
        if row is not None:
            # Each counts once, also within one request.
            asked.pop(report.instance)
        verdicts.append(Verdict(instance=report.instance, verdict=verdict, detail=detail))
    return verdicts


def let_go(connection: Connection, lease: Lease, *, counted: bool) -> None:
    """Have what an ended lease still held wait again; `counted`: its worker fell silent."""
    query = sa.select(comparisons).where(
        comparisons.c.lease_id == lease.id, comparisons.c.state == "leased"
    )
    _put_back(connection, connection.execute(query).all(), counted=counted)


def are_held(connection: Connection, lease: Lease) -> bool:
    """Say whether a lease still holds anything to be compared."""
    query = sa.select(comparisons.c.id).where(
        comparisons.c.lease_id == lease.id, comparisons.c.state == "leased"
    )
    return connection.scalar(query.limit(1)) is not None


def forget(connection: Connection, study: Study, places: Collection[Place]) -> None:
    """Drop open questions about results that were taken back; what was concluded stays."""
    if places:
        connection.execute(
            sa.delete(comparisons).where(
                comparisons.c.study_id == study.id,
                comparisons.c.row == sa.bindparam("at_row"),
                comparisons.c.position == sa.bindparam("at_position"),
                comparisons.c.state != "agreed",
                comparisons.c.state != "disagreed",
            ),
            [{"at_row": row, "at_position": position} for row, position in places],
        )


def give_up(engine: Engine, *, now: float, patience: float) -> None:
    """Ask no more about studies that no longer run and for which nobody came for `patience` s."""
    overdue = sa.and_(comparisons.c.state == "waiting", comparisons.c.asked_at < now - patience)
    with reading(engine) as connection:
        concerned = connection.scalars(
            sa.select(comparisons.c.study_id)
            .join(studies_table, studies_table.c.id == comparisons.c.study_id)
            .where(overdue, studies_table.c.state.in_(("complete", "cancelled")))
            .distinct()
        ).all()
    for study_id in concerned:
        with writing(engine) as connection:
            studies.find(connection, study_id, lock=True)
            connection.execute(
                sa.update(comparisons)
                .where(overdue, comparisons.c.study_id == study_id)
                .values(state="abandoned")
            )


def standings(engine: Engine) -> dict[str, Standing]:
    """Return how every host came out of its comparisons, as the first and as the second."""
    counts: dict[str, dict[str, int]] = {}
    with reading(engine) as connection:
        for host in (comparisons.c.first_host, comparisons.c.second_host):
            query = (
                sa.select(host.label("host"), comparisons.c.state, sa.func.count().label("n"))
                .where(comparisons.c.state.in_(("agreed", "disagreed")))
                .group_by(host, comparisons.c.state)
            )
            for row in connection.execute(query):
                of_host = counts.setdefault(row.host, {})
                of_host[row.state] = of_host.get(row.state, 0) + row.n
    return {host: Standing(**found) for host, found in counts.items()}


def _conclude(
    connection: Connection,
    row: Any,
    first: Result,
    second: Result,
    worker: str,
    host: str,
    tolerance: float,
    now: float,
) -> None:
    agreed = agree(first, second, tolerance)
    if not agreed:
        log.warning(
            "hosts %s and %s disagree on an instance",
            row.first_host,
            host,
            extra={
                "study": row.study_id,
                "instance": instance_id(row.study_id, row.row, row.position),
                "worker": worker,
            },
        )
    connection.execute(
        sa.update(comparisons)
        .where(comparisons.c.id == row.id)
        .values(
            state="agreed" if agreed else "disagreed",
            decided_at=now,
            second_host=host,
            second_worker_id=worker,
            outcome=second.outcome,
            outputs=second.outputs,
            difference=difference(first, second),
        )
    )


def _put_back(connection: Connection, rows: Sequence[Any], *, counted: bool = True) -> None:
    for row in rows:
        attempts = row.attempts + counted
        state = "abandoned" if attempts >= ATTEMPTS else "waiting"
        connection.execute(
            sa.update(comparisons)
            .where(comparisons.c.id == row.id)
            .values(state=state, attempts=attempts, lease_id=None)
        )
