"""Second opinions: what is asked, who was asked, and what came of it.

Whoever changes a study's comparisons has locked the study.
"""

from collections.abc import Collection, Sequence
from dataclasses import fields

import sqlalchemy as sa
from sqlalchemy.engine import Connection

from server.records import Comparison, Place
from server.states import ComparisonState, StudyState
from server.store.database.prepared import Prepared, Rows
from server.store.database.schema import comparisons, studies

#: What came of one.
_CONCLUDED = (ComparisonState.AGREED, ComparisonState.DISAGREED)
#: In two halves, each of which an index can find.
_OF_OTHERS = sa.or_(
    comparisons.c.first_host < sa.bindparam("host"), comparisons.c.first_host > sa.bindparam("host")
)
_WAITING = comparisons.c.state == ComparisonState.WAITING
#: Built once: every worker that asks for work asks this.
_STUDIES_WAITING = Prepared(
    sa.select(comparisons.c.study_id)
    .where(_WAITING, _OF_OTHERS, comparisons.c.asked_at <= sa.bindparam("asked_by"))
    .distinct()
)
_ADD = Rows(
    comparisons,
    same=("study_id", "state", "attempts", "asked_at", "first_host", "first_worker_id"),
    each=("row", "position"),
)
_EVERY = sa.select(*(comparisons.c[field.name] for field in fields(Comparison)))


def add(
    connection: Connection,
    study_id: str,
    places: Sequence[Place],
    *,
    host: str,
    worker: str,
    now: float,
) -> None:
    """Ask for second opinions on a host's results at `places`."""
    _ADD.add(connection, (study_id, ComparisonState.WAITING, 0, now, host, worker), places)


def studies_waiting(connection: Connection, *, host: str, asked_by: float) -> list[str]:
    """Return the studies in which a second opinion of `host` was asked for by then."""
    found = _STUDIES_WAITING.execute(connection, host, asked_by).fetchall()
    return [study_id for (study_id,) in found]


def hand_out(
    connection: Connection, study_id: str, *, host: str, lease: str, limit: int
) -> list[Place]:
    """Give up to `limit` results of other hosts to a lease of `host`; return their places."""
    query = _EVERY.where(comparisons.c.study_id == study_id, _WAITING, _OF_OTHERS)
    query = query.order_by(comparisons.c.id).limit(limit)
    found = connection.execute(query, {"host": host}).all()
    if found:
        connection.execute(
            sa.update(comparisons)
            .where(comparisons.c.id.in_([row.id for row in found]))
            .values(state=ComparisonState.LEASED, lease_id=lease)
        )
    return [(row.row, row.position) for row in found]


def of_lease(connection: Connection, lease: str) -> list[Comparison]:
    """Return what a lease was given."""
    query = _EVERY.where(comparisons.c.lease_id == lease)
    return [
        Comparison(**{**row._mapping, "state": ComparisonState(row.state)})
        for row in connection.execute(query)
    ]


def save(connection: Connection, comparison: Comparison) -> None:
    """Write back a comparison that was read in the same transaction."""
    connection.execute(
        sa.update(comparisons).where(comparisons.c.id == comparison.id).values(vars(comparison))
    )


def forget(connection: Connection, study_id: str, places: Collection[Place]) -> None:
    """Drop open questions about results that were taken back; what was concluded stays."""
    if places:
        connection.execute(
            sa.delete(comparisons).where(
                comparisons.c.study_id == study_id,
                comparisons.c.row == sa.bindparam("at_row"),
                comparisons.c.position == sa.bindparam("at_position"),
                # Not NOT IN: it could not be executed many times at once.
                *(comparisons.c.state != state for state in _CONCLUDED),
            ),
            [{"at_row": row, "at_position": position} for row, position in places],
        )


def ended_studies_waiting(connection: Connection, *, asked_before: float) -> Sequence[str]:
    """Return the studies that have ended and wait for a second opinion asked for before then."""
    ended = studies.c.state.in_([state for state in StudyState if state.has_ended])
    query = (
        sa.select(comparisons.c.study_id)
        .join(studies, studies.c.id == comparisons.c.study_id)
        .where(_WAITING, comparisons.c.asked_at < asked_before, ended)
        .distinct()
    )
    return connection.scalars(query).all()


def abandon(connection: Connection, study_id: str, *, asked_before: float) -> None:
    """Ask no more for a study's second opinions that were asked for before then."""
    connection.execute(
        sa.update(comparisons)
        .where(_WAITING, comparisons.c.asked_at < asked_before, comparisons.c.study_id == study_id)
        .values(state=ComparisonState.ABANDONED)
    )


def counts(connection: Connection) -> dict[str, dict[str, int]]:
    """Return by host how often it agreed and disagreed, as the first and as the second."""
    found: dict[str, dict[str, int]] = {}
    for host in (comparisons.c.first_host, comparisons.c.second_host):
        query = (
            sa.select(host.label("host"), comparisons.c.state, sa.func.count().label("n"))
            .where(comparisons.c.state.in_(_CONCLUDED))
            .group_by(host, comparisons.c.state)
        )
        for row in connection.execute(query):
            of_host = found.setdefault(row.host, {})
            of_host[row.state] = of_host.get(row.state, 0) + row.n
    return found
