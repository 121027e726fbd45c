"""Instances of the rows that were begun: where each stands, and what went wrong with it."""

import json
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

import sqlalchemy as sa
from sqlalchemy.engine import Connection, Dialect

from server.records import Instance
from server.states import InstanceState
from server.store.database.engine import JSON
from server.store.database.prepared import Prepared, Statement, text
from server.store.database.schema import instances

#: Values in one IN list: well under what any SQLite takes.
IN_LIST = 500

#: Names of what `to_row` returns.
_COLUMNS = ("study_id", "row", "position", "state", "lease_id", "attempts", "host_class", "avoid")
#: In a column of attempts, ends the names of lists of hosts.
_ON = "_on"
#: ... which holds this text if nothing has gone wrong.
_NONE = "{}"
_STATES = {state.value: state for state in InstanceState}

# Statements that every lease and every post executes are built once: building one takes SQLAlchemy
# longer than executing it takes the database.
#: What `from_row` takes.
EVERY = sa.select(
    *(text(instances.c[name]) if name == "attempts" else instances.c[name] for name in _COLUMNS[1:])
)
_OF_STUDY = instances.c.study_id == sa.bindparam("of_study")
_TRIED_HERE = sa.and_(
    instances.c.avoid.is_not(None),
    sa.or_(
        instances.c.avoid == sa.bindparam("asking_host"),
        # No host's name holds the character that would escape others.
        sa.cast(instances.c.attempts, sa.Text).contains(sa.bindparam("as_json"), escape="\x1f"),
    ),
)


def _pending(*conditions: sa.ColumnElement[bool]) -> tuple[Prepared, Prepared]:
    """Return what finds pending instances of one kind of machine, and of none.

    Both at once would be beyond the index: all instances ever begun would be looked through.
    """
    # As the index has it: a plan that is made once cannot rely on a parameter.
    found = EVERY.where(_OF_STUDY, instances.c.state == sa.literal_column("'pending'"), *conditions)
    found = found.order_by(instances.c.row, instances.c.position).limit(sa.bindparam("most"))
    names = ("of_study", "asking_class", "most", "asking_host", "as_json")
    mine = instances.c.host_class == sa.bindparam("asking_class")
    none = instances.c.host_class.is_(None)
    return (
        Prepared(found.where(mine), *names, index="instances_returned"),
        Prepared(found.where(none), *names, index="instances_returned"),
    )


_PENDING = {None: _pending(), False: _pending(sa.not_(_TRIED_HERE)), True: _pending(_TRIED_HERE)}
_BY_CLASS = Prepared(
    sa.select(instances.c.host_class, sa.func.count())
    .where(_OF_STUDY, instances.c.state == sa.literal_column("'pending'"))
    .group_by(instances.c.host_class),
    "of_study",
    index="instances_returned",
)
_UPDATE = sa.update(instances).where(
    _OF_STUDY,
    instances.c.row == sa.bindparam("at_row"),
    instances.c.position == sa.bindparam("at_position"),
)
#: Most of what workers post changes no more than this.
MOVE = Prepared(_UPDATE.values(state=sa.bindparam("to_state"), lease_id=sa.bindparam("to_lease")))
REWRITE = Prepared(
    _UPDATE.values({name: sa.bindparam(f"to_{name}") for name in _COLUMNS[3:]}),
    "of_study",
    "at_row",
    "at_position",
    *(f"to_{name}" for name in _COLUMNS[3:]),
)
#: Leaves what of a row any kind of machine could have taken to one kind.
BIND = Prepared(
    sa.update(instances)
    .where(_OF_STUDY, instances.c.row == sa.bindparam("at_row"), instances.c.host_class.is_(None))
    .values(host_class=sa.bindparam("to_class"))
)


def pending(
    dialect: Dialect, study_id: str, host_class: str, host: str, *, tried: bool | None, limit: int
) -> list[Statement]:
    """Return what finds instances of begun rows that wait for a machine.

    Each of the statements finds the first `limit` by row and position; see `from_row`.

    Args:
        dialect: of the database.
        study_id: the study.
        host_class: a kind of machine; rows of another kind are left out.
        host: a machine of that kind.
        tried: only those that have gone wrong on `host`, or only those that have not; None: both.
        limit: so many at most.
    """
    values = (study_id, host_class, limit, host, JSON.encode(host))
    return [query.statement(dialect, *values) for query in _PENDING[tried]]


def waiting_by_class(connection: Connection, study_id: str) -> dict[str | None, int]:
    """Return how many instances of begun rows nobody holds, by kind of machine; None: any."""
    return dict(_BY_CLASS.execute(connection, study_id).fetchall())


def update(connection: Connection, study_id: str, changed: Iterable[Instance]) -> None:
    """Write instances that exist already."""
    REWRITE.execute_many(connection, [to_row(study_id, one) for one in changed])


def chunks(values: Collection[int]) -> Iterable[list[int]]:
    """Cut values into lists that fit into one query."""
    ordered = sorted(values)
    for start in range(0, len(ordered), IN_LIST):
        yield ordered[start : start + IN_LIST]


def attempts_in(stored: Mapping[str, Any]) -> tuple[dict[str, int], dict[str, tuple[str, ...]]]:
    """Return what a column of attempts holds: how often by cause, and from which hosts."""
    if not stored:
        return {}, {}
    counts = {cause: count for cause, count in stored.items() if not cause.endswith(_ON)}
    hosts = {c.removesuffix(_ON): tuple(found) for c, found in stored.items() if c.endswith(_ON)}
    return counts, hosts


def to_row(study_id: str, one: Instance) -> tuple[Any, ...]:
    """Return the values of `REWRITE` for an instance of a study."""
    on = {f"{cause}{_ON}": list(hosts) for cause, hosts in one.hosts.items()}
    attempts = JSON.encode({**one.attempts, **on}) if one.attempts else _NONE
    where = (study_id, one.row, one.position)
    return *where, one.state, one.lease, attempts, one.host_class, one.avoid


def from_row(row: Sequence[Any]) -> Instance:
    """Return the instance that a row of `EVERY` holds."""
    number, position, state, lease, stored, host_class, avoid = row
    attempts, hosts = attempts_in(json.loads(stored)) if stored != _NONE else ({}, {})
    return Instance(
        row=number,
        position=position,
        state=_STATES[state],
        lease=lease,
        attempts=attempts,
        host_class=host_class,
        avoid=avoid,
        hosts=hosts,
    )
