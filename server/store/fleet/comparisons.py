"""Second opinions: what is asked, who was asked, and what came of it.

Whoever changes a study's comparisons has locked the study.
"""

from collections.abc import Collection, Sequence
from dataclasses import fields
from typing import Any

import sqlalchemy as sa
from pydantic_core import from_json
from sqlalchemy.engine import Connection, Dialect

from models.curves import packed, unpacked
from server.records import Comparison, Place
from server.states import ComparisonState, StudyState
from server.store.database.prepared import Prepared, Statement, as_text, text
from server.store.database.schema import comparisons, studies

#: What came of one.
_CONCLUDED = (ComparisonState.AGREED, ComparisonState.DISAGREED)
#: In two halves, each of which an index can find.
_OF_OTHERS = sa.or_(
    comparisons.c.first_host < sa.bindparam("host"), comparisons.c.first_host > sa.bindparam("host")
)
_WAITING = comparisons.c.state == ComparisonState.WAITING
# Built once: every worker that asks for work may ask this.
STUDIES_WAITING = Prepared(
    sa.select(comparisons.c.study_id)
    .where(_WAITING, _OF_OTHERS, comparisons.c.asked_at <= sa.bindparam("asked_by"))
    .distinct(),
    "host",
    "asked_by",
)
_NAMES = [field.name for field in fields(Comparison)]
#: What `comparison_of` takes.
_EVERY = sa.select(
    *(text(comparisons.c[name]) if name == "outputs" else comparisons.c[name] for name in _NAMES)
)
#: Of a study the first ones for a host, and so many at most.
WAITING_FOR = Prepared(
    _EVERY.where(comparisons.c.study_id == sa.bindparam("of_study"), _WAITING, _OF_OTHERS)
    .order_by(comparisons.c.id)
    .limit(sa.bindparam("most")),
    "of_study",
    "host",
    "most",
)
OF_LEASE = Prepared(_EVERY.where(comparisons.c.lease_id == sa.bindparam("of_lease")))
_SAVE = Prepared(
    sa.update(comparisons)
    .where(comparisons.c.id == sa.bindparam("of_comparison"))
    .values({name: sa.bindparam(f"to_{name}") for name in _NAMES[1:]}),
    "of_comparison",
    *(f"to_{name}" for name in _NAMES[1:]),
)


def saving(dialect: Dialect, comparison: Comparison) -> Statement:
    """Return what writes back a comparison that was read in the same transaction."""
    return _SAVE.statement(dialect, *_values(comparison))


def comparison_of(row: Sequence[Any]) -> Comparison:
    """Return the comparison that a row of `_EVERY` holds."""
    found = dict(zip(_NAMES, row, strict=True))
    outputs = found["outputs"]
    found["outputs"] = None if outputs is None else unpacked(from_json(outputs))
    return Comparison(**found | {"state": ComparisonState(found["state"])})


def _values(comparison: Comparison) -> list[Any]:
    found = vars(comparison)
    outputs = comparison.outputs
    return [*(found | {"outputs": None if outputs is None else as_text(packed(outputs))}).values()]


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
