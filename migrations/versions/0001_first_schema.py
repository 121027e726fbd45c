"""First schema: studies, their instances, leases, results, and what the analysis makes of them."""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None

#: SQLite counts up only what it calls INTEGER PRIMARY KEY.
_COUNTING = sa.BigInteger().with_variant(sa.Integer, "sqlite")


def upgrade() -> None:
    """Create every table."""
    op.create_table(
        "studies",
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
    )
    op.create_index("studies_by_age", "studies", ["state", "created_at", "id"])
    op.create_table(
        "workers",
        sa.Column("id", sa.String(128), primary_key=True),
        sa.Column("host", sa.String(255), nullable=False),
        sa.Column("versions", sa.JSON, nullable=False),
        sa.Column("last_seen", sa.Double, nullable=False),
        sa.Column("instances_done", sa.BigInteger, nullable=False),
    )
    op.create_table(
        "instances",
        sa.Column("study_id", sa.String(32), sa.ForeignKey("studies.id"), primary_key=True),
        sa.Column("row", sa.BigInteger, primary_key=True),
        sa.Column("position", sa.Integer, primary_key=True),
        sa.Column("state", sa.String(16), nullable=False),
        sa.Column("lease_id", sa.String(32)),
        sa.Column("attempts", sa.JSON, nullable=False),
        sqlite_with_rowid=False,
    )
    op.create_index(
        "instances_returned",
        "instances",
        ["study_id", "row", "position"],
        sqlite_where=sa.text("state = 'pending'"),
        postgresql_where=sa.text("state = 'pending'"),
    )
    op.create_table(
        "leases",
        sa.Column("fence", _COUNTING, primary_key=True),
        sa.Column("id", sa.String(32), nullable=False, unique=True),
        sa.Column("worker_id", sa.String(128), sa.ForeignKey("workers.id"), nullable=False),
        sa.Column("study_id", sa.String(32), sa.ForeignKey("studies.id"), nullable=False),
        sa.Column("state", sa.String(16), nullable=False),
        sa.Column("granted_at", sa.Double, nullable=False),
        sa.Column("expires_at", sa.Double, nullable=False),
        sa.Column("instances", sa.JSON, nullable=False),
        sqlite_autoincrement=True,
    )
    op.create_index(
        "leases_open",
        "leases",
        ["expires_at"],
        sqlite_where=sa.text("state = 'open'"),
        postgresql_where=sa.text("state = 'open'"),
    )
    op.create_table(
        "results",
        sa.Column("study_id", sa.String(32), sa.ForeignKey("studies.id"), primary_key=True),
        sa.Column("seq", sa.BigInteger, primary_key=True, autoincrement=False),
        sa.Column("row", sa.BigInteger, nullable=False),
        sa.Column("position", sa.Integer, nullable=False),
        sa.Column("outcome", sa.String(40), nullable=False),
        sa.Column("outputs", sa.JSON),
        sa.Column("reason", sa.Text, nullable=False),
        sa.Column("state", sa.JSON),
        sa.Column("wall_seconds", sa.Double),
        sa.Column("worker_id", sa.String(128), sa.ForeignKey("workers.id"), nullable=False),
        sa.Column("received_at", sa.Double, nullable=False),
    )
    op.create_index("results_by_instance", "results", ["study_id", "row", "position"], unique=True)
    op.create_table(
        "conflicts",
        sa.Column("id", _COUNTING, primary_key=True),
        sa.Column("study_id", sa.String(32), sa.ForeignKey("studies.id"), nullable=False),
        sa.Column("row", sa.BigInteger, nullable=False),
        sa.Column("position", sa.Integer, nullable=False),
        sa.Column("outcome", sa.String(40), nullable=False),
        sa.Column("outputs", sa.JSON),
        sa.Column("reason", sa.Text, nullable=False),
        sa.Column("worker_id", sa.String(128), sa.ForeignKey("workers.id"), nullable=False),
        sa.Column("received_at", sa.Double, nullable=False),
    )
    op.create_index("ix_conflicts_study_id", "conflicts", ["study_id"])
    op.create_table(
        "estimator_states",
        sa.Column("study_id", sa.String(32), sa.ForeignKey("studies.id"), primary_key=True),
        sa.Column("cursor", sa.BigInteger, nullable=False),
        sa.Column("state", sa.LargeBinary, nullable=False),
    )
    op.create_table(
        "snapshots",
        sa.Column("study_id", sa.String(32), sa.ForeignKey("studies.id"), primary_key=True),
        sa.Column("snapshot", sa.JSON, nullable=False),
    )
