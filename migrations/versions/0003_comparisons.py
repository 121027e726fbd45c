"""Second opinions on a share of the results."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

#: SQLite counts up only what it calls INTEGER PRIMARY KEY.
_COUNTING = sa.BigInteger().with_variant(sa.Integer, "sqlite")


def upgrade() -> None:
    """Add a table, and to every lease whether it asks for results or for second opinions."""
    op.add_column(
        "leases", sa.Column("compares", sa.Boolean, nullable=False, server_default=sa.false())
    )
    op.create_table(
        "comparisons",
        sa.Column("id", _COUNTING, primary_key=True),
        sa.Column("study_id", sa.String(32), sa.ForeignKey("studies.id"), nullable=False),
        sa.Column("row", sa.BigInteger, nullable=False),
        sa.Column("position", sa.Integer, nullable=False),
        sa.Column("state", sa.String(16), nullable=False),
        sa.Column("attempts", sa.Integer, nullable=False),
        sa.Column("lease_id", sa.String(32)),
        sa.Column("asked_at", sa.Double, nullable=False),
        sa.Column("decided_at", sa.Double),
        sa.Column("first_host", sa.String(255), nullable=False),
        sa.Column("first_worker_id", sa.String(128), sa.ForeignKey("workers.id"), nullable=False),
        sa.Column("second_host", sa.String(255)),
        sa.Column("second_worker_id", sa.String(128), sa.ForeignKey("workers.id")),
        sa.Column("outcome", sa.String(40)),
        sa.Column("outputs", sa.JSON),
        sa.Column("difference", sa.Double),
    )
    op.create_index("ix_comparisons_lease_id", "comparisons", ["lease_id"])
    op.create_index("comparisons_by_state", "comparisons", ["state", "first_host"])
    op.create_index("comparisons_by_instance", "comparisons", ["study_id", "row", "position"])


def downgrade() -> None:
    """Go back to 0002; what second opinions came to is gone, and leases that ask for some end."""
    connection = op.get_bind()
    connection.execute(
        sa.text("UPDATE leases SET state = 'released' WHERE compares AND state = 'open'")
    )
    # 0002 knows no draining: it would leave such a study alone for ever.
    connection.execute(sa.text("UPDATE studies SET state = 'running' WHERE state = 'draining'"))
    op.drop_table("comparisons")
    op.drop_column("leases", "compares")
