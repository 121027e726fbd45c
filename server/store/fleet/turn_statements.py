"""The statements of turns, over sets of rows, in the SQL of both databases (see `turns`).

On PostgreSQL a set of rows travels as one text of JSON: to write arrays takes its driver a third of
the time of a turn. SQLite takes twice as long over JSON as over values one by one.
"""

import re
from collections.abc import Sequence
from functools import cache
from itertools import chain
from typing import Any

from sqlalchemy.engine import Dialect

from server.store.database.prepared import ROWS, Statement, as_text

#: Where values go.
_MARK = re.compile(r"%s|\{any\}|\{each\}|\{told\}")


class SetStatement:
    """A statement about sets.

    Args:
        text: in which %s stands for a value, {any} for "is one of" a set, {told} for a table of
            rows that is called `told`; {index} for how SQLite finds what waits.
        sqlite: the same where SQLite writes it otherwise; {each} for a set as a table.
        columns: of `told`, with their types on PostgreSQL.
    """

    def __init__(self, text: str, *, sqlite: str | None = None, **columns: str) -> None:
        self._columns = tuple(columns)
        self._json = {n for n, type_ in enumerate(columns.values()) if type_ == "json"}
        typed = ", ".join(f"{name} {type_}" for name, type_ in columns.items())
        told = f"json_to_recordset(%s::json) AS told({typed})"
        self._postgresql = (
            text.replace("{any}", "= ANY(%s::text[])")
            .replace("{told}", told)
            .replace("{index}", "")
        )
        # It keeps no statistics by itself, and may choose one that finds far too much.
        indexed = (sqlite or text).replace("{index}", "INDEXED BY instances_returned")
        self._between = _MARK.split(indexed)
        self._marks = _MARK.findall(indexed)
        self._on_sqlite = cache(self._for_sqlite)

    def statements(self, dialect: Dialect, *values: Any) -> list[Statement]:
        """Return what a driver takes: on SQLite so many rows at a time.

        Args:
            dialect: of the database.
            values: in their order, of sets and rows lists; of what is JSON, not yet as text.
        """
        if dialect.name == "postgresql":
            return [(self._postgresql, [self._as_text(one) for one in values])]
        if not self._columns:
            return [self._few(values)]
        at = self._marks.index("{told}")
        rows = values[at]
        parts = [rows[start : start + ROWS] for start in range(0, len(rows), ROWS)]
        return [self._few((*values[:at], part, *values[at + 1 :])) for part in parts]

    def _as_text(self, value: Any) -> Any:
        if not isinstance(value, list):
            return value
        if self._columns:
            return as_text([dict(zip(self._columns, row, strict=True)) for row in value])
        # As PostgreSQL writes an array, in a tenth of the time the driver takes.
        quoted = (str(one).replace("\\", "\\\\").replace('"', '\\"') for one in value)
        return "{" + ",".join(f'"{one}"' for one in quoted) + "}"

    def _few(self, values: Sequence[Any]) -> Statement:
        given: list[Any] = []
        counts = []
        for mark, value in zip(self._marks, values, strict=True):
            if mark == "%s":
                given.append(value)
            elif mark == "{any}":
                # Some more than there are, so that there are not so many statements to know.
                many = [*value, *value[-1:] * (_at_least(len(value)) - len(value))]
                counts.append(len(many))
                given += many
            elif mark == "{each}":
                given.append(as_text(value))
            else:
                counts.append(len(value))
                given += (
                    chain.from_iterable(map(self._row, value))
                    if self._json
                    else (chain.from_iterable(value))
                )
        return self._on_sqlite(*counts), given

    def _row(self, row: Sequence[Any]) -> list[Any]:
        return [
            as_text(one) if n in self._json and one is not None else one
            for n, one in enumerate(row)
        ]

    def _for_sqlite(self, *counts: int) -> str:
        """Return the text for sets of so many."""
        left = iter(counts)
        found = self._between[0]
        for mark, after in zip(self._marks, self._between[1:], strict=True):
            if mark == "%s":
                found += "?"
            elif mark == "{each}":
                found += "json_each(?)"
            elif mark == "{any}":
                found += f"IN ({_listed('?', next(left))})"
            else:
                row = f"({_listed('?', len(self._columns))})"
                named = (f"column{n} AS {name}" for n, name in enumerate(self._columns, start=1))
                values = f"VALUES {_listed(row, next(left))}"
                found += f"(SELECT {', '.join(named)} FROM ({values})) AS told"
            found += after
        return found


def _listed(one: str, count: int) -> str:
    return ", ".join([one] * count)


def _at_least(count: int) -> int:
    """Return the power of two that is no less."""
    return 1 << (count - 1).bit_length() if count else 0


_OPINIONS = """
SELECT host, EXISTS (
    SELECT 1 FROM comparisons WHERE state = 'waiting' AND first_host < host AND asked_at <= asked_by
) OR EXISTS (
    SELECT 1 FROM comparisons WHERE state = 'waiting' AND first_host > host AND asked_at <= asked_by
)
FROM {} CROSS JOIN (SELECT CAST(%s AS double precision) AS asked_by) AS latest
WHERE EXISTS (SELECT 1 FROM comparisons WHERE state = 'waiting' AND first_host < host)
   OR EXISTS (SELECT 1 FROM comparisons WHERE state = 'waiting' AND first_host > host)
"""
_INSTANCE = "i.row, i.position, i.state, i.lease_id, {}, i.host_class, i.avoid"
_HERE, _THERE = _INSTANCE.format("i.attempts"), _INSTANCE.format("i.attempts::text")

_LEASES = """
SELECT leases.id, fence, worker_id, study_id, state, expires_at, {}, leases.host_class, host,
    compares
FROM leases JOIN workers ON workers.id = worker_id WHERE leases.id {{any}}
"""

#: See `leases.lease_of`.
LEASES = SetStatement(_LEASES.format("instances::text"), sqlite=_LEASES.format("instances"))
WORK = SetStatement("""
SELECT id, model FROM studies
WHERE state = 'running' AND instances > result_count + leased
   OR state = 'draining' AND handed_out > result_count + leased
ORDER BY priority DESC, created_at, id
""")
OPINIONS = SetStatement(
    _OPINIONS.format("unnest(%s::text[]) AS asked(host)"),
    sqlite=_OPINIONS.format("(SELECT value AS host FROM {each}) AS asked"),
)
# OFFSET 0 keeps the planner from turning the look-ups into one join.
IN_ROWS = SetStatement(
    f"""
SELECT {_THERE} FROM unnest(%s::bigint[]) AS asked(row) CROSS JOIN LATERAL
    (SELECT * FROM instances WHERE instances.row = asked.row AND study_id = %s OFFSET 0) AS i
""",
    sqlite=f"SELECT {_HERE} FROM instances AS i WHERE i.row {{any}} AND i.study_id = %s",
)
_PENDING = """
SELECT {} FROM instances AS i {{index}}
WHERE study_id = %s AND state = 'pending' AND host_class = %s AND row >= %s
ORDER BY row, position LIMIT %s
"""
PENDING = SetStatement(_PENDING.format(_THERE), sqlite=_PENDING.format(_HERE))
UNBOUND = SetStatement("""
SELECT row FROM instances {index}
WHERE study_id = %s AND state = 'pending' AND host_class IS NULL LIMIT 1
""")
# That they are open is told by a value, or PostgreSQL takes the index of those that are: it looks
# through all of a fleet's leases, and through those of the last minute that are over.
EXTEND = SetStatement(
    "UPDATE leases SET expires_at = %s WHERE state = %s AND expires_at > %s AND id {any}"
)
END = SetStatement("UPDATE leases SET state = %s WHERE state = %s AND id {any}")
#: On PostgreSQL.
LOCK_WORKERS = SetStatement("SELECT id FROM workers WHERE id {any} ORDER BY id FOR NO KEY UPDATE")
# SQLite takes the ON of ON CONFLICT for that of a join, if there is no WHERE.
INTRODUCE = SetStatement(
    """
INSERT INTO workers
    (last_seen, id, instances_done, host, versions, host_class, tags, models, refused)
SELECT %s, id, done, host, versions, host_class, tags, models, refused FROM {told}
WHERE true
ORDER BY id
ON CONFLICT (id) DO UPDATE SET
    host = excluded.host, versions = excluded.versions, host_class = excluded.host_class,
    tags = excluded.tags, models = excluded.models, refused = excluded.refused,
    last_seen = excluded.last_seen,
    instances_done = workers.instances_done + excluded.instances_done
""",
    id="text",
    done="bigint",
    host="text",
    versions="json",
    host_class="text",
    tags="json",
    models="json",
    refused="json",
)
HEARD = SetStatement(
    "UPDATE workers SET last_seen = %s, instances_done = instances_done + done "
    "FROM {told} WHERE id = name",
    name="text",
    done="bigint",
)
EMPTY = SetStatement("""
UPDATE instances SET state = %s, lease_id = NULL
WHERE study_id = %s AND row BETWEEN %s AND %s AND lease_id {any}
""")
#: On PostgreSQL; see `instances.MOVE` for SQLite. Again one look-up after the other, and then by
#: where they are. They stay there: whoever changes instances has locked their study.
MOVE = SetStatement(
    """
UPDATE instances SET state = %s, lease_id = found.lease_id
FROM (
    SELECT i.ctid AS place, told.lease_id
    FROM {told}
    CROSS JOIN LATERAL (
        SELECT instances.ctid FROM instances
        WHERE study_id = %s AND instances.row = told.row AND instances.position = told.position
        OFFSET 0
    ) AS i
) AS found WHERE instances.ctid = found.place
""",
    row="bigint",
    position="int",
    lease_id="text",
)
BEGIN = SetStatement(
    """
INSERT INTO instances (study_id, attempts, row, position, state, lease_id, host_class)
SELECT %s, '{}', row, position, state, lease_id, host_class FROM {told}
""",
    row="bigint",
    position="int",
    state="text",
    lease_id="text",
    host_class="text",
)
LEASE = SetStatement(
    """
INSERT INTO leases
    (study_id, state, granted_at, id, worker_id, expires_at, instances, host_class, compares)
SELECT %s, 'open', %s, id, worker_id, expires_at, instances, host_class, compares FROM {told}
WHERE true
RETURNING id, fence
""",
    id="text",
    worker_id="text",
    expires_at="float8",
    instances="json",
    host_class="text",
    compares="boolean",
)
APPEND = SetStatement(
    """
INSERT INTO results
    (study_id, received_at, worker_id, seq, row, position, outcome, outputs, reason, state,
     wall_seconds)
SELECT %s, %s, worker_id, seq, row, position, outcome, outputs, reason, state, wall_seconds
FROM {told}
""",
    worker_id="text",
    seq="bigint",
    row="bigint",
    position="int",
    outcome="text",
    outputs="json",
    reason="text",
    state="json",
    wall_seconds="float8",
)
ASK = SetStatement(
    """
INSERT INTO comparisons
    (study_id, state, attempts, asked_at, first_host, first_worker_id, row, position)
SELECT %s, 'waiting', 0, %s, host, worker_id, row, position FROM {told}
""",
    host="text",
    worker_id="text",
    row="bigint",
    position="int",
)
