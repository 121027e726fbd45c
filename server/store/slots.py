"""Slots as rows of the table of instances."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import sqlalchemy as sa

from server.logic.slots import Slot
from server.store.engine import JSON
from server.store.prepared import text
from server.store.schema import instances

#: What `from_row` takes.
SLOTS = sa.select(
    instances.c.row,
    instances.c.position,
    instances.c.state,
    instances.c.lease_id,
    text(instances.c.attempts),
    instances.c.host_class,
    instances.c.avoid,
)
#: Names of what `to_row` returns.
COLUMNS = ("study_id", "row", "position", "state", "lease_id", "attempts", "host_class", "avoid")
#: Those of them that many slots of rows that are begun share.
BEGUN = tuple(name for name in COLUMNS if name not in ("row", "position"))

#: In a column of attempts, ends the names of lists of hosts.
_ON = "_on"
#: ... which holds this text if nothing has gone wrong.
_NONE = "{}"


def to_row(study_id: str, slot: Slot) -> tuple[Any, ...]:
    """Return the values of `COLUMNS` for a slot of a study."""
    return (
        study_id,
        slot.row,
        slot.position,
        slot.state,
        slot.lease,
        JSON.encode(_attempts(slot)) if slot.attempts else _NONE,
        slot.host_class,
        slot.avoid,
    )


def of_new_rows(study_id: str, lease: str | None, host_class: str) -> tuple[Any, ...]:
    """Return the values of `BEGUN` for slots of new rows; `lease`: what holds them, None: none."""
    state = "pending" if lease is None else "leased"
    return study_id, state, lease, _NONE, host_class, None


def from_row(row: Sequence[Any]) -> Slot:
    """Return the slot that a row of `SLOTS` holds."""
    number, position, state, lease, stored, host_class, avoid = row
    attempts, hosts = attempts_in(json.loads(stored)) if stored != _NONE else ({}, {})
    return Slot(
        row=number,
        position=position,
        state=state,
        lease=lease,
        attempts=attempts,
        host_class=host_class,
        avoid=avoid,
        hosts=hosts,
    )


def attempts_in(stored: Mapping[str, Any]) -> tuple[dict[str, int], dict[str, tuple[str, ...]]]:
    """Return what a column of attempts holds: how often by cause, and from which hosts."""
    if not stored:
        return {}, {}
    counts = {cause: count for cause, count in stored.items() if not cause.endswith(_ON)}
    hosts = {c.removesuffix(_ON): tuple(found) for c, found in stored.items() if c.endswith(_ON)}
    return counts, hosts


def _attempts(slot: Slot) -> dict[str, Any]:
    on = {f"{cause}{_ON}": list(hosts) for cause, hosts in slot.hosts.items()}
    return {**slot.attempts, **on}
