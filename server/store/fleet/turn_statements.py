"""The statements of turns, over sets of rows, in the words of both kinds of database (see `turns`).

A set of rows travels as one text of JSON: to write arrays takes PostgreSQL's driver a third of the
time of a turn, and SQLite reads one as quickly as it is given values one by one.
"""

from collections.abc import Collection, Iterable, Sequence
from typing import Any

from server.store.database.prepared import Words, as_text


class Sets:
    """A statement about sets.

    Args:
        text: in which %s stands for a value, {any} for "is one of" a set of texts, {told} for a
            table of rows that is called `told`; {index} for how SQLite finds instances that wait.
        sqlite: the same where SQLite has no such words.
        columns: of `told`, with their types on PostgreSQL.
    """

    def __init__(self, text: str, *, sqlite: str | None = None, **columns: str) -> None:
        self._columns = tuple(columns)
        typed = ", ".join(f"{name} {kind}" for name, kind in columns.items())
        picked = ", ".join(f"value ->> {n} AS {name}" for n, name in enumerate(columns))
        postgresql = {
            "{any}": "= ANY(%s::text[])",
            "{told}": f"json_to_recordset(%s::json) AS told({typed})",
            "{index}": "",
        }
        on_sqlite = {
            "{any}": "IN (SELECT value FROM json_each(?))",
            "{told}": f"(SELECT {picked} FROM json_each(?)) AS told",
            # It keeps no statistics by itself, and may choose one that finds far too much.
            "{index}": "INDEXED BY instances_returned",
            "%s": "?",
        }
        self._words = {
            "postgresql": _replaced(text, postgresql),
            "sqlite": _replaced(sqlite or text, on_sqlite),
        }

    def words(self, dialect: str, *values: Any) -> Words:
        """Return it as a driver takes it; of what goes to `any`, `as_set`, to `told`, `as_rows`."""
        return self._words[dialect], values

    def as_rows(self, dialect: str, rows: Iterable[Sequence[Any]]) -> str:
        """Return rows with values in the order of the columns."""
        if dialect == "sqlite":
            return as_text([*rows])
        return as_text([dict(zip(self._columns, row, strict=True)) for row in rows])


def as_set(dialect: str, values: Collection[object]) -> str:
    """Return texts or numbers as `any` takes them.

    On PostgreSQL as it writes an array, in a tenth of the time the driver takes.
    """
    if dialect == "sqlite":
        return as_text([*values])
    quoted = (str(one).replace("\\", "\\\\").replace('"', '\\"') for one in values)
    return "{" + ",".join(f'"{one}"' for one in quoted) + "}"


def _replaced(text: str, words: dict[str, str]) -> str:
    for mark, word in words.items():
        text = text.replace(mark, word)
    return text


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

WORK = Sets("""
SELECT id, model FROM studies
WHERE state = 'running' AND instances > result_count + leased
   OR state = 'draining' AND handed_out > result_count + leased
ORDER BY priority DESC, created_at, id
""")
OPINIONS = Sets(
    _OPINIONS.format("unnest(%s::text[]) AS asked(host)"),
    sqlite=_OPINIONS.format("(SELECT value AS host FROM json_each(%s)) AS asked"),
)
# OFFSET 0 keeps the planner from turning the look-ups into one join.
IN_ROWS = Sets(
    f"""
SELECT {_THERE} FROM unnest(%s::bigint[]) AS asked(row) CROSS JOIN LATERAL
    (SELECT * FROM instances WHERE instances.row = asked.row AND study_id = %s OFFSET 0) AS i
""",
    sqlite=f"""
SELECT {_HERE} FROM instances AS i
WHERE i.row IN (SELECT value FROM json_each(%s)) AND i.study_id = %s
""",
)
_PENDING = """
SELECT {} FROM instances AS i {{index}}
WHERE study_id = %s AND state = 'pending' AND host_class = %s AND row >= %s
ORDER BY row, position LIMIT %s
"""
PENDING = Sets(_PENDING.format(_THERE), sqlite=_PENDING.format(_HERE))
UNBOUND = Sets("""
SELECT row FROM instances {index}
WHERE study_id = %s AND state = 'pending' AND host_class IS NULL LIMIT 1
""")
EXTEND = Sets("""
UPDATE leases SET expires_at = %s WHERE id {any} AND state = 'open' AND expires_at > %s
""")
END = Sets("UPDATE leases SET state = %s WHERE id {any} AND state = 'open'")
# SQLite takes the ON of ON CONFLICT for that of a join, if there is no WHERE.
INTRODUCE = Sets(
    """
INSERT INTO workers
    (last_seen, id, instances_done, host, versions, host_class, tags, models)
SELECT %s, id, done, host, versions, host_class, tags, models FROM {told}
WHERE true
ORDER BY id
ON CONFLICT (id) DO UPDATE SET
    host = excluded.host, versions = excluded.versions, host_class = excluded.host_class,
    tags = excluded.tags, models = excluded.models, last_seen = excluded.last_seen,
    instances_done = workers.instances_done + excluded.instances_done
""",
    id="text",
    done="bigint",
    host="text",
    versions="json",
    host_class="text",
    tags="json",
    models="json",
)
HEARD = Sets(
    "UPDATE workers SET last_seen = %s, instances_done = instances_done + done "
    "FROM {told} WHERE id = name",
    name="text",
    done="bigint",
)
EMPTY = Sets("""
UPDATE instances SET state = %s, lease_id = NULL
WHERE study_id = %s AND row BETWEEN %s AND %s AND lease_id {any}
""")
#: On PostgreSQL; see `instances.MOVE` for SQLite. Again one look-up after the other, and then by
#: where they are. They stay there: whoever changes instances has locked their study.
MOVE = Sets(
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
BEGIN = Sets(
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
LEASE = Sets(
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
APPEND = Sets(
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
ASK = Sets(
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
