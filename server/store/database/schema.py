"""The tables as queries see them. Alembic makes them: see `migrations/versions`.

What a column holds is said where it is read: in `server.records`.
"""

from typing import Any

import sqlalchemy as sa

from models.curves import packed, unpacked

metadata = sa.MetaData()


class Outputs(sa.types.TypeDecorator[Any]):
    """Outputs as JSON, the points of each curve as one text (`models.curves.packed`)."""

    impl = sa.JSON(none_as_null=True)
    cache_ok = True

    def process_bind_param(self, value: Any, dialect: sa.Dialect) -> Any:
        """Return what is stored."""
        return None if value is None else packed(value)

    def process_result_value(self, value: Any, dialect: sa.Dialect) -> Any:
        """Return what was given."""
        return None if value is None else unpacked(value)


def _reported() -> list[sa.Column[Any]]:
    """Return the columns of a result that is kept as evidence."""
    return [
        sa.Column("id", sa.BigInteger().with_variant(sa.Integer, "sqlite"), primary_key=True),
        sa.Column("study_id", sa.ForeignKey("studies.id"), nullable=False, index=True),
        sa.Column("row", sa.BigInteger, nullable=False),
        sa.Column("position", sa.Integer, nullable=False),
        sa.Column("outcome", sa.String(40), nullable=False),
        sa.Column("outputs", Outputs),
        sa.Column("reason", sa.Text, nullable=False),
        sa.Column("worker_id", sa.ForeignKey("workers.id"), nullable=False),
        sa.Column("received_at", sa.Double, nullable=False),
    ]


#: One row per study: its plan, and counters that make its progress cheap to tell. Whoever changes
#: a study's instances or results locks this row first.
studies = sa.Table(
    "studies",
    metadata,
    sa.Column("id", sa.String(32), primary_key=True),
    sa.Column("name", sa.String(200), nullable=False),
    sa.Column("model", sa.String(64), nullable=False),
    sa.Column("method", sa.String(32), nullable=False),
    sa.Column("sampling", sa.String(32), nullable=False),
    sa.Column("rows", sa.BigInteger, nullable=False),
    sa.Column("seed", sa.BigInteger, nullable=False),
    sa.Column("distributions", sa.JSON, nullable=False),
    sa.Column("fixed", sa.JSON, nullable=False),
    sa.Column("outputs", sa.JSON, nullable=False),
    sa.Column("curves", sa.JSON, nullable=False, server_default="{}"),
    sa.Column("groups", sa.JSON, nullable=False, server_default="[]"),
    sa.Column("state", sa.String(16), nullable=False),
    sa.Column("created_at", sa.Double, nullable=False),
    sa.Column("finished_at", sa.Double),
    sa.Column("idempotency_key", sa.String(255), unique=True),
    sa.Column("request_digest", sa.String(64), nullable=False),
    sa.Column("instances", sa.BigInteger, nullable=False),
    sa.Column("handed_out", sa.BigInteger, nullable=False),
    sa.Column("leased", sa.BigInteger, nullable=False),
    sa.Column("result_count", sa.BigInteger, nullable=False),
    sa.Column("ok_count", sa.BigInteger, nullable=False),
    sa.Column("rows_complete", sa.BigInteger, nullable=False),
    sa.Column("failures", sa.JSON, nullable=False),
    sa.Column("priority", sa.Integer, nullable=False, server_default="0"),
    sa.Column("tags", sa.JSON, nullable=False, server_default="[]"),
    sa.Column("identity", sa.JSON(none_as_null=True)),
    sa.Column("edition", sa.BigInteger, nullable=False, server_default="0"),
    sa.Column("dependence", sa.JSON(none_as_null=True)),
    sa.Index("studies_by_age", "state", "created_at", "id"),
)

#: Instances of the rows that were begun. The others need no row here: they are the study's next
#: ones, and the parameters of any are a pure function of its study, row and position.
instances = sa.Table(
    "instances",
    metadata,
    sa.Column("study_id", sa.ForeignKey("studies.id"), primary_key=True),
    sa.Column("row", sa.BigInteger, primary_key=True),
    sa.Column("position", sa.Integer, primary_key=True),
    sa.Column("state", sa.String(16), nullable=False),
    sa.Column("lease_id", sa.String(32)),
    sa.Column("attempts", sa.JSON, nullable=False),
    sa.Column("host_class", sa.String(16)),
    sa.Column("avoid", sa.String(255)),
    sqlite_with_rowid=False,
)
sa.Index(
    "instances_returned",
    instances.c.study_id,
    instances.c.host_class,
    instances.c.row,
    instances.c.position,
    sqlite_where=instances.c.state == "pending",
    postgresql_where=instances.c.state == "pending",
)

#: Every lease ever granted, so that late results can still be told from forged ones.
leases = sa.Table(
    "leases",
    metadata,
    sa.Column("fence", sa.BigInteger().with_variant(sa.Integer, "sqlite"), primary_key=True),
    sa.Column("id", sa.String(32), nullable=False, unique=True),
    sa.Column("worker_id", sa.ForeignKey("workers.id"), nullable=False),
    sa.Column("study_id", sa.ForeignKey("studies.id"), nullable=False),
    sa.Column("state", sa.String(16), nullable=False),
    sa.Column("granted_at", sa.Double, nullable=False),
    sa.Column("expires_at", sa.Double, nullable=False),
    sa.Column("instances", sa.JSON, nullable=False),
    sa.Column("host_class", sa.String(16)),
    sa.Column("compares", sa.Boolean, nullable=False, server_default=sa.false()),
    sqlite_autoincrement=True,
)
sa.Index(
    "leases_open",
    leases.c.expires_at,
    sqlite_where=leases.c.state == "open",
    postgresql_where=leases.c.state == "open",
)

#: The one final result of an instance, numbered per study in the order of arrival.
results = sa.Table(
    "results",
    metadata,
    sa.Column("study_id", sa.ForeignKey("studies.id"), primary_key=True),
    sa.Column("seq", sa.BigInteger, primary_key=True, autoincrement=False),
    sa.Column("row", sa.BigInteger, nullable=False),
    sa.Column("position", sa.Integer, nullable=False),
    sa.Column("outcome", sa.String(40), nullable=False),
    sa.Column("outputs", Outputs),
    sa.Column("reason", sa.Text, nullable=False),
    sa.Column("state", sa.JSON(none_as_null=True)),
    sa.Column("wall_seconds", sa.Double),
    sa.Column("worker_id", sa.ForeignKey("workers.id"), nullable=False),
    sa.Column("received_at", sa.Double, nullable=False),
    sa.Index("results_by_instance", "study_id", "row", "position", unique=True),
)
sa.Index(
    "results_failed",
    results.c.study_id,
    results.c.outcome,
    results.c.seq,
    sqlite_where=results.c.outcome != "ok",
    postgresql_where=results.c.outcome != "ok",
)

#: That a result is that of an instance.
OF_INSTANCE = sa.and_(
    results.c.study_id == instances.c.study_id,
    results.c.row == instances.c.row,
    results.c.position == instances.c.position,
)

#: Results that contradict a stored one: evidence about a host, never used in an estimate.
conflicts = sa.Table(
    "conflicts",
    metadata,
    *_reported(),
)

#: Final results that were taken back so that their instances could run again: kept as evidence.
superseded = sa.Table(
    "superseded",
    metadata,
    *_reported(),
    sa.Column("superseded_at", sa.Double, nullable=False),
    sa.Column("why", sa.String(200), nullable=False),
)

#: Results that another host is to compute again, and what came of it: evidence about both hosts,
#: never used in an estimate. `outcome` and `outputs` are the second host's.
comparisons = sa.Table(
    "comparisons",
    metadata,
    sa.Column("id", sa.BigInteger().with_variant(sa.Integer, "sqlite"), primary_key=True),
    sa.Column("study_id", sa.ForeignKey("studies.id"), nullable=False),
    sa.Column("row", sa.BigInteger, nullable=False),
    sa.Column("position", sa.Integer, nullable=False),
    sa.Column("state", sa.String(16), nullable=False),
    sa.Column("attempts", sa.Integer, nullable=False),
    sa.Column("lease_id", sa.String(32), index=True),
    sa.Column("asked_at", sa.Double, nullable=False),
    sa.Column("decided_at", sa.Double),
    sa.Column("first_host", sa.String(255), nullable=False),
    sa.Column("first_worker_id", sa.ForeignKey("workers.id"), nullable=False),
    sa.Column("second_host", sa.String(255)),
    sa.Column("second_worker_id", sa.ForeignKey("workers.id")),
    sa.Column("outcome", sa.String(40)),
    sa.Column("outputs", Outputs),
    sa.Column("difference", sa.Double),
    sa.Index("comparisons_by_state", "state", "first_host"),
    sa.Index("comparisons_by_instance", "study_id", "row", "position"),
)

#: Who may do what, besides the operator's own token. Of a secret only its digest is kept.
tokens = sa.Table(
    "tokens",
    metadata,
    sa.Column("id", sa.String(16), primary_key=True),
    sa.Column("name", sa.String(128), nullable=False),
    sa.Column("scopes", sa.JSON, nullable=False),
    sa.Column("digest", sa.String(64), nullable=False, unique=True),
    sa.Column("created_at", sa.Double, nullable=False),
    sa.Column("revoked_at", sa.Double),
)

#: Codes that sign a browser in, once, until a moment (seconds, UTC epoch). Of a code only its
#: digest is kept; `who` is a token's id, or the operator.
sign_in_codes = sa.Table(
    "sign_in_codes",
    metadata,
    sa.Column("digest", sa.String(64), primary_key=True),
    sa.Column("who", sa.String(16), nullable=False),
    sa.Column("good_until", sa.Double, nullable=False),
)

#: Who has ever asked for work.
workers = sa.Table(
    "workers",
    metadata,
    sa.Column("id", sa.String(128), primary_key=True),
    sa.Column("host", sa.String(255), nullable=False),
    sa.Column("versions", sa.JSON, nullable=False),
    sa.Column("last_seen", sa.Double, nullable=False),
    sa.Column("instances_done", sa.BigInteger, nullable=False),
    sa.Column("host_class", sa.String(16)),
    sa.Column("tags", sa.JSON, nullable=False, server_default="[]"),
    #: What it can evaluate besides rehyb's own models, as "name@digest".
    sa.Column("models", sa.JSON, nullable=False, server_default="[]"),
    #: Models, "name@digest", that it does not evaluate, and why.
    sa.Column("refused", sa.JSON, nullable=False, server_default="{}"),
)

#: Models: rehyb's own, uploaded ones, and those whose code is with workers.
models = sa.Table(
    "models",
    metadata,
    #: "name@digest".
    sa.Column("version", sa.String(64), primary_key=True),
    sa.Column("name", sa.String(64), nullable=False, index=True),
    sa.Column("description", sa.JSON, nullable=False),
    sa.Column("own", sa.Boolean, nullable=False),
    sa.Column("announced_by", sa.String(128), nullable=False),
    sa.Column("announced_at", sa.Double, nullable=False),
    #: Bytes of the zip file.
    sa.Column("size", sa.BigInteger, nullable=False),
)

#: The zip files, cut up so that nobody needs to hold one in memory.
model_parts = sa.Table(
    "model_parts",
    metadata,
    sa.Column("version", sa.ForeignKey("models.version"), primary_key=True),
    sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),
    sa.Column("content", sa.LargeBinary, nullable=False),
)

#: Where the analysis of a study stands; `cursor` is the last result it has taken in.
estimator_states = sa.Table(
    "estimator_states",
    metadata,
    sa.Column("study_id", sa.ForeignKey("studies.id"), primary_key=True),
    sa.Column("cursor", sa.BigInteger, nullable=False),
    sa.Column("state", sa.LargeBinary, nullable=False),
)

#: What the analysis last published about a study.
snapshots = sa.Table(
    "snapshots",
    metadata,
    sa.Column("study_id", sa.ForeignKey("studies.id"), primary_key=True),
    sa.Column("snapshot", sa.JSON, nullable=False),
)

#: Measured sessions whose zip files passed the check. `content` is what was understood of one.
sessions = sa.Table(
    "sessions",
    metadata,
    sa.Column("id", sa.String(32), primary_key=True),
    sa.Column("name", sa.String(128), nullable=False),
    #: Of the zip file: the same bytes are the same session.
    sa.Column("sha256", sa.String(64), nullable=False, unique=True),
    sa.Column("size", sa.BigInteger, nullable=False),
    sa.Column("content", sa.JSON, nullable=False),
    sa.Column("created_at", sa.Double, nullable=False),
)

#: The zip files, cut up so that nobody needs to hold one in memory.
session_parts = sa.Table(
    "session_parts",
    metadata,
    sa.Column("session_id", sa.ForeignKey("sessions.id"), primary_key=True),
    sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),
    sa.Column("content", sa.LargeBinary, nullable=False),
)

#: Closing the loop on a session, or interpreting it, once for each code that was asked to.
close_loops = sa.Table(
    "close_loops",
    metadata,
    sa.Column("id", sa.String(32), primary_key=True),
    sa.Column("session_id", sa.ForeignKey("sessions.id"), nullable=False, index=True),
    sa.Column("state", sa.String(16), nullable=False),
    sa.Column("created_at", sa.Double, nullable=False),
    sa.Column("finished_at", sa.Double),
    sa.Column("expires_at", sa.Double),
    sa.Column("grants", sa.Integer, nullable=False),
    sa.Column("attempts", sa.JSON, nullable=False),
    sa.Column("progress", sa.Text, nullable=False),
    sa.Column("code", sa.String(16)),
    sa.Column("fault", sa.JSON(none_as_null=True)),
    sa.Column("verdict", sa.String(32)),
    sa.Column("kind", sa.String(16), nullable=False, server_default="close-loop"),
    sa.Column("options", sa.JSON(none_as_null=True)),
    sa.Index("close_loops_by_state", "state", "created_at"),
)

#: The report's files, cut up as `session_parts` are.
close_loop_parts = sa.Table(
    "close_loop_parts",
    metadata,
    sa.Column("close_loop_id", sa.ForeignKey("close_loops.id"), primary_key=True),
    sa.Column("file", sa.String(32), primary_key=True),
    sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),
    sa.Column("content", sa.LargeBinary, nullable=False),
)

#: Workers that can close loops, and when they last asked for one or were at work on one.
loop_workers = sa.Table(
    "loop_workers",
    metadata,
    sa.Column("worker_id", sa.ForeignKey("workers.id"), primary_key=True),
    sa.Column("last_seen", sa.Double, nullable=False),
    #: By which it interprets; none: it does not.
    sa.Column("bank", sa.String(32)),
)

#: How precise a study shall become, and what was done for it.
goals = sa.Table(
    "goals",
    metadata,
    sa.Column("study_id", sa.ForeignKey("studies.id"), primary_key=True),
    sa.Column("output", sa.String(128), nullable=False),
    sa.Column("target", sa.Double),
    sa.Column("up_to", sa.BigInteger, nullable=False),
    sa.Column("judged", sa.BigInteger),
    sa.Column("steps", sa.JSON, nullable=False),
)
