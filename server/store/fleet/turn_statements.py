"""The statements of turns, over sets of rows; %s stand for values (see `turns`)."""

WORK = """
SELECT id, model FROM studies
WHERE state = 'running' AND instances > result_count + leased
   OR state = 'draining' AND handed_out > result_count + leased
ORDER BY priority DESC, created_at, id
"""
OPINIONS = """
SELECT host, EXISTS (
    SELECT FROM comparisons WHERE state = 'waiting' AND first_host < host AND asked_at <= by
) OR EXISTS (
    SELECT FROM comparisons WHERE state = 'waiting' AND first_host > host AND asked_at <= by
)
FROM unnest(%s::text[]) AS asked(host) CROSS JOIN CAST(%s AS double precision) AS by
WHERE EXISTS (SELECT FROM comparisons WHERE state = 'waiting' AND first_host < host)
   OR EXISTS (SELECT FROM comparisons WHERE state = 'waiting' AND first_host > host)
"""
INSTANCE = "i.row, i.position, i.state, i.lease_id, i.attempts::text, i.host_class, i.avoid"
# OFFSET 0 keeps the planner from turning the look-ups into one join.
IN_ROWS = f"""
SELECT {INSTANCE} FROM unnest(%s::bigint[]) AS asked(row) CROSS JOIN LATERAL
    (SELECT * FROM instances WHERE study_id = %s AND instances.row = asked.row OFFSET 0) AS i
"""
PENDING = f"""
SELECT {INSTANCE} FROM instances AS i
WHERE study_id = %s AND state = 'pending' AND host_class = %s AND row >= %s
ORDER BY row, position LIMIT %s
"""
UNBOUND = """
SELECT row FROM instances
WHERE study_id = %s AND state = 'pending' AND host_class IS NULL LIMIT 1
"""
EXTEND = """
UPDATE leases SET expires_at = %s WHERE id = ANY(%s::text[]) AND state = 'open' AND expires_at > %s
"""
END = "UPDATE leases SET state = %s WHERE id = ANY(%s::text[]) AND state = 'open'"
INTRODUCE = """
INSERT INTO workers
    (id, instances_done, host, versions, host_class, tags, models, last_seen)
SELECT id, done, host, versions, host_class, tags, models, %s
FROM json_to_recordset(%s::json) AS told(
    id text, done bigint, host text, versions json, host_class text, tags json, models json)
ORDER BY id
ON CONFLICT (id) DO UPDATE SET
    host = excluded.host, versions = excluded.versions, host_class = excluded.host_class,
    tags = excluded.tags, models = excluded.models, last_seen = excluded.last_seen,
    instances_done = workers.instances_done + excluded.instances_done
"""
HEARD = """
UPDATE workers SET last_seen = %s, instances_done = instances_done + done
FROM json_to_recordset(%s::json) AS heard(name text, done bigint) WHERE id = name
"""
EMPTY = """
UPDATE instances SET state = %s, lease_id = NULL
WHERE study_id = %s AND row BETWEEN %s AND %s AND lease_id = ANY(%s::text[])
"""
# Again one look-up after the other, and then by where they are. They stay there: whoever changes
# instances has locked their study.
MOVE = """
UPDATE instances SET state = %s, lease_id = found.lease_id
FROM (
    SELECT i.ctid AS place, moved.lease_id
    FROM json_to_recordset(%s::json) AS moved(row bigint, position int, lease_id text)
    CROSS JOIN LATERAL (
        SELECT instances.ctid FROM instances
        WHERE study_id = %s AND instances.row = moved.row AND instances.position = moved.position
        OFFSET 0
    ) AS i
) AS found WHERE instances.ctid = found.place
"""
BEGIN = """
INSERT INTO instances (study_id, row, position, state, lease_id, attempts, host_class)
SELECT %s, row, position, state, lease_id, '{}', host_class
FROM json_to_recordset(%s::json)
    AS begun(row bigint, position int, state text, lease_id text, host_class text)
"""
LEASE = """
INSERT INTO leases
    (id, worker_id, study_id, state, granted_at, expires_at, instances, host_class, compares)
SELECT id, worker_id, %s, 'open', %s, expires_at, instances, host_class, false
FROM json_to_recordset(%s::json)
    AS granted(id text, worker_id text, expires_at float8, instances json, host_class text)
RETURNING id, fence
"""
APPEND = """
INSERT INTO results
    (study_id, worker_id, received_at, seq, row, position, outcome, outputs, reason, state,
     wall_seconds)
SELECT %s, worker_id, %s, seq, row, position, outcome, outputs, reason, state, wall_seconds
FROM json_to_recordset(%s::json) AS filed(
    worker_id text, seq bigint, row bigint, position int, outcome text, outputs json, reason text,
    state json, wall_seconds float8)
"""
ASK = """
INSERT INTO comparisons
    (study_id, state, attempts, asked_at, first_host, first_worker_id, row, position)
SELECT %s, 'waiting', 0, %s, host, worker_id, row, position
FROM json_to_recordset(%s::json) AS asked(host text, worker_id text, row bigint, position int)
"""
