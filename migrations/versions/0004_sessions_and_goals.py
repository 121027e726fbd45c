"""Measured sessions with the loops closed on them, and how precise a study is to become."""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add sessions, jobs that close the loop on them, the files of both in parts, and goals."""
    op.create_table(
        "sessions",
        sa.Column("id", sa.String(32), primary_key=True),
        sa.Column("name", sa.String(128), nullable=False),
        sa.Column("sha256", sa.String(64), nullable=False, unique=True),
        sa.Column("size", sa.BigInteger, nullable=False),
        sa.Column("content", sa.JSON, nullable=False),
        sa.Column("created_at", sa.Double, nullable=False),
    )
    op.create_table(
        "session_parts",
        sa.Column("session_id", sa.String(32), sa.ForeignKey("sessions.id"), primary_key=True),
        sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("content", sa.LargeBinary, nullable=False),
    )
    op.create_table(
        "close_loops",
        sa.Column("id", sa.String(32), primary_key=True),
        sa.Column("session_id", sa.String(32), sa.ForeignKey("sessions.id"), nullable=False),
        sa.Column("state", sa.String(16), nullable=False),
        sa.Column("created_at", sa.Double, nullable=False),
        sa.Column("finished_at", sa.Double),
        sa.Column("expires_at", sa.Double),
        sa.Column("grants", sa.Integer, nullable=False),
        sa.Column("attempts", sa.JSON, nullable=False),
        sa.Column("progress", sa.Text, nullable=False),
        sa.Column("code", sa.String(16)),
        sa.Column("fault", sa.JSON),
        sa.Column("verdict", sa.String(32)),
    )
    op.create_index("ix_close_loops_session_id", "close_loops", ["session_id"])
    op.create_index("close_loops_by_state", "close_loops", ["state", "created_at"])
    op.create_table(
        "close_loop_parts",
        sa.Column(
            "close_loop_id", sa.String(32), sa.ForeignKey("close_loops.id"), primary_key=True
        ),
        sa.Column("file", sa.String(32), primary_key=True),
        sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("content", sa.LargeBinary, nullable=False),
    )
    op.create_table(
        "loop_workers",
        sa.Column("worker_id", sa.String(128), sa.ForeignKey("workers.id"), primary_key=True),
        sa.Column("last_seen", sa.Double, nullable=False),
    )
    op.create_table(
        "goals",
        sa.Column("study_id", sa.String(32), sa.ForeignKey("studies.id"), primary_key=True),
        sa.Column("output", sa.String(128), nullable=False),
        sa.Column("target", sa.Double),
        sa.Column("up_to", sa.BigInteger, nullable=False),
        sa.Column("judged", sa.BigInteger),
        sa.Column("steps", sa.JSON, nullable=False),
    )


def downgrade() -> None:
    """Go back to 0003; sessions, what was found in them, and goals are gone."""
    for table in (
        "goals",
        "loop_workers",
        "close_loop_parts",
        "close_loops",
        "session_parts",
        "sessions",
    ):
        op.drop_table(table)
